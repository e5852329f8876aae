"""Reads a COLMAP model with pycolmap, and nerfstudio's transforms.json by its documented convention, and compares them.

    pip install pycolmap numpy
    python check_scene.py MODEL_FOLDER NERFSTUDIO_FOLDER

Checked: text and binary files hold the same; every observation leads to the point whose track leads to it; every point projects onto
where it was seen, by COLMAP's own cameras, to what the model says of its error; nerfstudio's frames (OpenGL axes, pixels from the
corner) project the same points to the same pixels; the pictures are where nerfstudio's file says.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pycolmap

model, nerfstudio = Path(sys.argv[1]), Path(sys.argv[2])
text, binary = pycolmap.Reconstruction(), pycolmap.Reconstruction()
text.read_text(str(model))
binary.read_binary(str(model))
assert text.num_images() == binary.num_images() and text.num_points3D() == binary.num_points3D() > 0
frames = {Path(f["file_path"]).name: f for f in json.loads((nerfstudio / "transforms.json").read_text())["frames"]}
assert len(frames) == text.num_images()

worst_nerf, worst_error = 0.0, 0.0
for point_id, point in binary.points3D.items():
    other = text.points3D[point_id]
    assert (point.xyz == other.xyz).all() and (point.color == other.color).all() and point.error == other.error
    assert point.track.length() == other.track.length() >= 2
    errors = []
    for element in point.track.elements:
        image = binary.images[element.image_id]
        observation = image.points2D[element.point2D_idx]
        assert observation.point3D_id == point_id
        errors.append(np.linalg.norm(image.project_point(point.xyz) - observation.xy))

        frame = frames[Path(image.name).name]
        camera_to_world = np.array(frame["transform_matrix"])
        x, y, z = camera_to_world[:3, :3].T @ (point.xyz - camera_to_world[:3, 3])
        u, v = x / -z, -y / -z
        r2 = u * u + v * v
        radial = 1 + r2 * (frame["k1"] + r2 * (frame["k2"] + r2 * frame["k3"]))
        p1, p2 = frame["p1"], frame["p2"]
        seen = [
            frame["fl_x"] * (u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)) + frame["cx"],
            frame["fl_y"] * (v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v) + frame["cy"],
        ]
        worst_nerf = max(worst_nerf, float(np.linalg.norm(image.project_point(point.xyz) - seen)))
    worst_error = max(worst_error, abs(float(np.mean(errors)) - point.error))

for image_id, image in binary.images.items():
    other = text.images[image_id]
    assert image.name == other.name and image.camera.params_to_string() == other.camera.params_to_string()
    assert (image.cam_from_world().matrix() == other.cam_from_world().matrix()).all()
    assert (image.camera.width, image.camera.height) == (frames[Path(image.name).name]["w"], frames[Path(image.name).name]["h"])
for frame in frames.values():
    assert (nerfstudio / frame["file_path"]).is_file(), frame["file_path"]
assert worst_error < 1e-4, worst_error
assert worst_nerf < 1e-6, worst_nerf
print(f"{text.num_images()} images, {text.num_points3D()} points; errors told to {worst_error:.1e} px, nerfstudio to {worst_nerf:.1e} px")
print("all checks passed")
