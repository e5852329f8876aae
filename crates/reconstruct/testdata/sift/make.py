"""Makes a.png, b.png and opencv.json: what OpenCV's SIFT finds in two synthetic pictures (pip install opencv-python-headless numpy).

Written with OpenCV 5.0.0. b.png shows a.png turned by 35 degrees and scaled by 0.85; `b_from_a` maps centre-based pixels.
"""

import json
from pathlib import Path

import cv2
import numpy as np

SIDE = 256
here = Path(__file__).parent
rng = np.random.default_rng(4)

# Fractal ground with craters, lit from the left.
height = np.zeros((SIDE, SIDE))
for octave in range(2, 8):
    noise = rng.standard_normal((2**octave, 2**octave))
    height += cv2.resize(noise, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC) * 12.0 / 2**octave
y, x = np.mgrid[0:SIDE, 0:SIDE].astype(float)
for _ in range(90):
    cx, cy, r = rng.uniform(0, SIDE), rng.uniform(0, SIDE), rng.pareto(2.0) * 3 + 3
    d = np.hypot(x - cx, y - cy) / min(r, 30)
    height += min(r, 30) * np.where(d < 1, 0.35 * (d**2 - 1), 0) + min(r, 30) * 0.08 * np.exp(-((d - 1) ** 2) / 0.05)
shade = cv2.GaussianBlur(np.gradient(height, axis=1), (0, 0), 0.7)
low, high = np.quantile(shade, [0.005, 0.995])
a = np.clip((shade - low) / (high - low) * 255, 0, 255).round().astype(np.uint8)

centre = (SIDE - 1) / 2
b_from_a = cv2.getRotationMatrix2D((centre, centre), 35, 0.85)
b = cv2.warpAffine(a, b_from_a, (SIDE, SIDE), flags=cv2.INTER_CUBIC)
cv2.imwrite(str(here / "a.png"), a)
cv2.imwrite(str(here / "b.png"), b)

# The default places keypoints a quarter of a pixel off.
sift = cv2.SIFT_create(enable_precise_upscale=True)
(points_a, features_a), (points_b, features_b) = (sift.detectAndCompute(picture, None) for picture in (a, b))
xa, xb = (np.array([p.pt for p in points]) for points in (points_a, points_b))
mapped = xa @ b_from_a[:, :2].T + b_from_a[:, 2]
inside = (mapped.min(axis=1) > 10) & (mapped.max(axis=1) < SIDE - 11)
nearest = np.sqrt(((mapped[:, None] - xb[None]) ** 2).sum(axis=2)).min(axis=1)
pairs = [m for m, n in cv2.BFMatcher(cv2.NORM_L2).knnMatch(features_a, features_b, k=2) if m.distance < 0.8 * n.distance]
error = np.array([np.hypot(*(mapped[m.queryIdx] - xb[m.trainIdx])) for m in pairs])
strongest = sorted(points_a, key=lambda p: -p.response)[:60]
with open(here / "opencv.json", "w") as file:
    json.dump(
        {
            "opencv": cv2.__version__,
            "b_from_a": b_from_a.tolist(),
            "num_a": len(points_a),
            "num_b": len(points_b),
            "repeatability": float((nearest[inside] < 1.5).mean()),
            "num_matches": len(pairs),
            "num_correct": int((error < 1.5).sum()),
            "median_error_px": float(np.median(error[error < 1.5])),
            # Centre-based x, y and the diameter that OpenCV calls size (twice the standard deviation).
            "strongest": [[round(v, 3) for v in (*p.pt, p.size)] for p in strongest],
        },
        file,
    )
    file.write("\n")
