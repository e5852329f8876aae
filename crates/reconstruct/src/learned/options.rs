//! How pose and points follow from arrays.

use serde::{Deserialize, Serialize};

/// Where the relative pose comes from, unless it is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum PoseFrom {
    /// From the matches; from the points where they do not tell and the points are sure
    #[default]
    Matches,
    /// From the points of B: the pose from which they look as picture B has them
    Points,
    /// There is none: the points stand alone, unchecked
    Nothing,
}

/// Which points are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum PointsFrom {
    /// The network's own
    #[default]
    Network,
    /// Where the rays of dense matches meet, with their sigma
    Triangulated,
}

/// How pose and points follow from the arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LearnedOptions {
    /// Where the pose comes from.
    pub pose: PoseFrom,
    /// Which points are given.
    pub points: PointsFrom,
    /// Largest Sampson distance of an inlier, matched pixels.
    pub threshold_px: f64,
    /// Largest reprojection error of a point that agrees with a pose, matched pixels.
    pub reprojection_px: f64,
    /// Points below this confidence do not take part in a pose.
    pub min_confidence: f32,
    /// Seed of the random samples.
    pub seed: u64,
}

impl Default for LearnedOptions {
    fn default() -> Self {
        Self {
            pose: PoseFrom::Matches,
            points: PointsFrom::Network,
            threshold_px: 1.0,
            // The reference's own, and its confidence of 3 of `1 + exp(x)`, mapped to `[0, 1]`.
            reprojection_px: 5.0,
            min_confidence: 2.0 / 3.0,
            seed: 0,
        }
    }
}
