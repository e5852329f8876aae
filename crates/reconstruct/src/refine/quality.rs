//! What an elevation model shows, judged by itself: how fine its relief is, and how much below that is missing.

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

/// Lags of second differences, in cells, are powers of two up to this.
const MAX_LAG: usize = 64;
/// Rough ground has second differences that grow with their lag to a power below 1, smooth ground to the power 2, ground between
/// interpolated nodes to the power 1.5: below this one the model shows relief of its own.
const SHOWS_RELIEF: f64 = 1.2;
/// Relief that nodes a distance apart do not hold, in second differences at twice that distance: a half of the difference at the middle
/// between nodes, a little less elsewhere, on ground whose differences grow with the power 0.9.
const MISSING_SHARE: f64 = 0.11;
/// Error of means over the resolution, in the missing relief, where it is not given.
const SIGMA_SHARE: f64 = 0.1;
/// Least missing relief, in cells: rounding of stored heights, and a model without relief.
const LEAST_MISSING: f64 = 0.02;
/// Rows and columns looked at, at most.
const MAX_LINES: usize = 512;

impl Quality {
    /// Judges a window of a model; what is given takes the place of estimates.
    pub(super) fn of(window: &DemPatch, resolution_m: Option<f64>, sigma_m: Option<f64>) -> Self {
        let cell_m = window.cell_m();
        let differences: Vec<(f64, f64)> = std::iter::successors(Some(1), |lag| Some(2 * lag))
            .take_while(|lag| *lag <= MAX_LAG)
            .map_while(|lag| Some((lag as f64, second_difference(window, lag)?)))
            .collect();
        let shows = differences.windows(2).find(|pair| pair[1].1 < pair[0].1 * 2f64.powf(SHOWS_RELIEF));
        let estimated = shows.or(differences.windows(2).last()).map_or(1.0, |pair| pair[0].0);
        let resolution_m_ = resolution_m.unwrap_or(estimated * cell_m).max(cell_m);
        let at_twice = differences.iter().find(|(lag, _)| *lag * cell_m >= 1.99 * resolution_m_);
        let (lag, difference) = at_twice.or(differences.last()).copied().unwrap_or((1.0, 0.0));
        // Where the window is too small for that lag, the nearest one says it.
        let scaled = difference * (2.0 * resolution_m_ / (lag * cell_m)).min(1.0);
        let missing_relief_m = (MISSING_SHARE * scaled).max(LEAST_MISSING * cell_m);
        Self {
            cell_m,
            resolution_m: resolution_m_,
            missing_relief_m,
            sigma_m: sigma_m.unwrap_or(SIGMA_SHARE * missing_relief_m),
            given: [resolution_m.is_some(), sigma_m.is_some()],
        }
    }

    /// In words, for people.
    pub(super) fn sentence(&self) -> String {
        let how = |given: bool| if given { "given" } else { "estimated from its relief" };
        format!(
            "the elevation model has cells of {:.3} m and shows relief from {:.1} m on ({}); sigma {:.2} m ({}), relief of {:.2} m is missing",
            self.cell_m,
            self.resolution_m,
            how(self.given[0]),
            self.sigma_m,
            how(self.given[1]),
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
    (count >= MAX_LAG).then(|| (sum / count as f64).sqrt())
}
