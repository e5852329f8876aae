"""Answers of PoseLib and OpenCV to random problems, for the tests of this crate.

    pip install numpy poselib opencv-python-headless
    python make_goldens.py goldens.json

Made with poselib 2.0.5, opencv 5.0.0, numpy 2.4.6. Image points are on the plane z = 1; rotations are rows of 3x3; `b = R a + t`.
"""

import json
import sys

import cv2
import numpy as np
import poselib

FOCAL = 618.0
HALF = np.tan(np.radians(22.5))
rng = np.random.default_rng(20261122)


def rodrigues(v):
    return cv2.Rodrigues(np.asarray(v, float))[0]


def direction():
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def hom(p):
    return np.column_stack([p, np.ones(len(p))])


def unit(p):
    h = hom(p)
    return h / np.linalg.norm(h, axis=1, keepdims=True)


def two_view(kind, n, noise, outliers):
    """Matches (ax, ay, bx, by), R and unit t."""
    while True:
        a = rng.uniform(-HALF, HALF, (n, 2))
        if kind == "general":
            z = rng.uniform(1, 4, n)
            r, t = rodrigues(direction() * rng.uniform(0, 0.3)), direction() * 0.4
        else:
            z = 1.0 + 0.03 * (a[:, 0] - a[:, 1]) + rng.normal(size=n) * (0.9 / FOCAL / 0.15 if kind == "nadir" else 0.0)
            heading = rng.uniform(0, 2 * np.pi)
            r = rodrigues([0, 0, rng.uniform(-3, 3)]) @ rodrigues(direction() * 0.05)
            t = 0.15 * np.array([np.cos(heading), np.sin(heading), rng.uniform(-0.2, 0.2)])
        x = hom(a) * z[:, None] @ r.T + t
        if (x[:, 2] > 0.1).all():
            break
    b = x[:, :2] / x[:, 2:]
    m = np.column_stack([a, b]) + noise * rng.normal(size=(n, 4))
    k = int(outliers * n)
    m[:k, 2:] = rng.uniform(-HALF, HALF, (k, 2))
    return m.round(9), r, t / np.linalg.norm(t)


def angle_deg(r):
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return float(np.degrees(np.arctan2(np.linalg.norm(v), np.trace(r) - 1)))


def direction_deg(t, u):
    t, u = np.ravel(t), np.ravel(u)
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(t, u)), t @ u)))


CAMERA = {"model": "SIMPLE_PINHOLE", "width": 512, "height": 512, "params": [FOCAL, 0.0, 0.0]}


def by_poselib(m, seed=0):
    pose, _ = poselib.estimate_relative_pose(
        m[:, :2] * FOCAL, m[:, 2:] * FOCAL, CAMERA, CAMERA, {"max_epipolar_error": 1.0, "success_prob": 0.9999, "seed": seed}, {}
    )
    return pose.R, pose.t


def by_opencv(m):
    e, mask = cv2.findEssentialMat(m[:, :2] * FOCAL, m[:, 2:] * FOCAL, FOCAL, (0.0, 0.0), cv2.RANSAC, 0.9999, 1.0)
    _, r, t, _ = cv2.recoverPose(e[:3], m[:, :2] * FOCAL, m[:, 2:] * FOCAL, focal=FOCAL, pp=(0.0, 0.0), mask=mask)
    return r, t


def relative():
    out = []
    for kind in ["general", "nadir"]:
        for outliers in [0.0, 0.4]:
            for _ in range(2):
                m, r, t = two_view(kind, 200, 0.3 / FOCAL, outliers)
                errors = {
                    name: [angle_deg(q @ r.T), direction_deg(s, t)]
                    for name, (q, s) in {"poselib": by_poselib(m), "opencv": by_opencv(m)}.items()
                }
                out.append({"kind": kind, "matches": m.tolist(), "rotation": r.tolist(), "translation": t.tolist(), "errors_deg": errors})
    return out


