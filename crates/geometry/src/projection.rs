//! Map projections of the sphere, in closed form.
//!
//! # Source
//! Snyder 1987, "Map projections: a working manual" (USGS PP 1395), spherical forms: stereographic §21, equirectangular
//! §12, orthographic §20.

use crate::Geodetic;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Which pole a polar map is centred on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pole {
    /// Latitude +90°.
    North,
    /// Latitude −90°.
    South,
}

/// A map projection of a sphere. Map coordinates are metres, or degrees for [`Projection::Geographic`]
/// (x = east longitude, y = latitude).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Projection {
    /// Conformal about a pole. North: `x = ρ sin(λ−λ0), y = −ρ cos(λ−λ0)`; south: `y = +ρ cos(λ−λ0)`;
    /// `ρ = 2 R k0 tan(c/2)` with c the angle from the pole.
    PolarStereographic {
        /// The pole at the map's centre.
        pole: Pole,
        /// Longitude that points down (north) or up (south), radians.
        lon0_rad: f64,
        /// Scale at the pole.
        k0: f64,
        /// Added to x, metres.
        false_easting_m: f64,
        /// Added to y, metres.
        false_northing_m: f64,
        /// Sphere, metres.
        radius_m: f64,
    },
    /// `x = R cos(lat_ts) (λ−λ0)`, `y = R (φ − φ0)`.
    Equirectangular {
        /// Latitude of true scale, radians.
        lat_ts_rad: f64,
        /// Latitude at y = 0, radians.
        lat0_rad: f64,
        /// Central longitude, radians; longitudes are taken within ±180° of it.
        lon0_rad: f64,
        /// Added to x, metres.
        false_easting_m: f64,
        /// Added to y, metres.
        false_northing_m: f64,
        /// Sphere, metres.
        radius_m: f64,
    },
    /// Longitude and latitude in degrees; longitudes are taken within ±180° of `lon_center_deg`.
    Geographic {
        /// Middle of the longitude range, degrees.
        lon_center_deg: f64,
    },
    /// The sphere seen from infinitely far away above (φ0, λ0).
    Orthographic {
        /// Latitude of the centre, radians.
        lat0_rad: f64,
        /// Longitude of the centre, radians.
        lon0_rad: f64,
        /// Added to x, metres.
        false_easting_m: f64,
        /// Added to y, metres.
        false_northing_m: f64,
        /// Sphere, metres.
        radius_m: f64,
    },
}

/// An angle brought within ±π of `center`.
fn near(angle: f64, center: f64) -> f64 {
    let d = (angle - center).rem_euclid(TAU);
    center + if d > PI { d - TAU } else { d }
}

impl Projection {
    /// The south polar stereographic map of LOLA's products: true scale at the pole, longitude 0 upwards.
    pub fn south_polar(radius_m: f64) -> Self {
        Self::polar(Pole::South, radius_m)
    }

    /// A polar stereographic map with true scale at its pole, no offsets, longitude 0 on the y axis.
    pub fn polar(pole: Pole, radius_m: f64) -> Self {
        Self::PolarStereographic {
            pole,
            lon0_rad: 0.0,
            k0: 1.0,
            false_easting_m: 0.0,
            false_northing_m: 0.0,
            radius_m,
        }
    }

    /// The sphere this map is drawn on, metres; `None` for geographic coordinates, which need none.
    pub fn radius_m(&self) -> Option<f64> {
        match *self {
            Self::PolarStereographic { radius_m, .. }
            | Self::Equirectangular { radius_m, .. }
            | Self::Orthographic { radius_m, .. } => Some(radius_m),
            Self::Geographic { .. } => None,
        }
    }

