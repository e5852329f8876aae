//! Elevation models from files: GeoTIFF, PDS3 and PDS4 in, heights in metres out, row by row.
