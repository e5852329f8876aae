#!/usr/bin/env python3
"""Checks the GeoTIFFs of `cargo run -p selenograph-raster --example write_cogs -- DIR` with rasterio (GDAL) and rio-cogeo.

usage: check_cog.py DIR        (pip install numpy rasterio rio-cogeo)

Values, transform, coordinate system, overviews, no-data, names of bands and classes, colours; the COG rules by `rio cogeo`; and the margins of every tile
(its size before it, its last four bytes again behind it), which GDAL's own validator looks at too.
"""
import ctypes
import struct
import sys
from pathlib import Path

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.warp import transform
from rio_cogeo.cogeo import cog_validate

W, H, R = 1500, 1100, 1737400.0


def truth():
    x, y = np.meshgrid(np.arange(W), np.arange(H))
    h = ((x * 7 + y * 13) % 5000).astype(np.float32) * np.float32(0.25) - np.float32(600)
    h[(x + 31 * y) % 97 == 0] = np.nan
    return h


def halved(a):
    """Means of what is there in blocks of 2 x 2, in double, rounded to f32."""
    h, w = a.shape
    a = np.pad(a, ((0, h % 2), (0, w % 2)), constant_values=np.nan).astype(np.float64)
    blocks = np.stack([a[0::2, 0::2], a[0::2, 1::2], a[1::2, 0::2], a[1::2, 1::2]])
    there = ~np.isnan(blocks)
    with np.errstate(invalid="ignore"):
        return (np.where(there, blocks, 0).sum(0) / there.sum(0)).astype(np.float32)


def directories(data):
    """Tile offsets and sizes of each directory of a classic TIFF."""
    place, found = struct.unpack_from("<I", data, 4)[0], []
    while place:
        count = struct.unpack_from("<H", data, place)[0]
        tags = {}
        for i in range(count):
            tag, kind, number, value = struct.unpack_from("<HHII", data, place + 2 + 12 * i)
            if tag in (324, 325):
                assert kind == 4
                at = value if number > 1 else place + 2 + 12 * i + 8
                tags[tag] = struct.unpack_from(f"<{number}I", data, at)
        found.append((tags[324], tags[325]))
        place = struct.unpack_from("<I", data, place + 2 + 12 * count)[0]
    return found


def check_margins(path):
    data = path.read_bytes()
    previous = len(data) + 1
    for offsets, sizes in directories(data):
        assert list(offsets) == sorted(offsets), "tiles are not in row order"
        for offset, size in zip(offsets, sizes):
            assert struct.unpack_from("<I", data, offset - 4)[0] == size, "leader"
            assert data[offset + size : offset + size + 4] == data[offset + size - 4 : offset + size], "trailer"
        assert offsets[-1] < previous, "smaller levels lie before larger ones"
        previous = offsets[0]


def check_same_map(found, crs, affine):
    """Both systems give the same longitudes and latitudes: GDAL spells one map in several ways (k = 1, lat_ts = -90)."""
    assert found is not None
    moon = CRS.from_string(f"+proj=longlat +R={R:.0f} +no_defs")
    xs, ys = zip(*(affine * at for at in [(0, 0), (W, 0), (0, H), (W / 3, H / 7)]))
    ours, theirs = transform(found, moon, xs, ys), transform(CRS.from_user_input(crs), moon, xs, ys)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12, err_msg=f"{found.to_wkt()} against {crs}")


def check(path, crs, affine, bands, nodata, levels=None):
    valid, errors, warnings = cog_validate(str(path), strict=True, quiet=True)
    assert valid and not errors and not warnings, (path.name, errors, warnings)
    check_margins(path)
    with rasterio.open(path) as f:
        assert (f.width, f.height, f.count) == (W, H, len(bands)), f.profile
        assert f.transform.almost_equals(rasterio.Affine(*affine), 1e-9), f.transform
        assert f.overviews(1) == (levels or [2, 4]), f.overviews(1)
        assert f.descriptions == tuple(name for name, _, _ in bands), f.descriptions
        found = f.nodata
        assert (np.isnan(found) and np.isnan(nodata)) or found == nodata, found
        if crs is not None:
            check_same_map(f.crs, crs, f.transform)
        for i, (_, unit, expected) in enumerate(bands, 1):
            assert (f.units[i - 1] or "") == unit, f.units
            stored = np.where(np.isnan(expected), nodata, expected).astype(f.dtypes[i - 1])
            np.testing.assert_array_equal(f.read(i), stored)
        print(f"{path.name}: {path.stat().st_size} bytes, {f.crs.to_wkt()[:76] if f.crs else None}")


