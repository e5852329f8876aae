//! PROJ strings and the IAU codes of the Moon, parsed into [`Projection`] and [`Body`]; anything else is refused.

use crate::{Body, Error, Pole, Projection};

/// A coordinate reference system on a sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct Crs {
    /// The sphere.
    pub body: Body,
    /// The map.
    pub projection: Projection,
}

/// Parses `+proj=stere|eqc|longlat|ortho …` or `IAU_2015:30100|30110|30130|30135` (the `IAU:` prefix too).
///
/// A string without a radius (`+R`, `+a`) is taken on the Moon's sphere.
///
/// # Errors
/// [`Error::UnknownProjection`] for another projection or code, [`Error::ProjectionParameter`] for an ellipsoid, a
/// number that is none, or a stereographic map that is not polar.
pub fn parse(text: &str) -> Result<Crs, Error> {
    let text = text.trim();
    if let Some(code) = text.strip_prefix("IAU_2015:").or_else(|| text.strip_prefix("IAU:")) {
        let string = match code {
            "30100" => "+proj=longlat",
            "30110" => "+proj=eqc",
            "30130" => "+proj=stere +lat_0=90",
            "30135" => "+proj=stere +lat_0=-90",
            _ => return Err(Error::UnknownProjection { name: text.into() }),
        };
        return parse(string);
    }
    let parameters: Vec<(&str, Option<&str>)> = text
        .split_whitespace()
        .map(|word| {
            let word = word.trim_start_matches('+');
            word.split_once('=').map_or((word, None), |(key, value)| (key, Some(value)))
        })
        .collect();
    let get = |key: &str| parameters.iter().find(|(k, _)| *k == key).and_then(|(_, v)| *v);
    let number = |key: &str| -> Result<Option<f64>, Error> {
        get(key).map_or(Ok(None), |value| match value.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(Some(v)),
            _ => Err(Error::ProjectionParameter {
                name: key.into(),
                what: format!("expected a number, found `{value}`"),
            }),
        })
    };
    let radius_m = match (number("R")?, number("a")?, number("b")?) {
        (Some(r), ..) => r,
        (None, Some(a), Some(b)) if (a - b).abs() > 1e-6 * a => {
            return Err(Error::ProjectionParameter {
                name: "a, b".into(),
                what: format!("expected a sphere, found an ellipsoid {a} × {b} m"),
            });
        }
        (None, Some(a), _) => a,
        (None, None, _) => Body::moon().radius_m,
    };
    if radius_m <= 0.0 {
        return Err(Error::ProjectionParameter {
            name: "R".into(),
            what: format!("expected > 0 m, found {radius_m}"),
        });
    }
    if get("units").is_some_and(|u| u != "m") {
        return Err(Error::ProjectionParameter {
            name: "units".into(),
            what: "expected metres (+units=m)".into(),
        });
    }
    let degrees = |key: &str| Ok::<f64, Error>(number(key)?.unwrap_or(0.0).to_radians());
    let false_easting_m = number("x_0")?.unwrap_or(0.0);
    let false_northing_m = number("y_0")?.unwrap_or(0.0);
    let lon0_rad = degrees("lon_0")?;
    let projection = match get("proj") {
        Some("stere" | "ups") => {
            let lat_0 = number("lat_0")?.unwrap_or(0.0);
            let pole = if (lat_0 - 90.0).abs() < 1e-9 {
                Pole::North
            } else if (lat_0 + 90.0).abs() < 1e-9 {
                Pole::South
            } else {
                return Err(Error::ProjectionParameter {
                    name: "lat_0".into(),
                    what: format!("expected ±90 (polar stereographic), found {lat_0}"),
                });
            };
            // A latitude of true scale is a scale at the pole by another name: k0 = (1 + sin|lat_ts|) / 2.
            let k0 = match (number("k_0")?.or(number("k")?), number("lat_ts")?) {
                (Some(k), _) => k,
                (None, Some(lat_ts)) => f64::midpoint(1.0, lat_ts.abs().to_radians().sin()),
                (None, None) => 1.0,
            };
            Projection::PolarStereographic { pole, lon0_rad, k0, false_easting_m, false_northing_m, radius_m }
        }
        Some("eqc") => Projection::Equirectangular {
            lat_ts_rad: degrees("lat_ts")?,
            lat0_rad: degrees("lat_0")?,
            lon0_rad,
            false_easting_m,
            false_northing_m,
            radius_m,
        },
        Some("longlat" | "latlong" | "lonlat" | "latlon") => {
            Projection::Geographic { lon_center_deg: number("lon_wrap")?.unwrap_or(0.0) }
        }
        Some("ortho") => Projection::Orthographic {
            lat0_rad: degrees("lat_0")?,
            lon0_rad,
            false_easting_m,
            false_northing_m,
            radius_m,
        },
        other => return Err(Error::UnknownProjection { name: other.unwrap_or(text).into() }),
    };
    let moon = Body::moon();
    let body = if (radius_m - moon.radius_m).abs() < 1.0 {
        moon
    } else if (radius_m - Body::mars().radius_m).abs() < 1.0 {
        Body::mars()
    } else {
        Body::sphere("custom sphere", radius_m, "body_fixed")
    };
    Ok(Crs { body, projection })
}

