//! What is recorded of a layer that was fitted.

use super::weight::Widths;
use serde::{Deserialize, Serialize};

/// What fitting a layer found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NestReport {
    /// Widths of the fade: each as wide as the steps along it ask for.
    pub widths: Widths,
    /// 99th percentile of |fine − coarse| at the rim and at holes, before fitting, metres.
    pub step_p99_m: f64,
    /// The largest, metres.
    pub step_max_m: f64,
    /// Largest |fitted − coarse| at the nodes of the rim, metres: rounding.
    pub rim_residual_m: f64,
    /// The same halfway between them, where the coarse surface may bend and the fine one does not, metres.
    pub rim_between_nodes_m: f64,
    /// Absent nodes that were filled from the coarser terrain.
    pub num_filled: u64,
}
