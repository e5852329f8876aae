//! The Suns of a pair.

use super::interval::{Interval, check_number};
use crate::Error;
use crate::rng::Stream;
use selenograph_geometry::{Body, Geodetic, Vector3, units::wrap_360_deg};
use serde::{Deserialize, Serialize};

/// A number, or a range that one is drawn from for each pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Choice {
    /// The same for every pair.
    Fixed(f64),
    /// Drawn uniformly for each pair: `{ min = …, max = … }`.
    Drawn(Interval),
}

impl Choice {
    fn draw(&self, stream: &mut Stream) -> f64 {
        match self {
            // Draws too, so that fixing one number leaves the others as they were.
            Self::Fixed(value) => {
                let _ = stream.unit();
                *value
            }
            Self::Drawn(interval) => interval.draw(stream),
        }
    }

    fn check(&self, key: &str, bounds: Interval) -> Result<(), Error> {
        match self {
            Self::Fixed(value) => check_number(key, *value, bounds),
            Self::Drawn(interval) => interval.check(key, bounds),
        }
    }
}

/// One entry of `[[lights]]`: where a Sun stands at the pair's site.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Clockwise from north.
    pub azimuth_deg: Choice,
    /// Above the horizon of the sphere; below 0 the picture is dark.
    pub elevation_deg: Choice,
}

impl Light {
    /// The same Sun for every pair.
    pub fn fixed(azimuth_deg: f64, elevation_deg: f64) -> Self {
        Self { azimuth_deg: Choice::Fixed(azimuth_deg), elevation_deg: Choice::Fixed(elevation_deg) }
    }

    pub(super) fn check(&self, idx: usize) -> Result<(), Error> {
        self.azimuth_deg.check(&format!("lights[{idx}].azimuth_deg"), Interval::new(-720.0, 720.0))?;
        self.elevation_deg.check(&format!("lights[{idx}].elevation_deg"), Interval::new(-90.0, 90.0))
    }
}

/// A Sun of a planned pair: its place in the sky of the site.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SunAngles {
    /// Clockwise from north, degrees in `[0, 360)`.
    pub azimuth_deg: f64,
    /// Above the horizon, degrees.
    pub elevation_deg: f64,
}

impl SunAngles {
    /// Unit vector towards the Sun, body-fixed.
    pub fn direction(&self, body: &Body, site: &Geodetic) -> Vector3<f64> {
        body.direction(site, self.azimuth_deg.to_radians(), self.elevation_deg.to_radians())
    }
}

/// The Suns of one pair; `elevation_deg` replaces that of every light if given.
pub fn draw_suns(lights: &[Light], elevation_deg: Option<Interval>, stream: &mut Stream) -> Vec<SunAngles> {
    lights
        .iter()
        .map(|light| {
            let azimuth_deg = wrap_360_deg(light.azimuth_deg.draw(stream));
            let elevation_deg = match elevation_deg {
                Some(interval) => interval.draw(stream),
                None => light.elevation_deg.draw(stream),
            };
            SunAngles { azimuth_deg, elevation_deg }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::rng;

    /// The Sun that the reference scripts' `(azimuth, incidence)` really gives: they use the incidence as an elevation
    /// in sine and cosine, so that above 90° the azimuth flips.
    ///
    /// # Source
    /// `sun_position_local` of the StereoLunar trajectory scripts; confirmed on the sample pictures to 0.4°.
    fn sun_of_the_scripts(azimuth_deg: f64, incidence_deg: f64) -> SunAngles {
        let (sin_el, cos_el) = incidence_deg.to_radians().sin_cos();
        let flip = if cos_el < 0.0 { 180.0 } else { 0.0 };
        SunAngles {
            azimuth_deg: wrap_360_deg(azimuth_deg + flip),
            elevation_deg: sin_el.atan2(cos_el.abs()).to_degrees(),
        }
    }

    #[test]
    fn the_three_suns_of_the_paper() {
        for (az, inc, want_az, want_el) in
            [(150.0, 160.0, 330.0, 20.0), (250.0, 20.0, 250.0, 20.0), (360.0, 165.0, 180.0, 15.0)]
        {
            let sun = sun_of_the_scripts(az, inc);
            assert!((sun.azimuth_deg - want_az).abs() < 1e-9, "{sun:?}");
            assert!((sun.elevation_deg - want_el).abs() < 1e-9, "{sun:?}");
            // The same direction as the scripts' own formula.
            let (moon, site) = (Body::moon(), Geodetic::from_deg(-88.1, 33.0, 0.0));
            let (sin_az, cos_az) = f64::to_radians(az).sin_cos();
            let (sin_inc, cos_inc) = f64::to_radians(inc).sin_cos();
            let script =
                moon.body_from_enu(&site).vector(&Vector3::new(cos_inc * sin_az, cos_inc * cos_az, sin_inc));
            assert!((sun.direction(&moon, &site) - script).norm() < 1e-12);
        }
    }

    #[test]
    fn fixing_one_light_leaves_the_others() {
        let drawn = Choice::Drawn(Interval::new(1.0, 5.0));
        let lights = |first| [Light { azimuth_deg: first, elevation_deg: drawn }, Light::fixed(10.0, 3.0)];
        let a = draw_suns(&lights(Choice::Fixed(7.0)), None, &mut rng(1, "pair", 3, "sun"));
        let b =
            draw_suns(&lights(Choice::Drawn(Interval::new(0.0, 360.0))), None, &mut rng(1, "pair", 3, "sun"));
        assert_eq!(a[0].elevation_deg, b[0].elevation_deg);
        assert_eq!(a[1], b[1]);
        assert!((1.0..=5.0).contains(&a[0].elevation_deg));
    }
}
