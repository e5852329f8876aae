"""Time and error of PoseLib and OpenCV on the scenes that the example `pose_bench` writes; one thread.

    pip install numpy poselib opencv-python-headless
    python compare.py scenes.jsonl
"""

import json
import sys
import time

import cv2
import numpy as np
import poselib

FOCAL = 618.0
CAMERA = {"model": "SIMPLE_PINHOLE", "width": 512, "height": 512, "params": [FOCAL, 0.0, 0.0]}
cv2.setNumThreads(1)


def angle_deg(r):
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return np.degrees(np.arctan2(np.linalg.norm(v), np.trace(r) - 1))


def direction_deg(t, u):
    t, u = np.ravel(t), np.ravel(u)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(t, u)), t @ u))


def by_poselib(p, q):
    pose, _ = poselib.estimate_relative_pose(p, q, CAMERA, CAMERA, {"max_epipolar_error": 1.0, "success_prob": 0.9999}, {})
    return pose.R, pose.t


def by_opencv(method):
    def run(p, q):
        e, mask = cv2.findEssentialMat(p, q, FOCAL, (0.0, 0.0), method, 0.9999, 1.0)
        _, r, t, _ = cv2.recoverPose(e[:3], p, q, focal=FOCAL, pp=(0.0, 0.0), mask=mask)
        return r, t

    return run


METHODS = {"PoseLib": by_poselib, "OpenCV RANSAC": by_opencv(cv2.RANSAC), "OpenCV MAGSAC": by_opencv(cv2.USAC_MAGSAC)}

rows = {}
for line in open(sys.argv[1]):
    scene = json.loads(line)
    m = np.array(scene["matches"]) * FOCAL
    r, t = np.array(scene["rotation"]).reshape(3, 3), np.array(scene["translation"])
    for name, method in METHODS.items():
        p, q = np.ascontiguousarray(m[:, :2]), np.ascontiguousarray(m[:, 2:])
        ms = np.inf
        try:
            # The shortest of several runs: what the machine does besides only adds.
            for _ in range(5):
                start = time.perf_counter()
                found, direction = method(p, q)
                ms = min(ms, (time.perf_counter() - start) * 1e3)
        except (cv2.error, TypeError):
            continue
        rows.setdefault((scene["case"], name), []).append((ms, angle_deg(found @ r.T), direction_deg(direction, t)))
for (case, name), values in rows.items():
    v = np.array(values)
    print(f"{case:15} {name:14} {np.median(v[:, 0]):7.2f} ms  rotation {np.median(v[:, 1]):.4f}  direction {np.median(v[:, 2]):.4f}"
          f" (90 % {np.quantile(v[:, 2], 0.9):.3f}, worst {v[:, 2].max():.3f})  n {len(v)}")
