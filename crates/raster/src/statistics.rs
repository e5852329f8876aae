//! Extremes, means and quantiles of samples, absent ones (NaN) and infinite ones left out.

use serde::Serialize;

/// Extremes and moments of the finite samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Number of finite samples.
    pub count: usize,
    /// Number of NaN or infinite samples.
    pub num_absent: usize,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation (of the samples, divided by their number).
    pub sigma: f64,
}

/// Summary of the finite samples; `None` if there is none.
pub fn summary(samples: impl IntoIterator<Item = f64>) -> Option<Summary> {
    let (mut count, mut num_absent) = (0, 0);
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    // Welford's update: depths have means thousands of times their spread.
    let (mut mean, mut squares) = (0.0, 0.0);
    for sample in samples {
        if !sample.is_finite() {
            num_absent += 1;
            continue;
        }
        count += 1;
        min = min.min(sample);
        max = max.max(sample);
        let off = sample - mean;
        mean += off / count as f64;
        squares += off * (sample - mean);
    }
    let sigma = (squares / count as f64).sqrt();
    (count > 0).then_some(Summary { count, num_absent, min, max, mean, sigma })
}

/// Quantiles of the finite samples, linear between neighbours (numpy's default); `None` if there is none.
///
/// # Shapes and units
/// `fractions` in `[0, 1]` (others are clamped), one result each, in the samples' unit.
pub fn quantiles<const N: usize>(
    samples: impl IntoIterator<Item = f64>,
    fractions: [f64; N],
) -> Option<[f64; N]> {
    let mut sorted: Vec<f64> = samples.into_iter().filter(|sample| sample.is_finite()).collect();
    if sorted.is_empty() {
        return None;
    }
    sorted.sort_unstable_by(f64::total_cmp);
    let last = sorted.len() - 1;
    Some(fractions.map(|fraction| {
        let at = fraction.clamp(0.0, 1.0) * last as f64;
        let below = at.floor() as usize;
        let above = (below + 1).min(last);
        sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
    }))
}

/// Median of the finite samples.
pub fn median(samples: impl IntoIterator<Item = f64>) -> Option<f64> {
    quantiles(samples, [0.5]).map(|[median]| median)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_samples_are_counted_and_left_out() {
        let s = summary([2.0, f64::NAN, 4.0, f64::INFINITY, 9.0]).unwrap();
        assert_eq!((s.count, s.num_absent, s.min, s.max, s.mean), (3, 2, 2.0, 9.0, 5.0));
        assert!((s.sigma - (26f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!(summary([f64::NAN]).is_none() && median([]).is_none());
    }

    #[test]
    fn small_spread_on_a_large_mean_survives() {
        let s = summary((0..1000).map(|i| 1.7374e9 + f64::from(i % 2))).unwrap();
        assert!((s.sigma - 0.5).abs() < 1e-6);
    }

    #[test]
    fn quantiles_as_numpy_has_them() {
        // numpy.quantile([7, 1, 3, 10], [0, 0.25, 0.5, 0.98, 1]) = [1, 2.5, 5, 9.82, 10]
        let q = quantiles([7.0, f64::NAN, 1.0, 3.0, 10.0], [0.0, 0.25, 0.5, 0.98, 1.0]).unwrap();
        for (found, expected) in q.iter().zip([1.0, 2.5, 5.0, 9.82, 10.0]) {
            assert!((found - expected).abs() < 1e-12, "{q:?}");
        }
    }
}