    /// A short name for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::PolarStereographic { pole: Pole::North, .. } => "polar stereographic (north)",
            Self::PolarStereographic { pole: Pole::South, .. } => "polar stereographic (south)",
            Self::Equirectangular { .. } => "equirectangular",
            Self::Geographic { .. } => "geographic",
            Self::Orthographic { .. } => "orthographic",
        }
    }

    /// Direction from the body's centre (any length) → map. `None` where the map does not reach
    /// (the opposite pole, the far hemisphere of an orthographic map).
    #[inline]
    pub fn map_from_point(&self, p: &Point3<f64>) -> Option<[f64; 2]> {
        match *self {
            Self::PolarStereographic { pole, lon0_rad, k0, false_easting_m, false_northing_m, radius_m } => {
                let r = p.coords.norm();
                let (axial, sign) = match pole {
                    Pole::North => (p.z, -1.0),
                    Pole::South => (-p.z, 1.0),
                };
                let denominator = r + axial;
                if denominator <= 1e-9 * r {
                    return None;
                }
                let s = 2.0 * radius_m * k0 / denominator;
                // East-of-lon0 and along-lon0 components of the point.
                let (across, along) = if lon0_rad == 0.0 {
                    (p.y, p.x)
                } else {
                    let (sin0, cos0) = lon0_rad.sin_cos();
                    (p.y * cos0 - p.x * sin0, p.x * cos0 + p.y * sin0)
                };
                Some([s * across + false_easting_m, sign * s * along + false_northing_m])
            }
            Self::Orthographic { lat0_rad, lon0_rad, false_easting_m, false_northing_m, radius_m } => {
                let r = p.coords.norm();
                let (sin_lat0, cos_lat0) = lat0_rad.sin_cos();
                let (sin0, cos0) = lon0_rad.sin_cos();
                let across = p.y * cos0 - p.x * sin0;
                let along = p.x * cos0 + p.y * sin0;
                let towards_viewer = sin_lat0 * p.z + cos_lat0 * along;
                if towards_viewer <= 0.0 {
                    return None;
                }
                let s = radius_m / r;
                Some([
                    s * across + false_easting_m,
                    s * (cos_lat0 * p.z - sin_lat0 * along) + false_northing_m,
                ])
            }
            Self::Equirectangular {
                lat_ts_rad,
                lat0_rad,
                lon0_rad,
                false_easting_m,
                false_northing_m,
                radius_m,
            } => {
                let lat = p.z.atan2(p.x.hypot(p.y));
                let lon = near(p.y.atan2(p.x), lon0_rad);
                Some([
                    radius_m * lat_ts_rad.cos() * (lon - lon0_rad) + false_easting_m,
                    radius_m * (lat - lat0_rad) + false_northing_m,
                ])
            }
            Self::Geographic { lon_center_deg } => {
                let lat = p.z.atan2(p.x.hypot(p.y));
                let lon = near(p.y.atan2(p.x), lon_center_deg.to_radians());
                Some([lon.to_degrees(), lat.to_degrees()])
            }
        }
    }

    /// Place → map (its height does not matter). `None` where the map does not reach.
    pub fn map_from_place(&self, place: &Geodetic) -> Option<[f64; 2]> {
        let (sin_lat, cos_lat) = place.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = place.lon_rad.sin_cos();
        self.map_from_point(&Point3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat))
    }

    /// Map → place on the sphere (height 0). `None` outside the map.
    pub fn place_from_map(&self, x: f64, y: f64) -> Option<Geodetic> {
        let place = |lat_rad: f64, lon_rad: f64| {
            (lat_rad.abs() <= FRAC_PI_2 + 1e-12).then_some(Geodetic { lat_rad, lon_rad, height_m: 0.0 })
        };
        match *self {
            Self::PolarStereographic { pole, lon0_rad, k0, false_easting_m, false_northing_m, radius_m } => {
                let (dx, dy) = (x - false_easting_m, y - false_northing_m);
                let c = 2.0 * (dx.hypot(dy) / (2.0 * radius_m * k0)).atan();
                match pole {
                    Pole::North => place(FRAC_PI_2 - c, lon0_rad + dx.atan2(-dy)),
                    Pole::South => place(c - FRAC_PI_2, lon0_rad + dx.atan2(dy)),
                }
            }
            Self::Orthographic { lat0_rad, lon0_rad, false_easting_m, false_northing_m, radius_m } => {
                let (dx, dy) = ((x - false_easting_m) / radius_m, (y - false_northing_m) / radius_m);
                let out2 = dx * dx + dy * dy;
                if out2 >= 1.0 {
                    return None;
                }
                let towards = (1.0 - out2).sqrt();
                let (sin_lat0, cos_lat0) = lat0_rad.sin_cos();
                let lat = (towards * sin_lat0 + dy * cos_lat0).clamp(-1.0, 1.0).asin();
                place(lat, lon0_rad + dx.atan2(towards * cos_lat0 - dy * sin_lat0))
            }
            Self::Equirectangular {
                lat_ts_rad,
                lat0_rad,
                lon0_rad,
                false_easting_m,
                false_northing_m,
                radius_m,
            } => {
                let lon = lon0_rad + (x - false_easting_m) / (radius_m * lat_ts_rad.cos());
                place(lat0_rad + (y - false_northing_m) / radius_m, lon)
            }
            Self::Geographic { .. } => place(y.to_radians(), x.to_radians()),
        }
    }

    /// Metres on the ground per map unit at a place, along x and along y, by the sphere `radius_m` of the body.
    pub fn ground_m_per_unit(&self, x: f64, y: f64, radius_m: f64) -> Option<[f64; 2]> {
        let step = match self {
            Self::Geographic { .. } => 1e-4,
            _ => 1.0,
        };
        let at = |x: f64, y: f64| {
            let place = self.place_from_map(x, y)?;
            let (sin_lat, cos_lat) = place.lat_rad.sin_cos();
            let (sin_lon, cos_lon) = place.lon_rad.sin_cos();
            Some(Point3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat) * radius_m)
        };
        let along_x = (at(x + step, y)? - at(x - step, y)?).norm() / (2.0 * step);
        let along_y = (at(x, y + step)? - at(x, y - step)?).norm() / (2.0 * step);
        Some([along_x, along_y])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Body;

    const R: f64 = 1_737_400.0;

    fn all() -> Vec<Projection> {
        vec![
            Projection::south_polar(R),
            Projection::polar(Pole::North, R),
            Projection::PolarStereographic {
                pole: Pole::South,
                lon0_rad: 0.6,
                k0: 0.994,
                false_easting_m: 2e6,
                false_northing_m: -5.0,
                radius_m: R,
            },
            Projection::Equirectangular {
                lat_ts_rad: 0.5,
                lat0_rad: 0.1,
                lon0_rad: PI,
                false_easting_m: 7.0,
                false_northing_m: 11.0,
                radius_m: R,
            },
            Projection::Geographic { lon_center_deg: 180.0 },
            Projection::Orthographic {
                lat0_rad: 0.41,
                lon0_rad: -0.83,
                false_easting_m: 0.0,
                false_northing_m: 3.0,
                radius_m: R,
            },
        ]
    }

    #[test]
    fn forward_and_inverse_agree_everywhere() {
        let moon = Body::moon();
        let mut tried = 0;
        for projection in all() {
            for lat in [-89.99, -88.0, -45.0, 3.0, 24.0, 67.0, 89.0] {
                for lon in [-179.0, -47.0, 0.0, 12.0, 131.0] {
                    let place = Geodetic::from_deg(lat, lon, 0.0);
                    let Some([x, y]) = projection.map_from_place(&place) else { continue };
                    let back = projection.place_from_map(x, y).unwrap();
                    // Rounding is magnified near an orthographic limb and near the pole opposite a polar map's.
                    let far = x.hypot(y) > 50.0 * R || matches!(projection, Projection::Orthographic { .. });
                    let tolerance = if far { 1e-4 } else { 1e-7 };
                    assert!(
                        (moon.point(&back) - moon.point(&place)).norm() < tolerance,
                        "{projection:?} {lat} {lon}"
                    );
                    tried += 1;
                }
            }
        }
        assert!(tried > 150);
    }

    /// Numbers printed by PROJ (pyproj 3) for these strings: `pyproj.Proj(text)(lon, lat)`.
    #[test]
    fn agrees_with_proj() {
        let cases = [
            ("+proj=stere +lat_0=-90 +k=1 +R=1737400", 105.5, -88.19, 52_893.510_942, -14_668.668_806),
            ("+proj=stere +lat_0=90 +k=1 +R=1737400", 30.0, 85.0, 75_856.522_209, -131_387.350_552),
            ("+proj=eqc +lat_ts=30 +lon_0=180 +R=1737400", 200.0, -12.0, 525_215.835_903, -363_880.205_090),
            ("+proj=ortho +lat_0=23.7 +lon_0=-47.4 +R=1737400", -46.5, 24.1, 24_911.147_112, 12_207.885_021),
            (
                "+proj=stere +lat_0=-90 +lat_ts=-71 +lon_0=40 +R=3396190",
                10.0,
                -75.0,
                -434_937.113_103,
                753_333.177_993,
            ),
        ];
        for (text, lon, lat, x, y) in cases {
            let projection = crate::proj_string::parse(text).unwrap().projection;
            let [px, py] = projection.map_from_place(&Geodetic::from_deg(lat, lon, 0.0)).unwrap();
            assert!((px - x).abs() < 2e-6 && (py - y).abs() < 2e-6, "{text}: {px} {py}");
        }
    }

    #[test]
    fn scale_of_the_polar_map_is_one_at_the_pole_and_grows_outwards() {
        let map = Projection::south_polar(R);
        let at = |x: f64| map.ground_m_per_unit(x, 0.0, R).unwrap();
        assert!((at(0.0)[0] - 1.0).abs() < 1e-9);
        // Conformal factor 1 + rho²/4R²: 1.00048 at 75.84 km, so a 5 m cell is 4.9976 m on the ground.
        assert!((5.0 * at(75_840.0)[0] - 4.9976).abs() < 1e-4);
        assert!((at(75_840.0)[0] - at(75_840.0)[1]).abs() < 1e-8);
    }
}
