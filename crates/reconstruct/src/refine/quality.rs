//! What an elevation model holds, and how much below that is missing.

use crate::scale::dem::DemPatch;
use serde::Serialize;

/// An elevation model's own resolution and errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quality {
    /// Side of its cell on the ground, metres.
    pub cell_m: f64,
    /// Length below which it holds no relief, metres.
    pub resolution_m: f64,
    /// Standard deviation of the relief that it does not hold, metres.
    pub missing_relief_m: f64,
    /// Standard deviation of its heights, means over its resolution, metres.
    pub sigma_m: f64,
    /// Whether resolution and sigma were given, not estimated.
    pub given: [bool; 2],
}

/// Lags of second differences, in cells, up to this.
const MAX_LAG: usize = 256;
/// Relief that nodes a distance apart do not hold, in second differences at twice that distance: a half of the difference at the middle
/// between nodes, a little less elsewhere, on ground whose differences grow with the power 0.9.
const MISSING_SHARE: f64 = 0.11;
/// Error of means over the resolution, in the missing relief, where it is not given.
const SIGMA_SHARE: f64 = 0.3;
/// Least missing relief, in the resolution: of a model without relief nothing says more.
const LEAST_MISSING: f64 = 0.01;
/// Rows and columns looked at, at most.
const MAX_LINES: usize = 512;

impl Quality {
    /// Of a window of a model that holds relief from a length on.
    pub(super) fn of(
        window: &DemPatch,
        from_m: f64,
        resolution_m: Option<f64>,
        sigma_m: Option<f64>,
    ) -> Self {
        let cell_m = window.cell_m();
        let resolution = resolution_m.unwrap_or(from_m).max(cell_m);
        let lag = ((2.0 * resolution / cell_m).round() as usize).clamp(1, MAX_LAG);
        let difference = second_difference(window, lag).unwrap_or(0.0);
        let missing_relief_m = (MISSING_SHARE * difference).max(LEAST_MISSING * resolution);
        Self {
            cell_m,
            resolution_m: resolution,
            missing_relief_m,
            sigma_m: sigma_m.unwrap_or(SIGMA_SHARE * missing_relief_m),
            given: [resolution_m.is_some(), sigma_m.is_some()],
        }
    }

    /// In words, for people.
    pub(super) fn sentence(&self) -> String {
        let how = |k: usize| match (self.given[k], k) {
            (true, _) => "given",
            (false, 0) => "estimated by the pictures",
            (false, _) => "estimated from its relief",
        };
        format!(
            "the elevation model has cells of {:.3} m and shows relief from {:.1} m on ({}); sigma {:.2} m ({}), relief of {:.2} m is missing",
            self.cell_m,
            self.resolution_m,
            how(0),
            self.sigma_m,
            how(1),
            self.missing_relief_m
        )
    }
}

/// Root mean square of `h(x − lag) − 2 h(x) + h(x + lag)` along rows and columns, metres; `None` where there are hardly any.
fn second_difference(window: &DemPatch, lag: usize) -> Option<f64> {
    let heights = window.heights();
    let (mut sum, mut count) = (0.0f64, 0usize);
    let mut add = |before: f32, here: f32, after: f32| {
        let d = f64::from(before) - 2.0 * f64::from(here) + f64::from(after);
        if d.is_finite() {
            sum += d * d;
            count += 1;
        }
    };
    for y in (0..heights.height).step_by(heights.height.div_ceil(MAX_LINES).max(1)) {
        let row = heights.row(y);
        for x in lag..heights.width.saturating_sub(lag) {
            add(row[x - lag], row[x], row[x + lag]);
        }
    }
    for x in (0..heights.width).step_by(heights.width.div_ceil(MAX_LINES).max(1)) {
        for y in lag..heights.height.saturating_sub(lag) {
            add(heights[(x, y - lag)], heights[(x, y)], heights[(x, y + lag)]);
        }
    }
    (count > 0).then(|| (sum / count as f64).sqrt())
}
