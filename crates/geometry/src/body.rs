//! A spherical body: latitude, longitude and height against its body-fixed frame, and the local horizon.

use crate::{BodyFixed, Enu, Error, Rigid3};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// A spherical body and the name of its body-fixed frame. The Moon is the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// For example `Moon`.
    pub name: String,
    /// Radius of the reference sphere, metres. Heights are measured from it.
    pub radius_m: f64,
    /// Name of the body-fixed frame in files, for example `moon_me`.
    pub frame: String,
}

impl Default for Body {
    fn default() -> Self {
        Self::moon()
    }
}

/// A place: planetocentric latitude, east longitude, height above the reference sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Latitude, radians in `[-π/2, π/2]`.
    pub lat_rad: f64,
    /// East longitude, radians.
    pub lon_rad: f64,
    /// Height above the reference sphere, metres.
    pub height_m: f64,
}

impl Geodetic {
    /// From degrees and metres.
    pub fn from_deg(lat_deg: f64, lon_deg: f64, height_m: f64) -> Self {
        Self { lat_rad: lat_deg.to_radians(), lon_rad: lon_deg.to_radians(), height_m }
    }
}

impl Body {
    /// The Moon: sphere of 1 737 400 m, mean Earth/polar axis frame (the datum of LOLA's products).
    pub fn moon() -> Self {
        Self { name: "Moon".into(), radius_m: 1_737_400.0, frame: "moon_me".into() }
    }

    /// Mars as the sphere of 3 396 190 m (the equatorial radius, as the IAU:49900 sphere has it).
    pub fn mars() -> Self {
        Self { name: "Mars".into(), radius_m: 3_396_190.0, frame: "mars_iau".into() }
    }

    /// Another sphere.
    pub fn sphere(name: &str, radius_m: f64, frame: &str) -> Self {
        Self { name: name.into(), radius_m, frame: frame.into() }
    }

    /// Place → body-fixed point.
    pub fn point(&self, place: &Geodetic) -> Point3<f64> {
        Point3::from(self.up(place) * (self.radius_m + place.height_m))
    }

    /// Body-fixed point → place. At the centre itself the direction is undefined and latitude 0 is returned.
    pub fn place(&self, point: &Point3<f64>) -> Geodetic {
        let rho = point.x.hypot(point.y);
        Geodetic {
            lat_rad: point.z.atan2(rho),
            lon_rad: point.y.atan2(point.x),
            height_m: self.height_m(point),
        }
    }

    /// Height of a body-fixed point above the reference sphere, metres.
    pub fn height_m(&self, point: &Point3<f64>) -> f64 {
        point.coords.norm() - self.radius_m
    }

    /// Makes sure that what lies on this body may be put beside what lies on another one, both named as people know them:
    /// heights count from the sphere, and those over a second radius are off by the difference.
    ///
    /// # Errors
    /// [`Error::OtherSphere`] where the radii differ by more than rounding (a micrometre).
    pub fn same_sphere(
        &self,
        what: impl std::fmt::Display,
        other: &Self,
        beside: impl std::fmt::Display,
    ) -> Result<(), Error> {
        if (self.radius_m - other.radius_m).abs() <= 1e-6 {
            return Ok(());
        }
        Err(Error::OtherSphere {
            what: what.to_string(),
            radius_m: self.radius_m,
            beside: beside.to_string(),
            beside_radius_m: other.radius_m,
        })
    }

    /// The local vertical at a place.
    pub fn up(&self, place: &Geodetic) -> Vector3<f64> {
        let (sin_lat, cos_lat) = place.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = place.lon_rad.sin_cos();
        Vector3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    }

    /// East, north and up at a place (also at the poles, where the longitude given decides what north is).
    pub fn body_from_enu(&self, place: &Geodetic) -> Rigid3<BodyFixed, Enu> {
        let (sin_lon, cos_lon) = place.lon_rad.sin_cos();
        let up = self.up(place);
        let east = Vector3::new(-sin_lon, cos_lon, 0.0);
        let north = up.cross(&east);
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[east, north, up]));
        Rigid3::new(axes, self.point(place))
    }

    /// Unit vector towards an azimuth (clockwise from north) and elevation at a place, in the body-fixed frame.
    pub fn direction(&self, place: &Geodetic, azimuth_rad: f64, elevation_rad: f64) -> Vector3<f64> {
        let (sin_az, cos_az) = azimuth_rad.sin_cos();
        let (sin_el, cos_el) = elevation_rad.sin_cos();
        self.body_from_enu(place).vector(&Vector3::new(cos_el * sin_az, cos_el * cos_az, sin_el))
    }

    /// Azimuth (clockwise from north, `[0, 2π)`) and elevation of a body-fixed direction at a place, radians.
    pub fn azimuth_elevation(&self, place: &Geodetic, direction: &Vector3<f64>) -> (f64, f64) {
        let d = self.body_from_enu(place).inverse().vector(direction);
        (d.x.atan2(d.y).rem_euclid(std::f64::consts::TAU), d.z.atan2(d.x.hypot(d.y)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_radius_is_no_sphere_of_the_same_heights() {
        let old = Body::sphere("Moon", 1_738_000.0, "moon_me");
        let error = old.same_sphere("`a.tif`", &Body::moon(), "`b.tif`").unwrap_err();
        let says = "`a.tif` lies on a sphere of 1738000 m, `b.tif` on one of 1737400 m";
        assert_eq!(error.to_string(), says);
        assert!(Body::moon().same_sphere("`a.tif`", &Body::moon(), "`b.tif`").is_ok());
    }

    #[test]
    fn place_and_point_are_inverse() {
        let moon = Body::moon();
        for (lat, lon, h) in
            [(-89.9999, 33.0, -4000.0), (12.0, -170.0, 8000.0), (90.0, 0.0, 1.0), (0.0, 0.0, 0.0)]
        {
            let place = Geodetic::from_deg(lat, lon, h);
            let back = moon.place(&moon.point(&place));
            assert!((back.lat_rad - place.lat_rad).abs() < 1e-12);
            assert!((back.height_m - h).abs() < 1e-8);
            assert!((moon.point(&back) - moon.point(&place)).norm() < 1e-8);
        }
    }

    #[test]
    fn east_north_up_at_a_known_site() {
        let moon = Body::moon();
        // On the equator at 90° E: up = +Y, north = +Z, east = −X.
        let axes = moon.body_from_enu(&Geodetic::from_deg(0.0, 90.0, 0.0));
        assert!((axes.vector(&Vector3::x()) + Vector3::x()).norm() < 1e-15);
        assert!((axes.vector(&Vector3::y()) - Vector3::z()).norm() < 1e-15);
        assert!((axes.vector(&Vector3::z()) - Vector3::y()).norm() < 1e-15);
    }

    #[test]
    fn azimuth_runs_clockwise_from_north_and_round_trips() {
        let moon = Body::moon();
        let site = Geodetic::from_deg(-88.2, 105.5, 0.0);
        let east = moon.direction(&site, 90f64.to_radians(), 0.0);
        assert!((east - moon.body_from_enu(&site).vector(&Vector3::x())).norm() < 1e-12);
        let (az, el) = moon.azimuth_elevation(&site, &moon.direction(&site, 5.5, 0.2));
        assert!((az - 5.5).abs() < 1e-12 && (el - 0.2).abs() < 1e-12);
    }
}
