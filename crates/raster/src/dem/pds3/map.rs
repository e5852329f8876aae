//! `IMAGE_MAP_PROJECTION` → coordinate system and affine map.

use super::label::{Block, Value};
use crate::{Affine, Error};
use selenograph_geometry::pixel::HALF_PIXEL;
use selenograph_geometry::proj_string::{self, Crs};
use std::path::Path;

/// Disagreement of bounds and offsets, in pixels, that rounding in a label explains.
const BOUNDS_TOLERANCE_PX: f64 = 0.3;

/// Relative disagreement of `MAP_SCALE` and `MAP_RESOLUTION` that rounding in a label explains.
const SCALE_TOLERANCE: f64 = 0.02;

/// The map as the label describes it.
pub(super) struct LabelMap {
    pub(super) crs: Crs,
    pub(super) map_from_pixel: Affine,
    pub(super) notes: Vec<String>,
}

/// Reads keywords of one object, with errors that name them.
struct Keywords<'a> {
    block: &'a Block,
    path: &'a Path,
}

impl Keywords<'_> {
    fn number(&self, key: &str) -> Option<f64> {
        self.block.get(key).and_then(Value::number)
    }

    fn needed(&self, key: &str) -> Result<f64, Error> {
        self.number(key).ok_or_else(|| Error::NoGeoreference {
            path: self.path.to_owned(),
            what: format!("its label has no usable {key}"),
        })
    }

    /// A length in metres; without a unit it counts in `default_m`.
    fn length_m(&self, key: &str, default_m: f64) -> Option<f64> {
        let value = self.block.get(key)?;
        let unit_m = value.unit().map_or(Some(default_m), metres_per_unit)?;
        Some(value.number()? * unit_m)
    }

    fn malformed(&self, what: &str, expected: impl Into<String>, found: impl Into<String>) -> Error {
        Error::Malformed {
            path: self.path.to_owned(),
            what: what.to_owned(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}

/// Metres per `KM`, `METERS`, `KM/PIXEL`, `m/pix` …
fn metres_per_unit(unit: &str) -> Option<f64> {
    let length = unit.split('/').next()?;
    crate::dem::HeightUnit::parse(length).map(crate::dem::HeightUnit::metres)
}

/// The sphere's radius in metres.
pub(super) fn radius_m(map: &Block, path: &Path) -> Result<f64, Error> {
    let keys = Keywords { block: map, path };
    let a = keys.length_m("A_AXIS_RADIUS", 1000.0);
    let a = a.filter(|r| *r > 0.0).ok_or_else(|| {
        keys.needed("A_AXIS_RADIUS")
            .err()
            .unwrap_or_else(|| keys.malformed("A_AXIS_RADIUS", "a length above 0", "another value"))
    })?;
    for axis in ["B_AXIS_RADIUS", "C_AXIS_RADIUS"] {
        if let Some(b) = keys.length_m(axis, 1000.0)
            && (a - b).abs() > 1e-6 * a
        {
            return Err(Error::CoordinateSystem {
                path: path.to_owned(),
                source: selenograph_geometry::Error::ProjectionParameter {
                    name: axis.to_owned(),
                    what: format!("expected a sphere of {a} m, found {b} m"),
                },
            });
        }
    }
    Ok(a)
}

/// The coordinate system of the label.
fn crs_of(keys: &Keywords, radius_m: f64) -> Result<Crs, Error> {
    let lat = keys.number("CENTER_LATITUDE").unwrap_or(0.0);
    let lon = keys.number("CENTER_LONGITUDE").unwrap_or(0.0);
    if keys.block.get("POSITIVE_LONGITUDE_DIRECTION").is_some_and(|v| v.text().eq_ignore_ascii_case("WEST")) {
        return Err(Error::Unsupported {
            path: keys.path.to_owned(),
            what: "longitude direction",
            found: "WEST".to_owned(),
            supported: "EAST",
        });
    }
    let name = keys.block.get("MAP_PROJECTION_TYPE").map_or("", Value::text);
    let text = match name.to_ascii_uppercase().replace(['_', ' '], "").as_str() {
        // A centre that is not the pole is the latitude of true scale, as ISIS has it.
        "POLARSTEREOGRAPHIC" if lat != 0.0 && lat.abs() < 90.0 => {
            format!("+proj=stere +lat_0={} +lat_ts={lat}", 90f64.copysign(lat))
        }
        "POLARSTEREOGRAPHIC" | "STEREOGRAPHIC" => format!("+proj=stere +lat_0={lat}"),
        // In PDS3 the centre latitude of an equirectangular map is that of true scale; y counts from the equator.
        "EQUIRECTANGULAR" => format!("+proj=eqc +lat_ts={lat}"),
        "SIMPLECYLINDRICAL" => format!("+proj=eqc +lat_0={lat}"),
        "ORTHOGRAPHIC" => format!("+proj=ortho +lat_0={lat}"),
        "" => {
            keys.needed("MAP_PROJECTION_TYPE")?;
            String::new()
        }
        _ => return Err(Error::UnknownProjection { path: keys.path.to_owned(), name: name.to_owned() }),
    };
    proj_string::parse(&format!("{text} +lon_0={lon} +R={radius_m}"))
        .map_err(|source| Error::CoordinateSystem { path: keys.path.to_owned(), source })
}

/// Metres per pixel.
///
/// Labels give `MAP_SCALE` and `MAP_RESOLUTION`, one of them rounded. Simple cylindrical products are defined by
/// their pixels per degree, the others by their metres per pixel.
fn scale_m(keys: &Keywords, radius_m: f64) -> Result<f64, Error> {
    let degree_m = radius_m * 1f64.to_radians();
    let by_resolution = keys.number("MAP_RESOLUTION").filter(|v| *v > 0.0).map(|ppd| degree_m / ppd);
    let mut by_scale = keys.length_m("MAP_SCALE", 1000.0).filter(|v| *v > 0.0);
    if let (Some(scale), Some(other), None) =
        (by_scale, by_resolution, keys.block.get("MAP_SCALE").and_then(Value::unit))
        && (scale / 1000.0 / other - 1.0).abs() < SCALE_TOLERANCE
    {
        // Without a unit MAP_SCALE is in kilometres by the dictionary; some labels mean metres.
        by_scale = Some(scale / 1000.0);
    }
    let simple = keys
        .block
        .get("MAP_PROJECTION_TYPE")
        .is_some_and(|v| v.text().to_ascii_uppercase().contains("SIMPLE"));
    match (by_scale, by_resolution) {
        (Some(scale), Some(other)) if (scale / other - 1.0).abs() > SCALE_TOLERANCE => Err(keys.malformed(
            "map scale",
            format!("MAP_SCALE like MAP_RESOLUTION ({other:.6} m/pixel)"),
            format!("{scale:.6} m/pixel"),
        )),
        (_, Some(by_resolution)) if simple => Ok(by_resolution),
        (Some(scale), _) | (None, Some(scale)) => Ok(scale),
        (None, None) => keys.needed("MAP_SCALE"),
    }
}

/// How the place of the projection's origin along an axis was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Counted {
    /// By the rule of the data dictionary, which bounds or symmetry confirm.
    ByRule,
    /// By the bounds, against the rule.
    ByBounds,
    /// By the rule, which nothing confirms.
    Untold,
}

/// Corner-based raster coordinate of the projection's origin along one axis.
///
/// By the data dictionary the offset counts pixels from the centre of the first one; products have come to count
/// from its corner, from a pixel numbered 1, or with the other sign. Where the label's bounds tell, they decide:
/// `bounds` is (offset of the first bound from the origin in pixels, extent in pixels, pixels per turn).
fn origin_px(
    offset: f64,
    bounds: Option<(f64, f64, Option<f64>)>,
    count: usize,
) -> Result<(f64, Counted), f64> {
    let standard = offset + HALF_PIXEL;
    let count = count as f64;
    // An origin that the rule puts into the very middle is no accident.
    let by_rule = if (standard - count / 2.0).abs() < 1e-6 { Counted::ByRule } else { Counted::Untold };
    let Some((first_px, extent_px, turn_px)) = bounds else { return Ok((standard, by_rule)) };
    // Bounds of the outer edges, or of the outermost centres.
    let edge = if (extent_px - count).abs() < BOUNDS_TOLERANCE_PX {
        0.0
    } else if (extent_px - (count - 1.0)).abs() < BOUNDS_TOLERANCE_PX {
        HALF_PIXEL
    } else {
        return Ok((standard, by_rule));
    };
    let wanted = edge - first_px;
    let miss = |origin: f64| {
        let d = origin - wanted;
        turn_px.map_or(d, |turn| d - turn * (d / turn).round())
    };
    for sign in [1.0, -1.0] {
        for shift in [HALF_PIXEL, 0.0, -HALF_PIXEL] {
            let origin = sign * offset + shift;
            if miss(origin).abs() < BOUNDS_TOLERANCE_PX {
                let rule = if origin == standard { Counted::ByRule } else { Counted::ByBounds };
                return Ok((origin, rule));
            }
        }
    }
    Err(miss(standard))
}

/// The map of a label: what `IMAGE_MAP_PROJECTION` says of an image of that size.
pub(super) fn read(
    map: &Block,
    path: &Path,
    width: usize,
    height: usize,
    given: Option<Crs>,
) -> Result<LabelMap, Error> {
    let keys = Keywords { block: map, path };
    let crs = match given {
        Some(crs) => crs,
        None => crs_of(&keys, radius_m(map, path)?)?,
    };
    let rotation = keys.number("MAP_PROJECTION_ROTATION").unwrap_or(0.0);
    if rotation != 0.0 {
        return Err(Error::Unsupported {
            path: path.to_owned(),
            what: "map projection rotation",
            found: rotation.to_string(),
            supported: "0",
        });
    }
    let scale_m = scale_m(&keys, crs.projection.radius_m().unwrap_or(crs.body.radius_m))?;
    let (rows, columns) = cylindrical_bounds(&keys, &crs, scale_m);
    let mut notes = Vec::new();
    let mut axis = |key: &str, bounds, count| -> Result<f64, Error> {
        match origin_px(keys.needed(key)?, bounds, count) {
            Ok((origin, counted)) => {
                match counted {
                    Counted::ByRule => {}
                    Counted::ByBounds => notes.push(format!(
                        "{key} is not counted from the first pixel's centre: the bounds decided"
                    )),
                    Counted::Untold => notes.push(format!(
                        "{key} is taken to count from the first pixel's centre, as PDS3 has it; the label does not tell \
                         (from its edge the map lay half a pixel off)"
                    )),
                }
                Ok(origin)
            }
            Err(miss_px) => Err(keys.malformed(
                key,
                "the map's origin where the latitude and longitude bounds put it",
                format!("an origin {miss_px:.2} pixels away"),
            )),
        }
    };
    let row = axis("LINE_PROJECTION_OFFSET", rows, height)?;
    let column = axis("SAMPLE_PROJECTION_OFFSET", columns, width)?;
    let map_from_pixel = Affine::north_up(0.0, 0.0, scale_m, scale_m).with_origin(-column, -row);
    Ok(LabelMap { crs, map_from_pixel, notes })
}

/// What the bounds of a cylindrical map say about rows and columns, for [`origin_px`].
#[allow(clippy::type_complexity)] // two of the same triple, read once
fn cylindrical_bounds(
    keys: &Keywords,
    crs: &Crs,
    scale_m: f64,
) -> (Option<(f64, f64, Option<f64>)>, Option<(f64, f64, Option<f64>)>) {
    use selenograph_geometry::Projection::Equirectangular;
    let Equirectangular { lat_ts_rad, lat0_rad, lon0_rad, radius_m, .. } = crs.projection else {
        return (None, None);
    };
    let down_ppd = radius_m * 1f64.to_radians() / scale_m;
    let across_ppd = down_ppd * lat_ts_rad.cos();
    let pair = |a: &str, b: &str| Some((keys.number(a)?, keys.number(b)?));
    let rows = pair("MAXIMUM_LATITUDE", "MINIMUM_LATITUDE")
        .map(|(top, bottom)| (-(top - lat0_rad.to_degrees()) * down_ppd, (top - bottom) * down_ppd, None));
    let columns = pair("WESTERNMOST_LONGITUDE", "EASTERNMOST_LONGITUDE").map(|(west, east)| {
        let extent = if east > west { east - west } else { east - west + 360.0 };
        ((west - lon0_rad.to_degrees()) * across_ppd, extent * across_ppd, Some(360.0 * across_ppd))
    });
    (rows, columns)
}

#[cfg(test)]
mod tests {
    use super::Counted::{ByBounds, ByRule, Untold};
    use super::*;

    #[test]
    fn offsets_are_counted_from_the_first_centre_unless_bounds_tell_otherwise() {
        // ldem_4: 720 lines of a quarter degree, equator between lines 360 and 361.
        let rows = Some((-360.0, 720.0, None));
        assert_eq!(origin_px(359.5, rows, 720), Ok((360.0, ByRule)));
        assert_eq!(origin_px(359.5, None, 720), Ok((360.0, ByRule)));
        assert_eq!(origin_px(360.0, rows, 720), Ok((360.0, ByBounds)));
        assert_eq!(origin_px(360.5, rows, 720), Ok((360.0, ByBounds)));
        assert_eq!(origin_px(-360.0, rows, 720), Ok((360.0, ByBounds)));
        assert_eq!(origin_px(12.5, None, 720), Ok((13.0, Untold)));
        assert_eq!(origin_px(12.5, Some((-361.0, 722.0, None)), 720), Ok((13.0, Untold)));
        // Bounds of the outermost centres (one pixel less of extent) say the same.
        assert_eq!(origin_px(359.5, Some((-359.5, 719.0, None)), 720), Ok((360.0, ByRule)));
        // Rounded bounds decide nothing; exact ones elsewhere are a contradiction.
        assert_eq!(origin_px(359.5, Some((-361.0, 722.0, None)), 720), Ok((360.0, ByRule)));
        assert_eq!(origin_px(359.5, Some((-350.0, 720.0, None)), 720), Err(10.0));
        // A turn of longitude makes no difference.
        assert_eq!(origin_px(719.5, Some((720.0, 1440.0, Some(1440.0))), 1440), Ok((720.0, ByRule)));
    }
}
