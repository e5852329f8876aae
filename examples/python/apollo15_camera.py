#!/usr/bin/env python3
"""Cameras of Apollo 15 metric frames: from what ISIS stores in its labels to our camera TOML.

usage: apollo15_camera.py LABELS.json --out DIR [--check CUBES]

LABELS.json holds, per frame, ISIS's tables and NAIF keywords, the derived position and rotation in the Moon-fixed frame (mean Earth / polar
axis), and the crop of the scan (AlphaCube). DIR gets `<frame>.toml` for `selenograph reconstruct --camera-a/-b`. `--check` reads the cropped
cubes, prints where the frames look, their overlap and baseline over height, and the distance of SIFT matches from their epipolar lines.
Needs numpy; `--check` also opencv-python-headless.

How ISIS sees the frame, and how that becomes ours:
* samples and lines count from 1 at the first pixel's centre, so a continuous coordinate from the corner is theirs minus 0.5; the crop's
  first corner is AlphaStartingSample as it stands (it names an edge).
* focal plane, mm: x = -pitch (sample - N/2), y = pitch (line - N/2); the camera looks along -Z, so our axes (right, down, forward)
  are ISIS's (-x, y, -z).
* distortion leads from the measured point to the ideal one: with (x, y) from the principal point PP,
  ideal = (x, y) (1 + k1 r2 + k2 r4 + k3 r6) + (j1 r2 + j2 r4) (-sin t0, cos t0).
* ours (Brown, as OpenCV) leads from the ideal point to the measured one: it is fitted here by least squares over the crop, and the
  residual is printed. The decentering has only two terms in Brown's form, so a residual remains; it is far below a pixel.

What `--check` finds for AS15-M-0297 and 0298 (rev 16, over the far side at 20 S, 145 E): matches lie 2.6 px (of the crop, 42 of the scan)
beside the epipolar lines of the labels, all to the same side, and 0.3 px about that. A turn of one frame by 0.15 degrees about the baseline
takes it away: it is an error of the labels' pointing, or of where the scan lies on the film, not of the convention. Heights triangulated
with the labels follow the 4 px/degree global map (correlation 0.94) but lie 1.4 km too high.
"""
import argparse
import json
import re
from pathlib import Path

import numpy as np

RADIUS_M = 1737400.0
SCAN = 22900


def numbers(text):
    return [float(v) for v in re.findall(r"[-+0-9.eE]+", text)]