def five_points():
    out = []
    for k in range(30):
        m, _, _ = two_view("general" if k % 2 else "plane", 5, 0.0, 0.0)
        poses = poselib.relpose_5pt(list(unit(m[:, :2])), list(unit(m[:, 2:])))
        out.append({"matches": m.tolist(), "motions": [{"rotation": p.R.tolist(), "translation": p.t.tolist()} for p in poses]})
    return out


def resection(n, noise, outliers):
    image = rng.uniform(-HALF, HALF, (n, 2))
    x = hom(image) * rng.uniform(1, 4, n)[:, None]
    r, t = rodrigues(direction() * rng.uniform(0, 3)), direction() * 2.0
    world = (x - t) @ r
    image = image + noise * rng.normal(size=image.shape)
    k = int(outliers * n)
    image[:k] = rng.uniform(-HALF, HALF, (k, 2))
    return world, image, r, t


def three_points():
    out = []
    for _ in range(30):
        world, image, _, _ = resection(3, 0.0, 0.0)
        poses = poselib.p3p(list(unit(image)), list(world))
        poses = [{"rotation": p.R.tolist(), "translation": p.t.tolist()} for p in poses]
        out.append({"world": world.tolist(), "image": image.tolist(), "poses": poses})
    return out


def absolute():
    out = []
    for outliers in [0.0, 0.5]:
        for _ in range(2):
            world, image, r, t = resection(80, 0.5 / FOCAL, outliers)
            pose, _ = poselib.estimate_absolute_pose(image * FOCAL, world, CAMERA, {"max_reproj_error": 2.0, "success_prob": 0.9999}, {})
            k = np.diag([FOCAL, FOCAL, 1.0])
            _, rv, tv, _ = cv2.solvePnPRansac(world, image * FOCAL, k, None, reprojectionError=2.0, confidence=0.9999, iterationsCount=1000)
            q = rodrigues(rv.ravel())
            errors = {
                "poselib": [angle_deg(pose.R @ r.T), float(np.linalg.norm(pose.t - t))],
                "opencv": [angle_deg(q @ r.T), float(np.linalg.norm(tv.ravel() - t))],
            }
            out.append({"world": world.tolist(), "image": image.tolist(), "rotation": r.tolist(), "translation": t.tolist(), "errors": errors})
    return out


def homography():
    out = []
    for k in range(10):
        m, _, _ = two_view("plane", 4 if k % 2 else 80, 0.0 if k % 2 else 0.3 / FOCAL, 0.0)
        if k % 2:
            h = cv2.getPerspectiveTransform(m[:, :2].astype(np.float32), m[:, 2:].astype(np.float32))
            m = m.astype(np.float32).astype(float)
        else:
            h, _ = cv2.findHomography(m[:, :2], m[:, 2:], 0)
        out.append({"matches": m.tolist(), "homography": h.tolist()})
    return out


def umeyama():
    out = []
    for _ in range(10):
        p = rng.normal(size=(20, 3))
        q = rng.uniform(0.2, 5) * p @ rodrigues(direction() * rng.uniform(0, 3)).T + rng.normal(size=3) * 10 + 0.05 * rng.normal(size=p.shape)
        m, scale = cv2.estimateAffine3D(p, q, force_rotation=True)
        # OpenCV gives the rotation unscaled beside the scale, and the translation for the scaled one.
        out.append({"from": p.tolist(), "to": q.tolist(), "scale": float(scale), "rotation": m[:, :3].tolist(), "translation": m[:, 3].tolist()})
    return out


def rounded(v):
    if isinstance(v, float):
        return float(f"{v:.12g}")
    if isinstance(v, dict):
        return {k: rounded(x) for k, x in v.items()}
    return [rounded(x) for x in v] if isinstance(v, list) else v


if __name__ == "__main__":
    data = {f.__name__: f() for f in [five_points, three_points, homography, umeyama, relative, absolute]}
    with open(sys.argv[1], "w") as file:
        json.dump(rounded(data), file, separators=(",", ":"))