def check_overviews(path, expected):
    """`expected` is the full size; each overview halves the one before."""
    for level in range(2):
        expected = halved(expected)
        with rasterio.open(path, overview_level=level) as f:
            np.testing.assert_array_equal(f.read(1), expected)


def category_names(path):
    """As GDAL tells them to QGIS; rasterio has no call for it, but comes with GDAL's library."""
    folders = [Path(rasterio.__file__).parent.parent / "rasterio.libs", Path(rasterio.__file__).parent]
    gdal = ctypes.CDLL(str(next(f for folder in folders for f in folder.glob("libgdal*"))))
    for name in ("GDALOpen", "GDALGetRasterBand"):
        getattr(gdal, name).restype = ctypes.c_void_p
    gdal.GDALGetRasterCategoryNames.restype = ctypes.POINTER(ctypes.c_char_p)
    gdal.GDALAllRegister()
    dataset = gdal.GDALOpen(str(path).encode(), 0)
    band = gdal.GDALGetRasterBand(ctypes.c_void_p(dataset), 1)
    # GDAL reads the file beside a GeoTIFF only when it is asked for metadata, as everybody does.
    gdal.GDALGetMetadata(ctypes.c_void_p(band), None)
    names, found = gdal.GDALGetRasterCategoryNames(ctypes.c_void_p(band)), []
    while names and names[len(found)] is not None:
        found.append(names[len(found)].decode())
    return found


def check_classes(path, classes):
    """Colours in every level, names in the file itself and in the one beside it."""
    for level in (None, 0, 1):
        with rasterio.open(path, **({} if level is None else {"overview_level": level})) as f:
            assert f.colorinterp[0].name == "palette", f.colorinterp
            colours = f.colormap(1)
            for number, (_, colour) in classes.items():
                assert colours[number][:3] == colour, (level, number, colours[number])
    with rasterio.open(path) as f:
        tags = f.tags(1)
    names = category_names(path)
    for number, (name, _) in classes.items():
        assert tags[f"CLASS_{number}"] == name and names[number] == name, (tags, names)


def main():
    folder = Path(sys.argv[1])
    h = truth()
    height = [("height", "m", h)]
    south = (5.0, 0, 22010.0, 0, -5.0, -12010.0)
    check(folder / "south.tif", "IAU_2015:30135", south, height, np.nan)
    check_overviews(folder / "south.tif", h)
    check(folder / "north.tif", "IAU_2015:30130", (5, 0, -4000, 0, -5, 3000), height, np.nan)
    check(folder / "equirectangular.tif", "IAU_2015:30110", (10, 0, 90000, 0, -10, 790000), height, np.nan)
    check(folder / "geographic.tif", "IAU_2015:30100", (0.001, 0, 3, 0, -0.001, 27), height, np.nan)
    ortho = f"+proj=ortho +lat_0=23.7 +lon_0=-47.4 +R={R:.0f} +units=m +no_defs"
    check(folder / "orthographic.tif", ortho, (10, 0, -7500, 0, -10, 5500), height, np.nan)
    for name in ("local", "local_unscaled"):
        check(folder / f"{name}.tif", None, (1, 0, -750, 0, -1, 550), height, np.nan)
        with rasterio.open(folder / f"{name}.tif") as f:
            assert f.crs is not None and "Selenograph local grid" in f.crs.to_wkt(), f.crs
    classes = np.where(np.isnan(h), 255.0, np.floor(np.abs(h)) % 4)
    check(folder / "classes.tif", None, south, [("hazard", "", classes)], 255)
    meanings = {0: ("flat", (0, 158, 115)), 1: ("steep", (213, 94, 0)), 2: ("a & b", (240, 228, 66))}
    check_classes(folder / "classes.tif", meanings)
    two = [("height", "m", h), ("sigma", "m", h * np.float32(0.5))]
    check(folder / "two_bands.tif", None, south, two, -32768, [2, 4, 8])
    print("all as it should be")


if __name__ == "__main__":
    main()
