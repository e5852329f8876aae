//! What is taken of a line.

use crate::bootstrap::Statistic;
use crate::pair_metrics::{PairMetrics, Region};
use crate::run::Line;
use serde::{Deserialize, Serialize};

/// Which pixels a method got and is measured on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Frame {
    /// The whole pictures.
    Full,
    /// The reference protocol: the central 384 of 512 rows.
    ReferenceRows,
}

/// Which of the two pose errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseAngle {
    /// Rotation.
    Rra,
    /// Direction of translation, sign kept.
    Rta,
    /// The larger of both.
    Worse,
}

/// What becomes of items without a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failures {
    /// They count as wrong at every threshold.
    Counted,
    /// They leave the denominator: what the paper's code does for its shares.
    LeftOut,
}

/// A number of a line, and how lines become one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// Share of items whose error is below a threshold (strictly).
    Below(Frame, PoseAngle, f64, Failures),
    /// Area under the curve of shares up to a threshold, over the threshold: the exact integral.
    Auc(Frame, PoseAngle, f64),
    /// The same in the form of the paper's code: bins of 0.1°, trapezoids.
    AucInBins(Frame, PoseAngle, f64),
    /// Median error of the items that have one.
    MedianError(Frame, PoseAngle),
    /// Share of items without a pose.
    Failed(Frame),
    /// Mean of a number of the pair as a whole.
    Pair(Frame, &'static str),
    /// Mean of a number of a region.
    Region(Frame, Region, &'static str),
}

/// Width of a bin of the paper's area under the curve, degrees.
const BIN_DEG: f64 = 0.1;

impl Quantity {
    /// Its value in a line; `None` where the line says nothing about it.
    pub fn of(&self, line: &Line) -> Option<f64> {
        let metrics = |frame: Frame| match frame {
            Frame::Full => Some(&line.metrics),
            Frame::ReferenceRows => line.reference_frame.as_ref(),
        };
        match *self {
            Self::Below(frame, angle, threshold_deg, failures) => {
                let metrics = metrics(frame)?;
                if metrics.pose_failed && failures == Failures::LeftOut {
                    return None;
                }
                Some(f64::from(u8::from(error_deg(metrics, angle)? < threshold_deg)))
            }
            Self::Auc(frame, angle, threshold_deg) => {
                Some((1.0 - error_deg(metrics(frame)?, angle)? / threshold_deg).max(0.0))
            }
            Self::AucInBins(frame, angle, threshold_deg) => {
                let num_bins = (threshold_deg / BIN_DEG).round();
                // The first edge beyond the error; the trapezoid before it holds half a bin.
                let edge = (error_deg(metrics(frame)?, angle)? / BIN_DEG).floor() + 1.0;
                Some(if edge <= num_bins { (num_bins - edge + 0.5) / num_bins } else { 0.0 })
            }
            Self::MedianError(frame, angle) => {
                error_deg(metrics(frame)?, angle).filter(|error| error.is_finite())
            }
            Self::Failed(frame) => Some(f64::from(u8::from(metrics(frame)?.pose_failed))),
            Self::Pair(frame, key) => metrics(frame)?.numbers.get(key).filter(|v| v.is_finite()),
            Self::Region(frame, region, key) => {
                metrics(frame)?.region(region).numbers.get(key).filter(|v| v.is_finite())
            }
        }
    }

    /// How its values become one.
    pub fn statistic(&self) -> Statistic {
        match self {
            Self::MedianError(..) => Statistic::Median,
            _ => Statistic::Mean,
        }
    }
}

/// Infinite for a failure; `None` where the truth has no such angle.
fn error_deg(metrics: &PairMetrics, angle: PoseAngle) -> Option<f64> {
    match angle {
        PoseAngle::Rra => Some(metrics.rra_counted_deg()),
        PoseAngle::Rta => metrics.rta_counted_deg(),
        PoseAngle::Worse => Some(metrics.pose_error_deg()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::lines::tests::line;

    #[test]
    fn failures_are_counted_or_left_out() {
        let (good, failed) = (line("sift", "a", 0, Some(1.0), 0.1), line("sift", "b", 0, None, 0.1));
        let below = |failures| Quantity::Below(Frame::Full, PoseAngle::Rra, 2.0, failures);
        assert_eq!(below(Failures::Counted).of(&good), Some(1.0));
        assert_eq!(below(Failures::Counted).of(&failed), Some(0.0));
        assert_eq!(below(Failures::LeftOut).of(&failed), None);
        assert_eq!(Quantity::Failed(Frame::Full).of(&failed), Some(1.0));
        assert_eq!(Quantity::Failed(Frame::ReferenceRows).of(&failed), None);
        // "Below" is strict, as in the paper's code.
        let at = line("sift", "a", 0, Some(2.0), 0.1);
        assert_eq!(below(Failures::Counted).of(&at), Some(0.0));
    }

    #[test]
    fn both_areas_agree_to_half_a_bin() {
        for error in [0.0, 0.02, 0.1, 1.23, 4.99, 5.0, 7.0] {
            let line = line("sift", "a", 0, Some(error), 0.1);
            let exact = Quantity::Auc(Frame::Full, PoseAngle::Worse, 5.0).of(&line).unwrap();
            let bins = Quantity::AucInBins(Frame::Full, PoseAngle::Worse, 5.0).of(&line).unwrap();
            assert!((exact - (1.0f64 - error / 5.0).max(0.0)).abs() < 1e-12);
            // Half a bin of 0.1° out of 5°, and rounding.
            assert!((exact - bins).abs() <= 0.01 + 1e-9, "{error}: {exact} {bins}");
        }
        let failed = line("sift", "a", 0, None, 0.1);
        assert_eq!(Quantity::Auc(Frame::Full, PoseAngle::Worse, 5.0).of(&failed), Some(0.0));
        assert_eq!(Quantity::AucInBins(Frame::Full, PoseAngle::Worse, 5.0).of(&failed), Some(0.0));
    }
}