/// The PROJ string of a map on a body.
pub fn format(crs: &Crs) -> String {
    let deg = |rad: f64| {
        // Twelve decimals of a degree are 3e-8 m on the Moon; fewer digits read better than binary noise.
        let text = format!("{:.12}", rad.to_degrees());
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    let offsets = |x: f64, y: f64, radius: f64| format!("+x_0={x} +y_0={y} +R={radius} +units=m +no_defs");
    match crs.projection {
        Projection::PolarStereographic {
            pole,
            lon0_rad,
            k0,
            false_easting_m,
            false_northing_m,
            radius_m,
        } => format!(
            "+proj=stere +lat_0={} +lon_0={} +k={k0} {}",
            if pole == Pole::North { 90 } else { -90 },
            deg(lon0_rad),
            offsets(false_easting_m, false_northing_m, radius_m)
        ),
        Projection::Equirectangular {
            lat_ts_rad,
            lat0_rad,
            lon0_rad,
            false_easting_m,
            false_northing_m,
            radius_m,
        } => {
            format!(
                "+proj=eqc +lat_ts={} +lat_0={} +lon_0={} {}",
                deg(lat_ts_rad),
                deg(lat0_rad),
                deg(lon0_rad),
                offsets(false_easting_m, false_northing_m, radius_m)
            )
        }
        Projection::Geographic { lon_center_deg } => {
            format!("+proj=longlat +lon_wrap={lon_center_deg} +R={} +no_defs", crs.body.radius_m)
        }
        Projection::Orthographic { lat0_rad, lon0_rad, false_easting_m, false_northing_m, radius_m } => {
            format!(
                "+proj=ortho +lat_0={} +lon_0={} {}",
                deg(lat0_rad),
                deg(lon0_rad),
                offsets(false_easting_m, false_northing_m, radius_m)
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_round_trip() {
        for text in [
            "+proj=stere +lat_0=-90 +lon_0=0 +k=1 +x_0=0 +y_0=0 +R=1737400 +units=m +no_defs",
            "+proj=eqc +lat_ts=30 +lat_0=0 +lon_0=180 +R=1737400",
            "+proj=longlat +lon_wrap=180 +R=3396190",
            "+proj=ortho +lat_0=23.7 +lon_0=-47.4 +R=1737400",
            "IAU_2015:30130",
        ] {
            let crs = parse(text).unwrap();
            let again = parse(&format(&crs)).unwrap();
            let place = crate::Geodetic::from_deg(20.0, 300.0, 0.0);
            let (a, b) = (crs.projection.map_from_place(&place), again.projection.map_from_place(&place));
            assert!(a.zip(b).is_none_or(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6), "{text}");
            assert_eq!(crs.body, again.body);
        }
        assert_eq!(parse("+proj=longlat +R=3396190").unwrap().body, Body::mars());
    }

    #[test]
    fn true_scale_latitude_is_a_scale_at_the_pole() {
        let Projection::PolarStereographic { k0, .. } =
            parse("+proj=stere +lat_0=-90 +lat_ts=-71").unwrap().projection
        else {
            panic!("not polar")
        };
        assert!((k0 - (1.0 + 71f64.to_radians().sin()) / 2.0).abs() < 1e-15);
    }

    #[test]
    fn everything_else_is_refused() {
        for text in
            ["+proj=merc", "IAU_2015:30175", "EPSG:4326", "", "+proj=stere +lat_0=40", "+proj=eqc +lat_ts=x"]
        {
            assert!(parse(text).is_err(), "{text}");
        }
        let ellipsoid = parse("+proj=eqc +a=3396190 +b=3376200");
        assert!(matches!(ellipsoid, Err(Error::ProjectionParameter { .. })));
    }
}
