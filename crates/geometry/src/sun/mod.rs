//! Where the Sun stands over the Moon at a time, in closed form.
//!
//! # Source
//! Jean Meeus, "Astronomical algorithms", 2nd edition 1998: the Sun's longitude and distance (chapter 25), the Moon's place (the
//! leading terms of chapter 47), its optical and physical librations (chapter 53, after Eckhardt 1981). Those librations are of the
//! Moon's principal axes of inertia; here they lead to the mean-Earth axes, those of maps.

mod series;

use crate::time::Utc;
use crate::units::ASTRONOMICAL_UNIT_M;
use crate::{Body, Error, Geodetic};
use nalgebra::{Point3, Vector3};
use series::{Arguments, Ecliptic, Physical};

/// Standard deviation of the direction that [`sub_solar`] gives, radians (0.01°).
///
/// Measured in the tests: 0.003° against JPL's DE405 in the mean-Earth frame in 1971, at most 0.006° against the rotation elements of the
/// IAU from 1950 to 2100; the Sun's own longitude is known to 0.01° (Meeus, chapter 25). The Sun moves by that in 71 seconds.
pub const DIRECTION_SIGMA_RAD: f64 = 0.01 * std::f64::consts::PI / 180.0;

/// First and last years of [`sub_solar`]: those of spaceflight, and as far as TT − UTC is known to seconds.
const YEARS: (i32, i32) = (1950, 2100);

/// Where the Sun stands over the Moon: the point below it, and how far away it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubSolar {
    /// Latitude, radians.
    pub lat_rad: f64,
    /// East longitude, radians in `(-π, π]`.
    pub lon_rad: f64,
    /// From the Moon's centre to the Sun's, metres.
    pub distance_m: f64,
}

impl SubSolar {
    /// From degrees, at the mean distance of the Sun: one that is 2 % off turns the direction from a place on the Moon by 1e-5°.
    pub fn from_deg(lat_deg: f64, lon_deg: f64) -> Self {
        Self {
            lat_rad: lat_deg.to_radians(),
            lon_rad: within_half_turn(lon_deg),
            distance_m: ASTRONOMICAL_UNIT_M,
        }
    }

    /// The Sun's centre in the body-fixed frame, metres.
    pub fn position(&self) -> Point3<f64> {
        let below = Geodetic { lat_rad: self.lat_rad, lon_rad: self.lon_rad, height_m: 0.0 };
        Point3::from(Body::moon().up(&below) * self.distance_m)
    }

    /// Unit vector from a body-fixed point (metres) to the Sun's centre. The distance is finite: from the ground it stands up to
    /// 0.0007° lower than from the Moon's centre.
    pub fn direction_from(&self, point: &Point3<f64>) -> Vector3<f64> {
        (self.position() - point).normalize()
    }
}

/// The point of the Moon below the Sun in the mean-Earth frame (`moon_me`), with the direction as light arrives: aberration
/// is in it.
///
/// # Units
/// Radians and metres, the direction with a standard deviation of [`DIRECTION_SIGMA_RAD`].
/// # Errors
/// [`Error::TimeOutside`] for times before 1950 and after 2100.
/// # Source
/// See the module.
pub fn sub_solar(utc: Utc) -> Result<SubSolar, Error> {
    let (first, last) = YEARS;
    if !(f64::from(first)..f64::from(last)).contains(&utc.year()) {
        return Err(Error::TimeOutside { found: utc, first, last });
    }
    let arguments = Arguments::at(utc.julian_centuries_tt());
    Ok(below(&arguments, Physical::at(&arguments)))
}

fn below(arguments: &Arguments, physical: Physical) -> SubSolar {
    let (sun, moon) = (series::sun(arguments.centuries), series::moon(arguments));
    // The Moon as the Sun sees it.
    let apart = (sun.lon_deg - moon.lon_deg).to_radians();
    let share = moon.distance_m / sun.distance_m;
    let from_sun = Ecliptic {
        lon_deg: sun.lon_deg + 180.0 + share.to_degrees() * moon.lat_deg.to_radians().cos() * apart.sin(),
        lat_deg: share * moon.lat_deg,
        distance_m: sun.distance_m - moon.distance_m * moon.lat_deg.to_radians().cos() * apart.cos(),
    };
    let [lon_deg, lat_deg] = series::librations(arguments, physical, &from_sun).place_deg();
    SubSolar {
        lat_rad: lat_deg.to_radians(),
        lon_rad: within_half_turn(lon_deg),
        distance_m: from_sun.distance_m,
    }
}

/// A longitude in degrees as radians in `(-π, π]`.
fn within_half_turn(lon_deg: f64) -> f64 {
    let (sin, cos) = lon_deg.to_radians().sin_cos();
    sin.atan2(cos)
}

#[cfg(test)]
mod tests;
