//! Every metric of one pair: a prediction against the truth.

mod definitions;
mod measure;
mod measured;
mod prepared;
mod region;
mod surface;

pub use definitions::{Better, Definition, PairNumbers, RegionNumbers, Scope, definition, definitions};
pub use measure::measure;
pub use prepared::PreparedTruth;

use crate::calibration::{Reliability, Sparsification};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Rows of the reference protocol: the central 384 of 512.
pub const PAPER_ROWS: usize = 384;

/// What a method promises; what it does not promise is null, what it promises and does not give is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Promise {
    /// A relative pose only.
    Pose,
    /// Points in a unit of its own: a pixel without a point counts with the plane's error.
    #[default]
    Points,
    /// Points in metres.
    MetricPoints,
}

/// What is measured, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Only so many central rows of both views are measured; all where absent.
    pub central_rows: Option<usize>,
    /// Points of each cloud in the paper's form.
    pub num_sampled: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Every so many pixels along each axis gets a normal from its 30 nearest neighbours (which are taken from all).
    pub normals_stride: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { central_rows: None, num_sampled: 10_000, seed: 42, normals_stride: 2 }
    }
}

impl Settings {
    /// The central 384 rows, as the reference protocol has it.
    pub fn paper() -> Self {
        Self { central_rows: Some(PAPER_ROWS), ..Self::default() }
    }
}

/// Which pixels are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Region {
    /// Pixels whose true point is seen by both views.
    Overlap,
    /// All pixels with truth.
    Full,
}

/// What is a curve, not a number.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Curves {
    /// Of the sigmas.
    pub reliability: Option<Reliability>,
    /// By sigma.
    pub sigma_sparsification: Option<Sparsification>,
    /// By confidence.
    pub confidence_sparsification: Option<Sparsification>,
}

/// The metrics of one region.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RegionMetrics {
    /// The numbers; null where `missing` says why.
    #[serde(flatten)]
    pub numbers: RegionNumbers,
    /// What is a curve.
    #[serde(default)]
    pub curves: Curves,
    /// For each null, why.
    #[serde(default)]
    pub missing: BTreeMap<String, String>,
}

/// The metrics of a pair.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PairMetrics {
    /// The numbers of the pair as a whole.
    #[serde(flatten)]
    pub numbers: PairNumbers,
    /// Whether the method gave no pose (or one without a direction): a failure at every threshold.
    pub pose_failed: bool,
    /// Over the pixels that both views see.
    pub overlap: RegionMetrics,
    /// Over all pixels with truth.
    pub full: RegionMetrics,
    /// For each null at the top, why.
    #[serde(default)]
    pub missing: BTreeMap<String, String>,
}

impl PairMetrics {
    /// The larger of both pose errors, degrees; infinite for a failure.
    pub fn pose_error_deg(&self) -> f64 {
        let larger = self.numbers.rra_deg.map(|rra| rra.max(self.numbers.rta_deg.unwrap_or(0.0)));
        larger.filter(|_| !self.pose_failed).unwrap_or(f64::INFINITY)
    }

    /// The rotation error with a failure counted as infinite.
    pub fn rra_counted_deg(&self) -> f64 {
        self.numbers.rra_deg.filter(|_| !self.pose_failed).unwrap_or(f64::INFINITY)
    }

    /// The translation error with a failure counted as infinite; `None` where the true translation has no direction.
    pub fn rta_counted_deg(&self) -> Option<f64> {
        if self.pose_failed { Some(f64::INFINITY) } else { self.numbers.rta_deg }
    }

    /// The metrics of a region.
    pub fn region(&self, region: Region) -> &RegionMetrics {
        match region {
            Region::Overlap => &self.overlap,
            Region::Full => &self.full,
        }
    }
}
