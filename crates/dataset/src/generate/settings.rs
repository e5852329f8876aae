//! The parts of a campaign that say how a planned pair becomes pictures.

use crate::Error;
use crate::plan::interval::{Interval, check_number};
use selenograph_geometry::units::sun_angular_radius_rad;
use selenograph_render::brdf::Brdf;
use selenograph_render::sun::SOLAR_LIMB_DARKENING;
use selenograph_render::{Interpolation, Shadows};
use serde::{Deserialize, Serialize};

/// `[render]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderSection {
    /// Rays per pixel of the images (the truth maps have one, through the pixel's centre).
    pub rays_per_pixel: u32,
    /// Standard deviation of the Gaussian point spread, pixels.
    pub psf_sigma_px: f64,
    /// Which shadows.
    pub shadows: Shadows,
    /// The surface between nodes.
    pub surface: Interpolation,
    /// Angular radius of the Sun (0: a point); by default that of the Sun at one astronomical unit.
    pub sun_angular_radius_deg: f64,
    /// Linear limb darkening of the Sun's disc (0: uniform).
    pub limb_darkening: f64,
    /// Scale of the reflectance (see the law's own meaning of albedo).
    pub albedo: f64,
    /// Reflectance law.
    pub brdf: Brdf,
}

impl Default for RenderSection {
    fn default() -> Self {
        Self {
            rays_per_pixel: 64,
            psf_sigma_px: 0.6,
            shadows: Shadows::Cast,
            surface: Interpolation::Bilinear,
            sun_angular_radius_deg: sun_angular_radius_rad().to_degrees(),
            limb_darkening: SOLAR_LIMB_DARKENING,
            albedo: 1.0,
            brdf: Brdf::default(),
        }
    }
}

impl RenderSection {
    pub(crate) fn check(&self) -> Result<(), Error> {
        check_number("render.rays_per_pixel", self.rays_per_pixel.into(), Interval::new(1.0, 65_536.0))?;
        check_number("render.psf_sigma_px", self.psf_sigma_px, Interval::new(0.0, 100.0))?;
        check_number("render.sun_angular_radius_deg", self.sun_angular_radius_deg, Interval::new(0.0, 45.0))?;
        check_number("render.limb_darkening", self.limb_darkening, Interval::new(0.0, 1.0))?;
        check_number("render.albedo", self.albedo, Interval::new(0.0, 1e3))?;
        self.brdf.validate().map_err(|error| Error::Value {
            key: format!("render.brdf.{}", error.parameter),
            expected: error.expected,
            found: error.found.to_string(),
        })
    }
}

/// How radiance becomes grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneKind {
    /// One gain for both views under one light: photo-consistency holds.
    PairGain,
    /// Each image stretched between its own darkest and brightest pixel (the StereoLunar pictures).
    MinMax,
}

/// `[tone]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ToneSection {
    /// Which rule.
    pub kind: ToneKind,
    /// Percentile of the lit radiance of both views that meets full scale (`pair-gain`; 99.5 by default).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub percentile: Option<f64>,
    /// 8 or 16 bits per grey level.
    pub bits: u8,
}

impl Default for ToneSection {
    fn default() -> Self {
        Self { kind: ToneKind::PairGain, percentile: None, bits: 16 }
    }
}

impl ToneSection {
    /// Percentile where nothing else is said.
    pub const DEFAULT_PERCENTILE: f64 = 99.5;

    pub(crate) fn check(&self) -> Result<(), Error> {
        if !matches!(self.bits, 8 | 16) {
            return Err(Error::Value {
                key: "tone.bits".into(),
                expected: "8 or 16".into(),
                found: self.bits.to_string(),
            });
        }
        match (self.kind, self.percentile) {
            (ToneKind::MinMax, Some(_)) => Err(Error::Contradiction {
                first: "tone.kind".into(),
                second: "tone.percentile".into(),
                why: "`min-max` stretches to the brightest pixel, whatever the percentile".into(),
            }),
            (ToneKind::PairGain, Some(percentile)) => {
                check_number("tone.percentile", percentile, Interval::new(1.0, 100.0))
            }
            (_, None) => Ok(()),
        }
    }
}
