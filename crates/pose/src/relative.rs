//! Relative pose of two views from matches, or the reason why none can be given.

use selenograph_geometry::{CamA, CamB, Point2, Rigid3};

/// One match, on the plane `z = 1` of each camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// In camera A.
    pub a: Point2<f64>,
    /// In camera B.
    pub b: Point2<f64>,
    /// Higher is better; only the order is used.
    pub score: f64,
}

/// A relative pose with what supports it.
#[derive(Debug, Clone)]
pub struct RelativePose {
    /// The motion, with a translation of length 1: an essential matrix gives a direction, not metres.
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
    /// Which matches agree with it.
    pub inliers: Vec<bool>,
    /// Root mean square Sampson distance of the inliers, on the plane `z = 1`.
    pub residual_rms: f64,
    /// Covariance of rotation (three components of a rotation vector applied in B, radians) and of the translation's direction
    /// (two components in its tangent plane, radians).
    pub covariance: nalgebra::SMatrix<f64, 5, 5>,
}

/// Why no relative pose can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CannotSay {
    /// Not enough matches for any estimate.
    #[error("{found} matches, at least {needed} are needed")]
    TooFewMatches {
        /// Matches that came in.
        found: usize,
        /// Matches that are needed.
        needed: usize,
    },
    /// No motion is shared by more matches than chance gives.
    #[error("only {inliers} of {matches} matches agree on a motion, as few as by chance")]
    NoConsensus {
        /// Matches that agree with the best motion.
        inliers: usize,
        /// Matches that came in.
        matches: usize,
    },
    /// The views differ by a rotation only (or not at all): there is no parallax, so no direction and no depth.
    #[error(
        "no parallax: the views differ by a rotation of {rotation_deg:.3}° only (residual {residual_px:.3} px)"
    )]
    NoParallax {
        /// The rotation between the views, degrees.
        rotation_deg: f64,
        /// What a pure rotation leaves unexplained, pixels.
        residual_px: f64,
    },
}
