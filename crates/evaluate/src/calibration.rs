//! Whether a method knows how wrong it is: coverage of its sigmas, and errors against its confidence.

use serde::{Deserialize, Serialize};

/// Central intervals of a Gaussian: expected share inside, and half width in sigmas.
const INTERVALS: [(f64, f64); 11] = [
    (0.1, 0.125_661_346_855_074_16),
    (0.2, 0.253_347_103_135_799_7),
    (0.3, 0.385_320_466_407_567_73),
    (0.4, 0.524_400_512_708_040_7),
    (0.5, 0.674_489_750_196_081_7),
    (0.6, 0.841_621_233_572_914_3),
    (0.7, 1.036_433_389_493_789_8),
    (0.8, 1.281_551_565_544_600_4),
    (0.9, 1.644_853_626_951_472_2),
    (0.95, 1.959_963_984_540_054),
    (0.99, 2.575_829_303_548_900_4),
];
/// Points of a sparsification curve, from nothing left out to 19 in 20.
const NUM_LEVELS: usize = 20;

/// Observed against expected coverage of central intervals.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Reliability {
    /// Expected share of errors inside the interval.
    pub expected: Vec<f64>,
    /// Observed share.
    pub observed: Vec<f64>,
}

/// Mean error of what remains when the least certain pixels are left out, over the mean error of all.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Sparsification {
    /// Share left out.
    pub left_out: Vec<f64>,
    /// In order of the method's certainty.
    pub by_method: Vec<f64>,
    /// In order of the error itself: the best any certainty can do.
    pub by_error: Vec<f64>,
}

/// What errors say of the sigmas that came with them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Mean absolute difference between the two columns of the curve.
    pub calibration_error: f64,
    /// Median sigma.
    pub sharpness: f64,
    /// Mean of `|error| / sigma`.
    pub mean_abs: f64,
    /// Root mean square of `error / sigma`.
    pub rms: f64,
}

/// Scores and curve of pairs `(error, sigma)`, with positive sigmas and finite numbers only; `None` without such a pair.
///
/// # Source
/// Kuleshov et al. 2018, "Accurate uncertainties for deep learning using calibrated regression", §3.
pub fn calibration(pairs: &[(f64, f64)]) -> Option<(Calibration, Reliability)> {
    let usable = |(error, sigma): &(f64, f64)| error.is_finite() && sigma.is_finite() && *sigma > 0.0;
    let (mut scores, mut sigmas): (Vec<f64>, Vec<f64>) =
        pairs.iter().filter(|pair| usable(pair)).map(|(error, sigma)| (error.abs() / sigma, *sigma)).unzip();
    if scores.is_empty() {
        return None;
    }
    let n = scores.len() as f64;
    let mean_abs = scores.iter().sum::<f64>() / n;
    let rms = (scores.iter().map(|s| s * s).sum::<f64>() / n).sqrt();
    let middle = sigmas.len() / 2;
    let sharpness = *sigmas.select_nth_unstable_by(middle, f64::total_cmp).1;
    scores.sort_unstable_by(f64::total_cmp);
    let expected: Vec<f64> = INTERVALS.iter().map(|(share, _)| *share).collect();
    let observed: Vec<f64> =
        INTERVALS.iter().map(|(_, sigmas)| scores.partition_point(|s| s <= sigmas) as f64 / n).collect();
    let off: f64 = expected.iter().zip(&observed).map(|(e, o)| (e - o).abs()).sum();
    let calibration_error = off / INTERVALS.len() as f64;
    let reliability = Reliability { expected, observed };
    Some((Calibration { calibration_error, sharpness, mean_abs, rms }, reliability))
}