class Frame:
    """One cropped frame, as ISIS has it."""

    def __init__(self, name, label):
        naif, crop, derived = label["naif"], label["crop"], label["derived"]
        key = lambda word: numbers(next(v for k, v in naif.items() if k.endswith(word)))
        self.name = name
        self.focal_mm, self.pitch_mm = key("_FOCAL_LENGTH")[0], key("_PIXEL_PITCH")[0]
        self.pp, self.k, self.decenter = key("_PP"), key("_OD_K"), key("_DECENTER")
        # Signs of the focal plane against samples and lines.
        self.sign_x = np.sign(key("_TRANSX")[1])
        self.sign_y = np.sign(key("_TRANSY")[2])
        self.size = int(crop["BetaSamples"]), int(crop["BetaLines"])
        self.start = crop["AlphaStartingSample"], crop["AlphaStartingLine"]
        self.step = ((crop["AlphaEndingSample"] - self.start[0]) / self.size[0],
                     (crop["AlphaEndingLine"] - self.start[1]) / self.size[1])
        self.position_m = 1000.0 * np.array(derived["pos_moonfixed_km"])
        # Rows of R are ISIS's camera axes in the Moon-fixed frame; ours are (-x, y, -z).
        r = np.array(derived["R_moonfixed_to_cam"])
        self.world_from_cam = np.stack([self.sign_x * r[0], self.sign_y * r[1], -r[2]], axis=1)
        assert abs(np.linalg.det(self.world_from_cam) - 1) < 1e-9, "the axes are mirrored"

    def measured(self, pixels):
        """Corner-based pixels of the crop -> measured point over the focal length, our axes, from the principal point."""
        scan = np.asarray(self.start) + np.asarray(pixels) * np.asarray(self.step)
        mm = (scan - SCAN / 2) * self.pitch_mm
        return (mm - [self.sign_x * self.pp[0], self.sign_y * self.pp[1]]) / self.focal_mm

    def ideal(self, pixels):
        """Corner-based pixels -> ideal point on the plane z = 1, our axes."""
        x, y = (self.measured(pixels) * self.focal_mm * [self.sign_x, self.sign_y]).T
        rr = x * x + y * y
        k1, k2, k3 = self.k
        j1, j2, t0 = self.decenter
        radial, tangential = 1 + rr * (k1 + rr * (k2 + rr * k3)), j1 * rr + j2 * rr * rr
        ux, uy = x * radial - tangential * np.sin(t0), y * radial + tangential * np.cos(t0)
        return np.stack([self.sign_x * ux, self.sign_y * uy], axis=1) / self.focal_mm

    def k_px(self):
        """fx, fy, cx, cy, pixels, from the corner: of the measured point."""
        f = self.focal_mm / self.pitch_mm
        centre = [SCAN / 2 + s * p / self.pitch_mm for s, p in zip((self.sign_x, self.sign_y), self.pp)]
        return (f / self.step[0], f / self.step[1],
                (centre[0] - self.start[0]) / self.step[0], (centre[1] - self.start[1]) / self.step[1])

    def fit(self):
        """Brown's k1 k2 p1 p2 k3 over the crop, and what it leaves in pixels (rms, worst)."""
        side = np.linspace(0, 1, 41)
        u, v = np.meshgrid(side * self.size[0], side * self.size[1])
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        x, y = self.ideal(pixels).T
        measured = self.measured(pixels)
        r2 = x * x + y * y
        columns_x = [x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3]
        columns_y = [y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3]
        design = np.concatenate([np.stack(columns_x, 1), np.stack(columns_y, 1)])
        target = np.concatenate([measured[:, 0] - x, measured[:, 1] - y])
        scale = np.abs(design).max(0)
        found = np.linalg.lstsq(design / scale, target, rcond=None)[0] / scale
        left = (design @ found - target).reshape(2, -1) * np.array(self.k_px()[:2])[:, None]
        left, without = np.hypot(*left), np.hypot(*(target.reshape(2, -1) * np.array(self.k_px()[:2])[:, None]))
        return found, np.sqrt((left**2).mean()), left.max(), without.max()

    def toml(self):
        fx, fy, cx, cy = self.k_px()
        (k1, k2, p1, p2, k3), rms, worst, without = self.fit()
        rows = ",\n  ".join(
            "[" + ", ".join(repr(float(v)) for v in [*row, p]) + "]" for row, p in zip(self.world_from_cam, self.position_m))
        print(f"{self.name}: lens {without:.3f} px at most; Brown's form leaves rms {rms:.4f} px, worst {worst:.4f} px")
        return (f"# {self.name}, Apollo 15 metric camera, crop of {self.size[0]}x{self.size[1]}; from ISIS labels.\n"
                f"# Distortion fitted over the crop: rms {rms:.4f} px, worst {worst:.4f} px.\n"
                f"width_px = {self.size[0]}\nheight_px = {self.size[1]}\n"
                f"fx_px = {fx!r}\nfy_px = {fy!r}\ncx_px = {cx!r}\ncy_px = {cy!r}\npixel_convention = \"corner\"\n"
                f"distortion = {{ k1 = {k1!r}, k2 = {k2!r}, p1 = {p1!r}, p2 = {p2!r}, k3 = {k3!r} }}\n"
                f"world = \"moon_me\"\nworld_from_cam = [\n  {rows},\n]\n").replace("np.float64(", "").replace(")", "")

    def ground(self, pixels, height_m=0.0):
        """Where the rays of pixels meet the sphere."""
        ideal = self.ideal(pixels)
        d = np.concatenate([ideal, np.ones((len(ideal), 1))], 1) @ self.world_from_cam.T
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        along = d @ self.position_m
        inside = along**2 - self.position_m @ self.position_m + (RADIUS_M + height_m) ** 2
        return self.position_m + d * (-along - np.sqrt(inside))[:, None]

    def project(self, points):
        """Moon-fixed points -> ideal points on the plane z = 1."""
        p = (points - self.position_m) @ self.world_from_cam
        return p[:, :2] / p[:, 2:]


