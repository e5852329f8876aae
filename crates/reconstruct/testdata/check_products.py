"""Reads a folder of products with programs that share no code with ours, and compares the files with each other.

    pip install numpy plyfile laspy pygltflib rasterio
    python check_products.py FOLDER

Checked: every format opens; all three clouds hold the same points (LAS to half its scale, PLY and GLB exactly) with the same
colours, confidences, sigmas and views; LAS header bounds hold all points and its coordinate system parses; rasters share one size,
transform and coordinate system, NaN or 0 where absent; slope.tif is Horn's slope of dem.tif; the cloud lies on the DEM.
"""

import json
import sys
from pathlib import Path

import laspy
import numpy as np
import pygltflib
import rasterio
import rasterio.warp
from plyfile import PlyData

folder = Path(sys.argv[1])
summary = json.loads((folder / "products.json").read_text())

ply = PlyData.read(folder / "cloud.ply")
v = ply["vertex"].data
origin = next(np.array(c.split()[1:4], float) for c in ply.comments if c.startswith("origin"))
ply_xyz = np.stack([v["x"], v["y"], v["z"]], -1).astype(float)
assert len(v) == summary["num_points"]

las = laspy.read(folder / "cloud.las")
assert (las.header.version.major, las.header.version.minor, las.header.point_format.id) == (1, 4, 7)
las_xyz = np.stack([las.x, las.y, las.z], -1)
assert np.abs(las_xyz - (ply_xyz + origin)).max() <= 0.51 * las.header.scales.max() + 1e-9
assert (las_xyz.max(0) <= las.header.maxs + 1e-9).all() and (las_xyz.min(0) >= las.header.mins - 1e-9).all()
assert (np.asarray(las.red) == v["red"].astype(int) * 257).all()
assert (np.asarray(las.point_source_id) == v["view"] + 1).all()
assert (np.asarray(las.synthetic) == (v["fill"] == 2)).all()
assert (np.asarray(las["confidence"]) == v["confidence"]).all()
assert np.array_equal(np.asarray(las["sigma"]), v["sigma"], equal_nan=True)

glb = pygltflib.GLTF2().load(str(folder / "cloud.glb"))
blob = np.frombuffer(glb.binary_blob(), np.uint8).reshape(len(v), glb.bufferViews[0].byteStride)
g = np.ascontiguousarray(blob[:, :12]).view("<f4")
assert np.array_equal(np.stack([g[:, 0], -g[:, 2], g[:, 1]], -1), ply_xyz.astype(np.float32))
assert (blob[:, 12] == v["red"]).all() and glb.meshes[0].primitives[0].mode == 0
assert glb.accessors[0].min == g.min(0).tolist() and glb.accessors[0].max == g.max(0).tolist()
assert np.allclose(glb.asset.extras["origin_x_y_height"], origin)

rasters = {}
for name in ["dem", "dem_sigma", "slope", "hillshade", "hazard"]:
    with rasterio.open(folder / f"{name}.tif") as file:
        rasters[name] = file.read(1)
        place = (file.width, file.height, file.transform, file.crs.to_wkt())
        shared = rasters.setdefault("place", place)
        assert place == shared, name
        assert (file.nodata == 0) if name == "hazard" else np.isnan(file.nodata), name
dem = rasters["dem"].astype(float)
transform, crs_wkt = rasters["place"][2], rasters["place"][3]
assert (np.isnan(dem) == (rasters["hazard"] == 0)).all()
if summary["crs"]:
    proj = rasterio.crs.CRS.from_string(summary["crs"])
    las_wkt = next(r.string for r in las.header.vlrs if r.record_id == 2112)
    left, lower, right, upper = summary["extent"]
    xs, ys = [left, right, left], [lower, upper, upper]
    # Names differ; what counts is that every place has the same coordinates.
    for text in [las_wkt, crs_wkt]:
        back = rasterio.warp.transform(rasterio.crs.CRS.from_wkt(text), proj, xs, ys)
        assert np.abs(np.array(back) - [xs, ys]).max() < 1e-6, text

cell = transform.a
n, s = dem[:-2], dem[2:]
east = (n[:, 2:] + 2 * dem[1:-1, 2:] + s[:, 2:] - n[:, :-2] - 2 * dem[1:-1, :-2] - s[:, :-2]) / (8 * cell)
north = (n[:, :-2] + 2 * n[:, 1:-1] + n[:, 2:] - s[:, :-2] - 2 * s[:, 1:-1] - s[:, 2:]) / (8 * cell)
slope = np.degrees(np.arctan(np.hypot(east, north)))
difference = np.nanmax(np.abs(slope - rasters["slope"][1:-1, 1:-1]))
# A map's scale differs from 1 by less than a thousandth over such scenes.
assert difference < 0.05, difference

column = np.floor((las_xyz[:, 0] - transform.c) / cell).astype(int)
row = np.floor((las_xyz[:, 1] - transform.f) / transform.e).astype(int)
inside = (column >= 0) & (row >= 0) & (column < dem.shape[1]) & (row < dem.shape[0])
off = las_xyz[inside, 2] - dem[row[inside], column[inside]]
print(f"{len(v)} points, LAS scale {las.header.scales[0]:g}, slope differs by at most {difference:.4f} deg")
print(f"cloud over DEM: median {np.nanmedian(off):.4f}, median deviation {np.nanmedian(np.abs(off)):.4f}, cell {cell:g}")
print("all checks passed")
