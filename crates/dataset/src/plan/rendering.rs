//! The parts of a campaign that say how a planned pair becomes pictures.

use super::interval::{Interval, check_number};
use crate::Error;
use selenograph_geometry::units::sun_angular_radius_rad;
use selenograph_render::brdf::Brdf;
use selenograph_render::sun::SOLAR_LIMB_DARKENING;
use selenograph_render::{Interpolation, Shadows, Tone};
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
        check_number("render.psf_sigma_px", self.psf_sigma_px, Interval::new(0.0, 16.0))?;
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

impl ToneKind {
    /// The name in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::PairGain => "pair-gain",
            Self::MinMax => "min-max",
        }
    }
}

/// `[tone]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ToneSection {
    /// Which rule.
    pub kind: ToneKind,
    /// Quantile of the radiance of both views that meets `level` (`pair-gain`; 0.995 by default).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quantile: Option<f64>,
    /// Share of full scale that the quantile becomes (`pair-gain`; 0.9 by default).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level: Option<f64>,
    /// 8 or 16 bits per grey level.
    pub bits: u8,
}

impl Default for ToneSection {
    fn default() -> Self {
        Self { kind: ToneKind::PairGain, quantile: None, level: None, bits: 16 }
    }
}

impl ToneSection {
    /// The renderer's form of it.
    pub fn tone(&self) -> Tone {
        match (self.kind, Tone::default()) {
            (ToneKind::PairGain, Tone::Gain { quantile, level }) => {
                Tone::Gain { quantile: self.quantile.unwrap_or(quantile), level: self.level.unwrap_or(level) }
            }
            (ToneKind::PairGain, other) => other,
            (ToneKind::MinMax, _) => Tone::MinMax,
        }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        if !matches!(self.bits, 8 | 16) {
            return Err(Error::Value {
                key: "tone.bits".into(),
                expected: "8 or 16".into(),
                found: self.bits.to_string(),
            });
        }
        for (key, value) in [("tone.quantile", self.quantile), ("tone.level", self.level)] {
            let Some(value) = value else { continue };
            if self.kind == ToneKind::MinMax {
                return Err(Error::Contradiction {
                    first: "tone.kind".into(),
                    second: key.into(),
                    why: "`min-max` stretches from the darkest to the brightest pixel and has nothing to set"
                        .into(),
                });
            }
            check_number(key, value, Interval::new(1e-3, 1.0))?;
        }
        Ok(())
    }
}

/// `[output]`: truth that takes room and is written only if asked for.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputSection {
    /// `a.in_b.exr`, `b.in_a.exr`: where each pixel's ground lies in the other view, and whether it is seen there.
    pub correspondence: bool,
    /// `a.l0.angles.exr`: incidence, emission and phase of each pixel under each Sun.
    pub angles: bool,
}
