//! The Sun: a direction, a disc, a darkened limb.

use crate::Error;
use crate::trace::tangents;
use selenograph_geometry::units::sun_angular_radius_rad;
use selenograph_geometry::{Body, Geodetic, UnitVector3, Vector3};

/// The Sun as seen from the scene. Parallax over a scene is 1e-9 rad and is left out: one direction for all points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Towards the Sun's centre, body-fixed.
    pub direction: UnitVector3<f64>,
    /// Angular radius of the disc, radians; 0 is a point source.
    pub angular_radius_rad: f64,
    /// Linear limb darkening `I(μ)/I(1) = 1 − u (1 − μ)`; 0 is a uniform disc.
    pub limb_darkening: f64,
}

/// Linear coefficient of the Sun in visible light (550 nm).
///
/// # Source
/// Cox 2000, "Allen's astrophysical quantities", §14.7 (u₂ + v₂ ≈ 0.6 as a linear law).
pub const SOLAR_LIMB_DARKENING: f64 = 0.6;

impl Sun {
    /// The Sun at 1 au towards a vector.
    ///
    /// # Errors
    /// [`Error::Setting`] for a vector without direction.
    pub fn from_vector(direction: Vector3<f64>) -> Result<Self, Error> {
        let direction = UnitVector3::try_new(direction, 0.0)
            .filter(|d| d.iter().all(|v| v.is_finite()))
            .ok_or_else(|| Error::Setting {
                name: "sun direction",
                expected: "a finite non-zero vector",
                found: format!("{direction:?}"),
            })?;
        Ok(Self {
            direction,
            angular_radius_rad: sun_angular_radius_rad(),
            limb_darkening: SOLAR_LIMB_DARKENING,
        })
    }

    /// The Sun at 1 au in azimuth (clockwise from north) and elevation at a site.
    ///
    /// # Errors
    /// [`Error::Setting`] for angles that are not finite or an elevation beyond ±90°.
    pub fn at_site(
        body: &Body,
        site: &Geodetic,
        azimuth_rad: f64,
        elevation_rad: f64,
    ) -> Result<Self, Error> {
        if !azimuth_rad.is_finite()
            || elevation_rad.is_nan()
            || elevation_rad.abs() > std::f64::consts::FRAC_PI_2
        {
            return Err(Error::Setting {
                name: "sun elevation",
                expected: "-90 to 90 degrees and a finite azimuth",
                found: format!("{}°, azimuth {}°", elevation_rad.to_degrees(), azimuth_rad.to_degrees()),
            });
        }
        Self::from_vector(body.direction(site, azimuth_rad, elevation_rad))
    }

    /// The same Sun as a point source.
    pub fn as_point(mut self) -> Self {
        self.angular_radius_rad = 0.0;
        self
    }

    /// Brightness at a fraction `rho` of the disc's radius, relative to the disc's mean.
    pub(crate) fn disc_weight(&self, rho: f64) -> f64 {
        let mu = (1.0 - rho * rho).max(0.0).sqrt();
        (1.0 - self.limb_darkening * (1.0 - mu)) / (1.0 - self.limb_darkening / 3.0)
    }
}

/// A Sun with two directions across its disc.
pub(crate) struct SunDisc {
    pub(crate) sun: Sun,
    pub(crate) e1: Vector3<f64>,
    pub(crate) e2: Vector3<f64>,
}

impl SunDisc {
    pub(crate) fn new(sun: &Sun) -> Self {
        let (e1, e2) = tangents(&sun.direction);
        Self { sun: *sun, e1, e2 }
    }

    /// Direction to a place on the disc, given in units of its radius.
    pub(crate) fn towards(&self, disc: [f32; 2]) -> UnitVector3<f64> {
        let radius = self.sun.angular_radius_rad;
        let across = self.e1 * (radius * f64::from(disc[0])) + self.e2 * (radius * f64::from(disc[1]));
        UnitVector3::new_normalize(self.sun.direction.into_inner() + across)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_disc_weight_averages_to_one() {
        let sun = Sun::from_vector(Vector3::x()).unwrap();
        let n = 100_000;
        // Uniform over the disc's area: rho = sqrt(u).
        let rho = |k: i32| ((f64::from(k) + 0.5) / f64::from(n)).sqrt();
        let mean = (0..n).map(|k| sun.disc_weight(rho(k))).sum::<f64>() / f64::from(n);
        assert!((mean - 1.0).abs() < 1e-6);
        assert!(sun.disc_weight(0.0) > 1.2 && sun.disc_weight(1.0) < 0.51);
    }

    #[test]
    fn bad_directions_are_refused() {
        assert!(Sun::from_vector(Vector3::zeros()).is_err());
        assert!(Sun::from_vector(Vector3::new(f64::NAN, 0.0, 1.0)).is_err());
        let site = Geodetic::from_deg(-88.0, 0.0, 0.0);
        assert!(Sun::at_site(&Body::moon(), &site, 0.0, 2.0).is_err());
    }
}
