//! Units that configuration and reports use; the code computes in metres and radians.

/// One astronomical unit (IAU 2012 resolution B2), metres.
pub const ASTRONOMICAL_UNIT_M: f64 = 149_597_870_700.0;

/// Radius of the solar photosphere, metres (the value of the reference scripts, `696 342 km`).
pub(crate) const SUN_RADIUS_M: f64 = 696_342_000.0;

/// Angular radius of the Sun seen from 1 au, radians (0.2667°).
pub fn sun_angular_radius_rad() -> f64 {
    (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M).asin()
}

/// An angle brought into `[0, 360)` degrees.
pub fn wrap_360_deg(angle_deg: f64) -> f64 {
    let wrapped = angle_deg.rem_euclid(360.0);
    if wrapped >= 360.0 { 0.0 } else { wrapped }
}
