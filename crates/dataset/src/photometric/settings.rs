//! What pictures are believed to have been made with, and how well they must be met.

use crate::plan::SunAngles;
use selenograph_geometry::{Body, PixelConvention};
use selenograph_render::brdf::Brdf;
use serde::{Deserialize, Serialize};

/// What the pictures are believed to have been made with, and how well they must be met.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// The law.
    pub brdf: Brdf,
    /// One Sun per light.
    pub suns: Vec<SunAngles>,
    /// Standard deviation of the Gaussian point spread, pixels.
    pub psf_sigma_px: f64,
    /// Where the camera matrices put the first pixel's centre.
    pub k_convention: PixelConvention,
    /// The body.
    pub body: Body,
    /// How well they must be met.
    pub limits: Limits,
}

impl Default for Settings {
    /// The StereoLunar samples.
    fn default() -> Self {
        // The scripts write (150, 160), (250, 20), (360, 165) and use the second as elevation: a cosine below 0 turns
        // the azimuth round.
        let suns = [(330.0, 20.0), (250.0, 20.0), (180.0, 15.0)];
        Self {
            brdf: Brdf::default(),
            suns: suns.map(|(azimuth_deg, elevation_deg)| SunAngles { azimuth_deg, elevation_deg }).to_vec(),
            psf_sigma_px: 0.6,
            k_convention: PixelConvention::Corner,
            body: Body::moon(),
            limits: Limits::default(),
        }
    }
}

/// How well pictures must be met.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Every picture must correlate at least this well.
    pub min_pearson: f64,
    /// Their median must.
    pub min_median_pearson: f64,
    /// No picture may differ by more than this, root mean square, grey levels.
    pub max_rmse_levels: f64,
}

impl Default for Limits {
    /// What the right law and Sun reach on the StereoLunar samples, and no wrong one does.
    fn default() -> Self {
        Self { min_pearson: 0.98, min_median_pearson: 0.99, max_rmse_levels: 9.0 }
    }
}
