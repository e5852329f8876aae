"""Relative pose of one pair by OpenCV: SIFT, brute-force matching with Lowe's ratio, essential matrix, recoverPose.

pose_bench.py A.png B.png FOV_DEG ROUNDS THREADS
"""

import math
import sys
import time

import cv2
import numpy as np

a, b = (cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in sys.argv[1:3])
fov, rounds, threads = float(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
cv2.setNumThreads(threads)
height, width = a.shape
focal = width / (2 * math.tan(math.radians(fov) / 2))
# OpenCV measures from the first pixel's centre.
k = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
for _ in range(rounds):
    start = time.perf_counter()
    sift = cv2.SIFT_create()
    (points_a, features_a), (points_b, features_b) = (sift.detectAndCompute(picture, None) for picture in (a, b))
    described = time.perf_counter()
    pairs = [m for m, n in cv2.BFMatcher(cv2.NORM_L2).knnMatch(features_a, features_b, k=2) if m.distance < 0.8 * n.distance]
    matched = time.perf_counter()
    xa = np.array([points_a[m.queryIdx].pt for m in pairs])
    xb = np.array([points_b[m.trainIdx].pt for m in pairs])
    essential, mask = cv2.findEssentialMat(xa, xb, k, method=cv2.RANSAC, prob=0.9999, threshold=1.0)
    cv2.recoverPose(essential, xa, xb, k, mask=mask)
    end = time.perf_counter()
    print(
        f"opencv wall_ms={1e3 * (end - start):.2f} features_ms={1e3 * (described - start):.2f} "
        f"matching_ms={1e3 * (matched - described):.2f} estimate_ms={1e3 * (end - matched):.2f} "
        f"features={len(points_a)},{len(points_b)} inliers={int((mask > 0).sum())}"
    )
