"""Makes pair.npz (a small synthetic pair and a prediction of it) and expected.json (its metrics) with independent programs:
NumPy, SciPy (cKDTree, ndimage.sobel, binary_erosion, Rotation, norm), scikit-image (structural_similarity).

    pip install numpy scipy scikit-image && python make.py

Made with NumPy 2.4.6, SciPy 1.17.1, scikit-image 0.26.0. The surface is a sum of sines above a plane that touches the Moon's
sphere at the south pole; nothing of it comes from a dataset.
"""

import json

import numpy as np
from scipy.ndimage import binary_erosion, sobel
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from skimage.metrics import structural_similarity

W, H, F = 16, 104, 130.0
K = np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1]])  # corner based: pixel centres at +0.5
RADIUS = 1737400.0
U, V = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
RAYS = np.stack([(U - W / 2) / F, (V - H / 2) / F, np.ones_like(U)], -1)


def height(x, y):
    return (
        700 * np.sin(x / 1500) * np.cos(y / 1900)
        + 260 * np.sin(x / 610 + 1) * np.sin(y / 730)
        + 70 * np.sin(x / 250) * np.cos(y / 310 + 2)
    )


def look(position, angles):
    """world_from_cam: straight down at the south pole, then turned."""
    down = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])  # camera Z along world +Z: towards the surface from below
    pose = np.eye(4)
    pose[:3, :3] = down @ Rotation.from_euler("xyz", angles).as_matrix()
    pose[:3, 3] = position
    return pose


def cast(pose):
    """z-depth of the surface -RADIUS - height(x, y), from outside (below the south pole, looking up +Z)."""
    rays = RAYS @ pose[:3, :3].T
    z = np.full((H, W), 30000.0)
    for _ in range(200):
        p = pose[:3, 3] + rays * z[..., None]
        z = z + 0.7 * ((-RADIUS - height(p[..., 0], p[..., 1])) - p[..., 2]) / rays[..., 2]
    return z


pose_a = look([200.0, -300.0, -RADIUS - 30000.0], [0.05, -0.03, 0.1])
pose_b = look([3900.0, 900.0, -RADIUS - 31000.0], [0.02, -0.14, 0.35])
rng = np.random.default_rng(7)
depth = [cast(pose_a).astype(np.float32), cast(pose_b).astype(np.float32)]
depth[0][3, 4] = np.nan
depth[1][50, 6:8] = np.nan

a_from_world = np.linalg.inv(pose_a)
b_from_a = np.linalg.inv(pose_b) @ pose_a
a_from_b = np.linalg.inv(b_from_a)


def carry(m, p):
    return p @ m[:3, :3].T + m[:3, 3]


truth = [RAYS * depth[0][..., None].astype(np.float64)]
truth.append(carry(a_from_b, RAYS * depth[1][..., None].astype(np.float64)))
origins = [np.zeros(3), a_from_b[:3, 3]]

