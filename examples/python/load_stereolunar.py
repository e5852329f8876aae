#!/usr/bin/env python3
"""Loads StereoLunar triplets the way the paper's own loader does, and checks that they agree.

    python load_stereolunar.py ROOT [SPLIT.npz]

ROOT holds scene folders with im_NNNNN.jpg, .exr (channel Y, z-depth in metres) and .npz (`intrinsics`, `cam2world`);
SPLIT.npz (default ROOT/all.npz) holds `scenes`, `images` and `pairs`, rows of (scene, image 1, image 2, score).

What the paper's loader does with them, and this script too:
  * depth that is not finite or not positive becomes 0 (absent);
  * depth above the 98th percentile of the picture's valid depth becomes 0;
  * points are X = (u - cx) z / f with whole pixel numbers u, so cx has to be measured from the first pixel's centre;
  * cam2world carries them to the Moon-fixed frame (X right, Y down, Z forward in the camera).

The check carries the points of picture 1 into picture 2 and compares them with the depth there. Exit code 0: all
pairs agree; 1: one does not, or a file is missing or wrong. Needs numpy, OpenEXR and Pillow.
"""

import argparse
import pathlib
import sys

import numpy as np
import OpenEXR
from PIL import Image

# Median relative depth difference that still counts as agreement. Float depth reaches 1e-4 on rough ground seen
# obliquely, half-float depth 2e-4; a pose or a depth of another picture gives 5e-3 and more.
MAX_MEDIAN_RELATIVE_ERROR = 1e-3
# Fewer shared pixels than this prove nothing.
MIN_SHARED_PIXELS = 200
FAR_PERCENTILE = 98


def read_depth(path):
    """The channel Y as float32, absent depth as 0, the farthest 2 % dropped."""
    with OpenEXR.File(str(path)) as file:
        depth = np.array(file.channels()["Y"].pixels, dtype=np.float32)
    depth[~np.isfinite(depth)] = 0
    depth[depth <= 0] = 0
    valid = depth > 0
    if not valid.any():
        raise ValueError(f"{path}: no pixel has depth")
    depth[depth > np.percentile(depth[valid], FAR_PERCENTILE)] = 0
    return depth


def read_view(root, scene, stem):
    """Picture, depth, camera matrix and pose of one image."""
    folder = pathlib.Path(root) / scene
    image = np.asarray(Image.open(folder / f"{stem}.jpg"))
    depth = read_depth(folder / f"{stem}.exr")
    with np.load(folder / f"{stem}.npz") as camera:
        k = np.asarray(camera["intrinsics"], dtype=np.float64)
        cam2world = np.asarray(camera["cam2world"], dtype=np.float64)
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"{stem}.jpg: expected three channels, found shape {image.shape}")
    if image.shape[:2] != depth.shape:
        raise ValueError(f"{stem}: the picture is {image.shape[:2]}, its depth {depth.shape}")
    if k.shape != (3, 3) or cam2world.shape != (4, 4):
        raise ValueError(f"{stem}.npz: intrinsics {k.shape}, cam2world {cam2world.shape}")
    rotation = cam2world[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5) or np.linalg.det(rotation) < 0:
        raise ValueError(f"{stem}.npz: cam2world is no rigid motion")
    return {"image": image, "depth": depth, "k": k, "cam2world": cam2world}


def points_in_world(view):
    """H x W x 3 points by whole pixel numbers, and which of them are valid."""
    depth, k = view["depth"].astype(np.float64), view["k"]
    v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    in_cam = np.stack([(u - k[0, 2]) * depth / k[0, 0], (v - k[1, 2]) * depth / k[1, 1], depth], axis=-1)
    rotation, position = view["cam2world"][:3, :3], view["cam2world"][:3, 3]
    return in_cam @ rotation.T + position, view["depth"] > 0


def bilinear(depth, u, v):
    """Depth at whole-number-centred positions; NaN outside and beside absent depth."""
    height, width = depth.shape
    inside = (u >= 0) & (v >= 0) & (u < width - 1) & (v < height - 1)
    u0 = np.where(inside, np.floor(u), 0).astype(int)
    v0 = np.where(inside, np.floor(v), 0).astype(int)
    fu, fv = u - u0, v - v0
    corners = [depth[v0 + dv, u0 + du].astype(np.float64) for dv in (0, 1) for du in (0, 1)]
    value = (corners[0] * (1 - fu) + corners[1] * fu) * (1 - fv) + (corners[2] * (1 - fu) + corners[3] * fu) * fv
    whole = inside & np.logical_and.reduce([corner > 0 for corner in corners])
    return np.where(whole, value, np.nan)


def relative_errors(view1, view2):
    """(carried depth - depth there) / carried depth for the pixels of view 1 that fall on depth of view 2."""
    points, valid = points_in_world(view1)
    rotation, position = view2["cam2world"][:3, :3], view2["cam2world"][:3, 3]
    in_cam = (points[valid] - position) @ rotation
    in_cam = in_cam[in_cam[:, 2] > 0]
    k = view2["k"]
    u = k[0, 0] * in_cam[:, 0] / in_cam[:, 2] + k[0, 2]
    v = k[1, 1] * in_cam[:, 1] / in_cam[:, 2] + k[1, 2]
    error = (in_cam[:, 2] - bilinear(view2["depth"], u, v)) / in_cam[:, 2]
    return np.abs(error[np.isfinite(error)])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("split", type=pathlib.Path, nargs="?")
    parser.add_argument("--max-pairs", type=int, default=None, help="look at the first N rows only")
    arguments = parser.parse_args()
    # The public split files hold pickled object arrays; ours are plain, and both load this way.
    with np.load(arguments.split or arguments.root / "all.npz", allow_pickle=True) as split:
        scenes, images, pairs = split["scenes"], split["images"], split["pairs"]
    worst, num_compared, num_apart, medians = 0.0, 0, 0, []
    for scene_id, im1_id, im2_id, _score in pairs[: arguments.max_pairs]:
        scene, stems = str(scenes[int(scene_id)]), [str(images[int(i)]) for i in (im1_id, im2_id)]
        view1, view2 = (read_view(arguments.root, scene, stem) for stem in stems)
        errors = np.concatenate([relative_errors(view1, view2), relative_errors(view2, view1)])
        if errors.size < MIN_SHARED_PIXELS:
            num_apart += 1
            continue
        medians.append(float(np.median(errors)))
        num_compared += errors.size
        worst = max(worst, medians[-1])
        if medians[-1] > MAX_MEDIAN_RELATIVE_ERROR:
            raise ValueError(f"{scene}/{stems[0]} and {stems[1]} disagree: median relative error {medians[-1]:.1e}")
    if not medians:
        raise ValueError("no pair shares ground: nothing was compared")
    print(
        f"{len(medians)} pairs agree ({num_apart} share no ground): median relative error "
        f"{np.median(medians):.2e}, worst {worst:.2e}, {num_compared} pixels"
    )


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError, KeyError, IndexError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
