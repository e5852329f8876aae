//! Coordinate system → GeoKeys and transform tags.

use crate::Affine;
use crate::tiff::encode::Tag;
use crate::tiff::tags::*;
use selenograph_geometry::proj_string::Crs;
use selenograph_geometry::{Pole, Projection};

/// The transform and the GeoKeys of a map on a sphere, all user-defined, as GDAL writes them.
pub(super) fn geo_tags(crs: &Crs, map_from_pixel: &Affine) -> Vec<Tag> {
    let mut tags = transform_tags(map_from_pixel);
    let (model, transform, numbers) = projection_keys(&crs.projection);
    let name = format!("{} {}|", crs.body.name, crs.projection.name());
    let datum = format!("GCS Name = {0}|Datum = {0} sphere|Ellipsoid = {0} sphere|", crs.body.name);
    let mut codes: Vec<(u16, u16)> =
        vec![(1024, model), (1025, 1), (2048, 32767), (2050, 32767), (2054, 9102), (2056, 32767)];
    if let Some(transform) = transform {
        codes.extend([(3072, 32767), (3074, 32767), (3075, transform), (3076, 9001)]);
    }
    let radius = crs.projection.radius_m().unwrap_or(crs.body.radius_m);
    let mut doubles = vec![(2057, radius), (2058, radius), (2061, 0.0)];
    doubles.extend(numbers);

    let mut entries: Vec<[u16; 4]> = codes.into_iter().map(|(key, code)| [key, 0, 1, code]).collect();
    entries.push([1026, GEO_ASCII_PARAMS, name.len() as u16, 0]);
    entries.push([2049, GEO_ASCII_PARAMS, datum.len() as u16, name.len() as u16]);
    entries.extend(doubles.iter().enumerate().map(|(i, (key, _))| [*key, GEO_DOUBLE_PARAMS, 1, i as u16]));
    entries.sort_unstable();
    let mut directory = vec![1, 1, 0, entries.len() as u16];
    directory.extend(entries.into_iter().flatten());
    let values: Vec<f64> = doubles.into_iter().map(|(_, value)| value).collect();
    tags.push(Tag::shorts(GEO_KEY_DIRECTORY, &directory));
    tags.push(Tag::doubles(GEO_DOUBLE_PARAMS, &values));
    tags.push(Tag::text(GEO_ASCII_PARAMS, &format!("{name}{datum}")));
    tags
}

/// The transform of pixels (from the corner) into map units.
fn transform_tags(map_from_pixel: &Affine) -> Vec<Tag> {
    let [x0, a1, a2, y0, a4, a5] = map_from_pixel.coefficients;
    if a2 == 0.0 && a4 == 0.0 && a5 < 0.0 && a1 > 0.0 {
        vec![
            Tag::doubles(MODEL_PIXEL_SCALE, &[a1, -a5, 0.0]),
            Tag::doubles(MODEL_TIEPOINT, &[0.0, 0.0, 0.0, x0, y0, 0.0]),
        ]
    } else {
        let matrix = [a1, a2, 0.0, x0, a4, a5, 0.0, y0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        vec![Tag::doubles(MODEL_TRANSFORMATION, &matrix)]
    }
}

/// The transform and the GeoKeys of a grid that lies nowhere on a body: an engineering system with a name.
///
/// `metric` says whether a unit of the grid is a metre; else the unit stays undefined.
pub(super) fn local_tags(name: &str, metric: bool, local_from_pixel: &Affine) -> Vec<Tag> {
    let mut tags = transform_tags(local_from_pixel);
    // GeoKeys are ASCII, and a bar ends a text.
    let name: String = name.chars().map(|c| if c.is_ascii_graphic() && c != '|' { c } else { ' ' }).collect();
    let name = format!("{name}|");
    let unit = if metric { 9001 } else { 32767 };
    let directory = [
        1,
        1,
        0,
        4,
        1024,
        0,
        1,
        32767,
        1025,
        0,
        1,
        1,
        1026,
        GEO_ASCII_PARAMS,
        name.len() as u16,
        0,
        3076,
        0,
        1,
        unit,
    ];
    tags.push(Tag::shorts(GEO_KEY_DIRECTORY, &directory));
    tags.push(Tag::text(GEO_ASCII_PARAMS, &name));
    tags
}

/// Model type, coordinate transformation, and the numbers by key.
fn projection_keys(projection: &Projection) -> (u16, Option<u16>, Vec<(u16, f64)>) {
    let offsets = |x: f64, y: f64| [(3082, x), (3083, y)];
    match *projection {
        Projection::PolarStereographic { pole, lon0_rad, k0, false_easting_m, false_northing_m, .. } => {
            let lat = if pole == Pole::North { 90.0 } else { -90.0 };
            let mut numbers = vec![(3081, lat), (3095, lon0_rad.to_degrees()), (3092, k0)];
            numbers.extend(offsets(false_easting_m, false_northing_m));
            (1, Some(15), numbers)
        }
        Projection::Equirectangular {
            lat_ts_rad,
            lat0_rad,
            lon0_rad,
            false_easting_m,
            false_northing_m,
            ..
        } => {
            let lat_ts = lat_ts_rad.to_degrees();
            let mut numbers =
                vec![(3078, lat_ts), (3089, lat0_rad.to_degrees()), (3088, lon0_rad.to_degrees())];
            numbers.extend(offsets(false_easting_m, false_northing_m));
            (1, Some(17), numbers)
        }
        Projection::Orthographic { lat0_rad, lon0_rad, false_easting_m, false_northing_m, .. } => {
            let mut numbers = vec![(3089, lat0_rad.to_degrees()), (3088, lon0_rad.to_degrees())];
            numbers.extend(offsets(false_easting_m, false_northing_m));
            (1, Some(21), numbers)
        }
        Projection::Geographic { .. } => (2, None, Vec::new()),
    }
}