# The prediction: a similarity, smooth and rough errors along the rays, gross errors, holes.
turn = Rotation.from_euler("xyz", [0.004, -0.002, 0.003]).as_matrix()
UNIT = 1 / 4000.0
points, confidence, sigma, fill = [], [], [], []
for v in range(2):
    ray = truth[v] - origins[v]
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    steps = rng.integers(1, 200, (H, W))
    sigma_m = steps / 64 * 25.0
    off = 60 * np.sin(U / 3) * np.cos(V / 11 + v) + sigma_m * rng.normal(size=(H, W)) * 1.3
    off[rng.random((H, W)) < 0.03] += 2500
    p = (truth[v] + ray * off[..., None]) @ turn.T * UNIT + [0.01, -0.02, 0.03]
    kind = np.where(rng.random((H, W)) < 0.1, 2, 1).astype(np.uint8)
    kind[rng.random((H, W)) < (0.01 if v == 0 else 0.05)] = 0
    kind[20:24, 5:9] = 0
    kind[~np.isfinite(depth[v])] = 1  # an answer where there is no truth counts nowhere
    p[~np.isfinite(depth[v])] = [0.1, 0.2, 8.0]
    p[kind == 0] = np.nan
    points.append(p.astype(np.float32))
    confidence.append((255 - steps // 2 - rng.integers(0, 40, (H, W))).astype(np.uint8))
    sigma.append(steps.astype(np.uint8))
    fill.append(kind)
estimate = b_from_a.copy()
estimate[:3, :3] = Rotation.from_rotvec([2e-4, -3e-4, 1e-4]).as_matrix() @ b_from_a[:3, :3]
estimate[:3, 3] = (b_from_a[:3, 3] + [30, -20, 15]) * UNIT

np.savez_compressed(
    "pair.npz",
    depth_z_a=depth[0], depth_z_b=depth[1], world_from_cam_a=pose_a, world_from_cam_b=pose_b, k=K,
    points_a=points[0], points_b=points[1], confidence_a=confidence[0], confidence_b=confidence[1],
    sigma_a=sigma[0], sigma_b=sigma[1], fill_a=fill[0], fill_b=fill[1], cam_b_from_cam_a=estimate, unit=UNIT * 25.0 / 64,
)


def surface_z(depth_z, x, y):
    inside = (x >= 0) & (x < W) & (y >= 0) & (y < H)
    px, py = np.clip(x, 0.5, W - 0.5) - 0.5, np.clip(y, 0.5, H - 0.5) - 0.5
    x0, y0 = np.floor(px).astype(int), np.floor(py).astype(int)
    fx, fy = px - x0, py - y0
    total = np.zeros_like(px)
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            weight = wx * wy
            sample = depth_z[np.minimum(y0 + dy, H - 1), np.minimum(x0 + dx, W - 1)].astype(np.float64)
            total = total + np.where(weight > 0, weight * sample, 0)
    own = depth_z[np.clip(np.floor(y).astype(int), 0, H - 1), np.clip(np.floor(x).astype(int), 0, W - 1)].astype(np.float64)
    total = np.where(np.isfinite(total), total, own)
    return np.where(inside, total, np.nan)


def project(p):
    return F * p[..., 0] / p[..., 2] + W / 2, F * p[..., 1] / p[..., 2] + H / 2


def covisible(here, there, there_from_here):
    p = carry(there_from_here, RAYS * here[..., None].astype(np.float64))
    p[~np.isfinite(p)] = -1e9
    x, y = project(p)
    z = surface_z(there, x, y)
    back = carry(np.linalg.inv(there_from_here), np.stack([(x - W / 2) / F, (y - H / 2) / F, np.ones_like(x)], -1) * z[..., None])
    back[~np.isfinite(back)] = -1e9
    bx, by = project(back)
    bz = surface_z(here, bx, by)
    with np.errstate(invalid="ignore"):
        ok = (abs(p[..., 2] - z) <= 0.005 * z) & (abs(back[..., 2] - bz) <= 0.005 * bz)
    return ok & np.isfinite(here)


def umeyama(x, y):
    mx, my = x.mean(0), y.mean(0)
    cov = (y - my).T @ (x - mx) / len(x)
    u, d, vt = np.linalg.svd(cov)
    s = np.diag([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    r = u @ s @ vt
    c = np.trace(np.diag(d) @ s) / ((x - mx) ** 2).sum(1).mean()
    return c, r, my - c * r @ mx


def apply(fit, p):
    c, r, t = fit
    return c * p @ r.T + t


def robust(x, y):
    fit = umeyama(x, y)
    kept = len(x)
    for _ in range(10):
        res = np.linalg.norm(apply(fit, x) - y, axis=1)
        cut = 3 * np.sort(res)[len(res) // 2]
        keep = res <= cut
        if keep.sum() == kept:
            break
        kept = keep.sum()
        fit = umeyama(x[keep], y[keep])
    res = np.linalg.norm(apply(fit, x) - y, axis=1)
    return fit, kept / len(x), np.sort(res)[len(res) // 2]


def plane_error(p):
    q = p[np.isfinite(p[:, 2])]
    mean = q.mean(0)
    n = np.linalg.svd(q - mean, full_matrices=False)[2][2]
    return np.linalg.norm(p * ((n @ mean) / (p @ n))[:, None] - p, axis=1)


def world_z(p):
    return carry(pose_a, p)[..., 2]


def slopes(p, footprint):
    z = world_z(p)
    length = np.hypot(sobel(z, axis=1), sobel(z, axis=0))
    flat = p.reshape(-1, 3)
    ok = np.isfinite(flat[:, 2])
    cloud = flat[ok]
    _, near = cKDTree(cloud).query(cloud, k=30)
    axis = pose_a[2, :3]
    normals = np.array([np.linalg.eigh(np.cov(cloud[n].T))[1][:, 0] for n in near])
    from_neighbours = np.full(len(flat), np.nan)
    from_neighbours[ok] = np.arccos(np.clip(abs(normals @ axis), 0, 1))
    true = np.full((H, W), np.nan)
    right, down = p[2:-2, 4:] - p[2:-2, :-4], p[4:, 2:-2] - p[:-4, 2:-2]
    n = np.cross(down, right) @ pose_a[:3, :3].T
    up = carry(pose_a, p)[2:-2, 2:-2]
    true[2:-2, 2:-2] = np.arccos(np.clip((n * up).sum(-1) / np.linalg.norm(n, axis=-1) / np.linalg.norm(up, axis=-1), -1, 1))
    return [np.arctan(length / 8), np.arctan(length / (8 * footprint)), from_neighbours.reshape(H, W), true]


def agreement(a, b, mask):
    m = mask & np.isfinite(a) & np.isfinite(b)
    return np.corrcoef(a[m], b[m])[0, 1], abs(a[m] - b[m]).mean()


def ssim(a, b):
    m = np.isfinite(a) & np.isfinite(b)
    rng_ = max(a[m].max(), b[m].max()) - min(a[m].min(), b[m].min())
    fa, fb = np.where(m, a, b[m].mean()), np.where(m, b, b[m].mean())
    _, full = structural_similarity(fa, fb, data_range=rng_, full=True)
    windows = binary_erosion(m, np.ones((7, 7)), border_value=0)
    return full[windows].mean()


def profile(a, b, rows):
    out = []
    for y in rows:
        m = np.isfinite(a[y]) & np.isfinite(b[y])
        if m.sum() >= 10:
            out.append((abs(a[y][m] - b[y][m]).mean(), np.corrcoef(a[y][m], b[y][m])[0, 1]))
    return np.mean(out, axis=0) if out else (None, None)


def ause(error, doubt):
    n = len(error)
    order = np.argsort(doubt, kind="stable")
    by = error[order].astype(float)
    d = doubt[order]
    for value in np.unique(d):
        by[d == value] = by[d == value].mean()
    oracle = np.sort(error)
    curves = []
    for values in (by, oracle):
        kept = [-(-n * (20 - level) // 20) for level in range(20)]
        curves.append(np.array([values[:k].mean() for k in kept]) / error.mean())
    return np.trapezoid(curves[0] - curves[1], dx=0.05)


expected = {}
r = Rotation.from_matrix(estimate[:3, :3] @ b_from_a[:3, :3].T)
expected["rra_deg"] = np.degrees(r.magnitude())
t, g = estimate[:3, 3], b_from_a[:3, 3]
expected["rta_deg"] = np.degrees(2 * np.arctan2(np.linalg.norm(t / np.linalg.norm(t) - g / np.linalg.norm(g)), np.linalg.norm(t / np.linalg.norm(t) + g / np.linalg.norm(g))))
allp = carry(pose_a, np.concatenate([x.reshape(-1, 3) for x in truth]))
expected["bbox_diagonal_m"] = diagonal = np.linalg.norm(np.nanmax(allp, 0) - np.nanmin(allp, 0))
expected["footprint_m"] = footprint = np.nanmedian(depth[0].astype(np.float64)) / F
expected["baseline_m"] = np.linalg.norm(g)
seen = [covisible(depth[0], depth[1], b_from_a), covisible(depth[1], depth[0], a_from_b)]
for v, name in enumerate("ab"):
    expected[f"covisible_share_{name}"] = seen[v].sum() / np.isfinite(depth[v]).sum()
answered = [fill[v] != 0 for v in range(2)]
pred = [np.where(answered[v][..., None], points[v].astype(np.float64), np.nan) for v in range(2)]
plane = plane_error(truth[0].reshape(-1, 3)).reshape(H, W)
true_slopes = slopes(truth[0], footprint)

for region, masks in (("overlap", seen), ("full", [np.isfinite(d) for d in depth])):
    e = expected[region] = {}
    use = [masks[v] & answered[v] for v in range(2)]
    x = np.concatenate([pred[v][use[v]] for v in range(2)])
    y = np.concatenate([truth[v][use[v]] for v in range(2)])
    fit, share, median = robust(x, y)
    z_med = np.median(depth[0][masks[0]].astype(np.float64))
    e["num_pixels"] = sum(m.sum() for m in masks)
    e["median_depth_z_m"] = z_med
    e["coverage"], e["coverage_b"] = use[0].sum() / masks[0].sum(), use[1].sum() / masks[1].sum()
    e["coverage_measured"] = (use[0] & (fill[0] == 1)).sum() / masks[0].sum()
    e["align_scale"], e["align_inlier_share"], e["align_residual_median_m"] = fit[0], share, median
    aligned = [apply(fit, p) for p in pred]
    err = [np.linalg.norm(aligned[v] - truth[v], axis=-1) for v in range(2)]
    errors = np.where(answered[0], err[0], plane)[masks[0]]
    e["point_error_m"], e["point_error_median_m"] = errors.mean(), np.median(errors)
    e["point_error_rmse_m"] = np.sqrt((errors**2).mean())
    e["point_error_rel"] = errors.mean() / z_med
    e["point_error_answered_rel"] = err[0][use[0]].mean() / z_med
    e["point_error_plane_rel"] = plane[masks[0]].mean() / z_med
    cp = np.concatenate([aligned[v][use[v]] for v in range(2)])
    ct = np.concatenate([truth[v][masks[v]] for v in range(2)])
    acc, comp = cKDTree(ct).query(cp)[0].mean(), cKDTree(cp).query(ct)[0].mean()
    for name, value in (("accuracy", acc), ("completeness", comp), ("chamfer", (acc + comp) / 2)):
        e[f"{name}_m"], e[f"{name}_pct_bbox"], e[f"{name}_pct_depth_z"] = value, 100 * value / diagonal, 100 * value / z_med
    found = slopes(aligned[0], footprint)
    eroded = binary_erosion(use[0] & np.isfinite(depth[0]), np.ones((9, 9)), border_value=0)
    for k, name in enumerate(("code", "gsd", "normals", "true")):
        corr, mae = agreement(found[k], true_slopes[k], eroded if name == "gsd" else masks[0])
        e[f"slope_corr_{name}"] = corr
        e["slope_mae_deg" if name == "true" else f"slope_mae_{name}_deg"] = np.degrees(mae)
    m = masks[0] & np.isfinite(found[3]) & np.isfinite(true_slopes[3])
    for limit in (5, 10, 15, 20):
        p_, t_ = found[3][m] > np.radians(limit), true_slopes[3][m] > np.radians(limit)
        e[f"hazard_agree_{limit}deg"] = (p_ == t_).mean()
        e[f"hazard_false_alarm_{limit}deg"], e[f"hazard_miss_{limit}deg"] = (p_ & ~t_).mean(), (~p_ & t_).mean()
    maps = {"world_z": (world_z(aligned[0]), world_z(truth[0])), "depth_z": (aligned[0][..., 2], truth[0][..., 2])}
    for name, (a, b) in maps.items():
        a, b = np.where(masks[0], a, np.nan), np.where(masks[0], b, np.nan)
        e[f"ssim_{name}"] = ssim(a, b)
        e[f"profile_{name}_mae_m"], e[f"profile_{name}_corr"] = profile(a, b, [H // 2])
        e[f"profiles_{name}_mae_m"], e[f"profiles_{name}_corr"] = profile(a, b, range(0, H, 50))
    z = np.concatenate([aligned[0][use[0]][:, 2], carry(b_from_a, aligned[1][use[1]])[:, 2]])
    zt = np.concatenate([depth[v][use[v]] for v in range(2)]).astype(np.float64)
    e["depth_z_abs_rel"], e["depth_z_rmse_m"] = (abs(z - zt) / zt).mean(), np.sqrt(((z - zt) ** 2).mean())
    e["depth_z_silog"] = np.std(np.log(z) - np.log(zt))
    ratio = np.maximum(z / zt, zt / z)
    for name, bound in (("1_25", 1.25), ("1_25_2", 1.25**2), ("1_25_3", 1.25**3), ("1_01", 1.01), ("1_001", 1.001)):
        e[f"depth_z_delta_{name}"] = (ratio < bound).mean()
    ray = [(truth[v] - origins[v]) / np.linalg.norm(truth[v] - origins[v], axis=-1, keepdims=True) for v in range(2)]
    along = np.concatenate([((aligned[v] - truth[v]) * ray[v]).sum(-1)[use[v]] for v in range(2)])
    s = np.concatenate([(sigma[v].astype(np.float32) * np.float32(UNIT * 25.0 / 64)).astype(np.float64)[use[v]] for v in range(2)]) * fit[0]
    score = abs(along) / s
    levels = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99])
    observed = np.array([(score <= norm.ppf((1 + q) / 2)).mean() for q in levels])
    e["sigma_calibration_error"] = abs(observed - levels).mean()
    e["sigma_sharpness_m"] = np.sort(s)[len(s) // 2]
    e["sigma_z_mean_abs"], e["sigma_z_rms"] = score.mean(), np.sqrt((score**2).mean())
    error = np.concatenate([err[v][use[v]] for v in range(2)])
    e["sigma_ause"] = ause(error, s)
    e["confidence_ause"] = ause(error, -np.concatenate([confidence[v][use[v]] for v in range(2)]).astype(np.float64))

# A whole map with its unmasked SSIM, far from zero as world Z is.
whole_truth, whole_found = world_z(truth[1]), None
whole_truth = np.where(np.isfinite(whole_truth), whole_truth, np.nanmean(whole_truth)).astype(np.float32)
whole_found = (whole_truth + 40 * np.sin(U / 2) * np.cos(V / 3)).astype(np.float32)
a, b = whole_found.astype(np.float64), whole_truth.astype(np.float64)
expected["ssim_whole"] = structural_similarity(a, b, data_range=max(a.max(), b.max()) - min(a.min(), b.min()))
with np.load("pair.npz") as old:
    arrays = dict(old)
np.savez_compressed("pair.npz", **arrays, whole_truth=whole_truth, whole_found=whole_found)
json.dump(expected, open("expected.json", "w"), indent=1, default=float)
print({k: v for k, v in expected.items() if not isinstance(v, dict)})
for k in ("overlap", "full"):
    print(k, {n: round(float(v), 5) for n, v in expected[k].items()})