/// Curves of pairs `(error, doubt)`, more doubt being less certain (a sigma, or a confidence with its sign turned), and the area
/// between them; `None` without a finite pair or without any error. Equal doubts are left out together, in parts.
///
/// # Source
/// Ilg et al. 2018, "Uncertainty estimates and multi-hypotheses networks for optical flow", §5 (AUSE).
pub fn sparsification(pairs: &[(f64, f64)]) -> Option<(f64, Sparsification)> {
    let finite = |(error, doubt): &&(f64, f64)| error.is_finite() && doubt.is_finite();
    let mut by_doubt: Vec<(f64, f64)> = pairs.iter().filter(finite).copied().collect();
    let mut errors: Vec<f64> = by_doubt.iter().map(|(error, _)| *error).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    if mean.is_nan() || mean <= 0.0 {
        return None;
    }
    by_doubt.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)));
    errors.sort_unstable_by(f64::total_cmp);
    let ordered: Vec<f64> = by_doubt
        .chunk_by(|a, b| a.1 == b.1)
        .flat_map(|tied| {
            let mean = tied.iter().map(|(error, _)| error).sum::<f64>() / tied.len() as f64;
            std::iter::repeat_n(mean, tied.len())
        })
        .collect();
    let left_out: Vec<f64> = (0..NUM_LEVELS).map(|level| level as f64 / NUM_LEVELS as f64).collect();
    let (by_method, by_error) = (remaining(&ordered, mean), remaining(&errors, mean));
    let gaps: Vec<f64> = by_method.iter().zip(&by_error).map(|(m, e)| m - e).collect();
    let area = gaps.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]) / NUM_LEVELS as f64).sum();
    Some((area, Sparsification { left_out, by_method, by_error }))
}

/// For each level, the mean of the first values that remain, over the mean of all.
fn remaining(ordered: &[f64], mean: f64) -> Vec<f64> {
    let mut sums = Vec::with_capacity(ordered.len());
    let mut sum = 0.0;
    for value in ordered {
        sum += value;
        sums.push(sum);
    }
    (0..NUM_LEVELS)
        .map(|level| {
            let kept = (ordered.len() * (NUM_LEVELS - level)).div_ceil(NUM_LEVELS).max(1);
            sums[kept - 1] / kept as f64 / mean
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_true_sigma_is_calibrated() {
        // Quantiles of a Gaussian by its intervals: as many errors in each as expected.
        let mut pairs = Vec::new();
        for (idx, window) in INTERVALS.windows(2).enumerate() {
            let count = ((window[1].0 - window[0].0) * 10_000.0).round() as usize;
            let inside = 0.5 * (window[0].1 + window[1].1);
            pairs.extend((0..count).map(|_| (if idx % 2 == 0 { inside } else { -inside } * 3.0, 3.0)));
        }
        pairs.extend((0..1000).map(|_| (0.1, 3.0)));
        pairs.extend((0..100).map(|_| (9.0, 3.0)));
        let (found, _) = calibration(&pairs).unwrap();
        assert!(found.calibration_error < 1e-12, "{found:?}");
        assert_eq!(found.sharpness, 3.0);
        let tight: Vec<(f64, f64)> = pairs.iter().map(|(e, s)| (*e, 0.1 * s)).collect();
        assert!(calibration(&tight).unwrap().0.calibration_error > 0.3);
        assert_eq!(calibration(&[(1.0, 0.0), (1.0, f64::NAN)]), None);
    }

    #[test]
    fn certainty_in_order_of_the_error_has_no_area() {
        let errors: Vec<f64> = (0..200).map(|i| f64::from(i * 37 % 200)).collect();
        let pairs = |doubt: &dyn Fn(f64) -> f64| errors.iter().map(|e| (*e, doubt(*e))).collect::<Vec<_>>();
        let (area, curve) = sparsification(&pairs(&|e| e)).unwrap();
        assert_eq!((area, curve.by_method[0]), (0.0, 1.0));
        // Doubt that says nothing leaves the mean where it is.
        let (constant, flat) = sparsification(&pairs(&|_| 1.0)).unwrap();
        assert!(flat.by_method.iter().all(|m| (m - 1.0).abs() < 1e-12));
        let (reversed, _) = sparsification(&pairs(&|e| -e)).unwrap();
        assert!(constant > 0.4 && reversed > 1.5 * constant, "{constant} {reversed}");
        assert_eq!(sparsification(&[(0.0, 1.0)]), None);
    }
}
