//! Settings of dense stereo.

use serde::{Deserialize, Serialize};

/// What is given where nothing was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Completion {
    /// Nothing.
    None,
    /// Shadows and hidden ground that lie in both frames and near measured ground are bridged by the plate.
    #[default]
    Holes,
    /// Every pixel, also outside the overlap, where the surface is carried on.
    Everywhere,
}

/// Settings of dense stereo. The defaults were chosen on rendered pairs, not on any real or public sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StereoOptions {
    /// Smaller side of the coarsest picture, pixels: as many halvings as keep it.
    pub coarsest_px: usize,
    /// Gaussian that both pictures are smoothed with, pixels.
    pub presmooth_px: f32,
    /// Standard deviation of the window in which gain and offset are removed, pixels.
    pub normalise_sigma_px: f32,
    /// Standard deviation of the window in which the data term is gathered, pixels.
    pub window_sigma_px: f32,
    /// Grey-level noise, as a share of the picture's standard deviation: contrast below it counts less.
    pub noise_floor: f32,
    /// Residual of the normalised grey levels that counts half.
    pub robust_scale: f32,
    /// Weight of the thin plate against the data.
    pub smoothness: f32,
    /// Warps at the finest level.
    pub warps: usize,
    /// Warps at each coarser level, where they cost little and the large errors go.
    pub coarse_warps: usize,
    /// Conjugate-gradient steps per warp at the finest level.
    pub iterations: usize,
    /// Conjugate-gradient steps per warp at each coarser level.
    pub coarse_iterations: usize,
    /// Difference of the two views' surfaces, in pixels of parallax, beyond which a pixel counts as hidden.
    pub consistency_px: f32,
    /// Levels from this one on do not look for hidden pixels (0 is the finest).
    pub hidden_from_level: usize,
    /// Power of the cosine of the emission angle that the plate's stiffness falls with.
    pub grazing_power: f32,
    /// Curvature (change of slope per pixel) beyond which the plate gives way.
    pub crease: f32,
    /// Standard deviation, in pixels of height (z-depth over focal length), up to which a pixel counts as measured.
    pub measured_sigma: f32,
    /// What the computed standard deviations are multiplied by: calibrated on rendered pairs.
    pub sigma_scale: f32,
    /// What is given where nothing was measured.
    pub completion: Completion,
    /// Weight of the thin plate against the seed matches.
    pub seed_smoothness: f32,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self {
            coarsest_px: 60,
            presmooth_px: 0.5,
            normalise_sigma_px: 4.0,
            window_sigma_px: 1.0,
            noise_floor: 0.05,
            robust_scale: 0.5,
            smoothness: 1.0,
            warps: 3,
            coarse_warps: 8,
            iterations: 8,
            coarse_iterations: 20,
            consistency_px: 2.0,
            hidden_from_level: 2,
            grazing_power: 3.0,
            crease: 0.1,
            measured_sigma: 1.5,
            sigma_scale: 1.2,
            completion: Completion::Holes,
            seed_smoothness: 0.01,
        }
    }
}
