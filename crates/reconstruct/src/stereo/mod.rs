//! Dense stereo of two views with a known relative pose: one inverse depth a pixel, in both views.
//!
//! The unknown is the inverse z-depth along each pixel's ray, so that nothing needs to be rectified: a pixel with ray `r` and
//! inverse depth `ρ` is seen by the other camera along `R r + t ρ`, whatever the roll, tilt or scale between the two.
//! A plane through the seed matches is affine in ray coordinates; what is estimated is the bend over it. Coarse to fine, the
//! other picture is warped here through the present surface (a full warp: the window follows the ground), both are normalised
//! locally, and the linearised difference, gathered over a small window, is solved together with a thin plate.
//!
//! # Source
//! Bruhn, Weickert & Schnörr 2005, "Lucas/Kanade meets Horn/Schunck", IJCV 61(3); the second-order prior in the sense of
//! Trobin et al. 2008, "An unbiased second-order prior for high-accuracy motion estimation", DAGM.

pub(crate) mod estimate;
pub(crate) mod level;
mod options;
mod outcome;
mod seeds;
pub(crate) mod solver;
mod term;
mod warp;

pub use options::{Completion, StereoOptions};
pub use outcome::{Dense, DenseView};
pub use seeds::seeds_from_depth_z;

use crate::View;
use crate::matching::Match;
use selenograph_geometry::{CamA, CamB, Rigid3};

/// Why there is no dense answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Too few seed matches meet in front of both cameras.
    #[error("{found} seed matches meet in front of both cameras, at least {needed} are needed")]
    TooFewSeeds {
        /// Seeds that can be used.
        found: usize,
        /// Seeds that are needed.
        needed: usize,
    },
    /// The picture and the camera have different sizes, or the picture is too small.
    #[error("a picture of {found} where {expected} is expected")]
    Size {
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The motion has no baseline.
    #[error("no baseline between the views: there is no parallax to measure")]
    NoBaseline,
}

impl Error {
    /// What to do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::TooFewSeeds { .. } => {
                "use more features, or check that the relative pose belongs to these pictures"
            }
            Self::Size { .. } => "the camera must be that of the picture; both sides need 16 pixels",
            Self::NoBaseline => "depth needs two places of the camera",
        }
    }
}

/// Fewest seeds that fix a plane with one to spare.
const MIN_SEEDS: usize = 4;
/// Smallest side of a picture.
const MIN_SIDE: usize = 16;

/// Depth of both views from a relative pose and seed matches.
///
/// # Shapes and units
/// Depths and their sigmas are in the unit of the motion's translation. Memory: about 150 bytes a pixel of each view while it
/// runs (5 GB for two pictures of 4096²).
/// # Errors
/// [`Error`], if there is nothing to start from. A pair that shares no ground is no error: its confidence is 0.
pub fn dense(
    a: &View,
    b: &View,
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
    seeds: &[Match],
    options: &StereoOptions,
) -> Result<Dense, Error> {
    for view in [a, b] {
        let (width, height) = (view.image.width, view.image.height);
        if (width, height) != (view.camera.width, view.camera.height) || width.min(height) < MIN_SIDE {
            return Err(Error::Size {
                expected: format!("{}×{} (at least {MIN_SIDE})", view.camera.width, view.camera.height),
                found: format!("{width}×{height}"),
            });
        }
    }
    let baseline = cam_b_from_cam_a.origin().coords.norm();
    if baseline == 0.0 || !baseline.is_finite() {
        return Err(Error::NoBaseline);
    }
    let points = seeds::points(seeds, &a.camera, &b.camera, cam_b_from_cam_a);
    let found = points[0].len().min(points[1].len());
    let too_few = Error::TooFewSeeds { found, needed: MIN_SEEDS };
    if found < MIN_SEEDS {
        return Err(too_few);
    }
    let mut estimate = estimate::Estimate::start(a, b, cam_b_from_cam_a, &points, options).ok_or(too_few)?;
    estimate.run(options);
    Ok(outcome::assemble(&estimate, cam_b_from_cam_a, options))
}