def place(point):
    r = np.linalg.norm(point)
    return np.degrees(np.arcsin(point[2] / r)), np.degrees(np.arctan2(point[1], point[0])) % 360


def read_crop(path):
    data = np.fromfile(path, "<f4", 500 * 500, offset=65536).reshape(500, 500)
    return np.where(np.abs(data) < 3.4e38, data, np.nan)


def check(a, b, cubes, height_m=0.0):
    corners = lambda f: np.array([[0, 0], [f.size[0], 0], [0, f.size[1]], f.size], float)
    middle = lambda f: np.array(f.size, float)[None] / 2
    for f in (a, b):
        lat, lon = place(f.ground(middle(f))[0])
        print(f"{f.name}: centre {lat:.3f} deg, {lon:.3f} deg E; {np.linalg.norm(f.position_m) - RADIUS_M:.0f} m above the sphere; "
              f"tilt {np.degrees(np.arccos(-f.world_from_cam[:, 2] @ f.position_m / np.linalg.norm(f.position_m))):.2f} deg; "
              f"width {np.linalg.norm(np.diff(f.ground(corners(f)[:2]), axis=0)):.0f} m")
    side = (np.arange(100) + 0.5) * 5
    grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    in_b = b.project(a.ground(grid))
    low, high = b.ideal(corners(b)).min(0), b.ideal(corners(b)).max(0)
    print(f"overlap {((in_b > low) & (in_b < high)).all(1).mean():.3f}; baseline "
          f"{np.linalg.norm(a.position_m - b.position_m):.0f} m; over height "
          f"{np.linalg.norm(a.position_m - b.position_m) / (np.linalg.norm(a.position_m) - RADIUS_M):.3f}")
    match(a, b, cubes)


def match(a, b, cubes):
    import cv2

    def grey(f):
        picture = read_crop(cubes / f"{f.name}_crop.cub")
        low, high = np.nanquantile(picture, [0.002, 0.998])
        return (np.nan_to_num(np.clip((picture - low) / (high - low), 0, 1)) * 255).astype(np.uint8)

    sift = cv2.SIFT_create(6000, contrastThreshold=0.01)
    (ka, da), (kb, db) = (sift.detectAndCompute(grey(f), None) for f in (a, b))
    pairs = [m for m, n in cv2.BFMatcher().knnMatch(da, db, 2) if m.distance < 0.75 * n.distance]
    # OpenCV counts from the first pixel's centre.
    pa = np.array([ka[m.queryIdx].pt for m in pairs]) + 0.5
    pb = np.array([kb[m.trainIdx].pt for m in pairs]) + 0.5
    xa, xb = (np.concatenate([f.ideal(p), np.ones((len(p), 1))], 1) for f, p in ((a, pa), (b, pb)))
    r = b.world_from_cam.T @ a.world_from_cam
    t = b.world_from_cam.T @ (a.position_m - b.position_m)
    tx = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    lines = xa @ (tx @ r).T
    # Signed distance from the epipolar line in B, on z = 1, times the focal length.
    away = (lines * xb).sum(1) / np.hypot(lines[:, 0], lines[:, 1]) * b.k_px()[0]
    # Strays by a homography of generous tolerance: it knows nothing of the cameras.
    _, near = cv2.findHomography(pa, pb, cv2.RANSAC, 15.0)
    kept = away[near.ravel() > 0]
    print(f"{len(pairs)} matches, {len(kept)} near a homography; from their epipolar lines: median {np.median(kept):+.3f} px, "
          f"median absolute {np.median(np.abs(kept)):.3f}, about the median {np.median(np.abs(kept - np.median(kept))):.3f}, "
          f"90% {np.quantile(np.abs(kept), 0.9):.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("labels", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--check", type=Path, metavar="CUBES")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    frames = {name: Frame(name, label) for name, label in json.loads(args.labels.read_text()).items()}
    for name, frame in frames.items():
        (args.out / f"{name}.toml").write_text(frame.toml())
    if args.check:
        there = [f for f in frames.values() if (args.check / f"{f.name}_crop.cub").is_file()]
        for a, b in zip(there, there[1:]):
            check(a, b, args.check)


if __name__ == "__main__":
    main()
