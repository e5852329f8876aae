//! How well two series agree, pixel by pixel.

/// Agreement of paired samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Pairs in which both samples are finite.
    pub count: usize,
    /// Pearson correlation; `None` where one series is constant.
    pub correlation: Option<f64>,
    /// Mean absolute difference.
    pub mean_abs: f64,
}

impl Agreement {
    /// Of the pairs in which both samples are finite; `None` if there is none.
    pub fn of(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> Option<Self> {
        let finite = pairs.filter(|(a, b)| a.is_finite() && b.is_finite());
        let (count, sum_a, sum_b, sum_abs) =
            finite.clone().fold((0usize, 0.0, 0.0, 0.0), |(n, a, b, abs), (x, y)| {
                (n + 1, a + x, b + y, abs + (x - y).abs())
            });
        if count == 0 {
            return None;
        }
        let n = count as f64;
        let (mean_a, mean_b) = (sum_a / n, sum_b / n);
        let (aa, bb, ab) = finite.fold((0.0, 0.0, 0.0), |(aa, bb, ab), (x, y)| {
            let (dx, dy) = (x - mean_a, y - mean_b);
            (aa + dx * dx, bb + dy * dy, ab + dx * dy)
        });
        let correlation = ab / (aa.sqrt() * bb.sqrt());
        Some(Self { count, correlation: Some(correlation).filter(|c| c.is_finite()), mean_abs: sum_abs / n })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_pairs_are_left_out() {
        let a = [1.0, 2.0, f64::NAN, 3.0, 4.0];
        let b = [2.0, 4.0, 1.0, 6.0, f64::NAN];
        let agreement = Agreement::of(a.into_iter().zip(b)).unwrap();
        assert_eq!((agreement.count, agreement.mean_abs), (3, 2.0));
        assert!((agreement.correlation.unwrap() - 1.0).abs() < 1e-15);
        assert_eq!(Agreement::of([(1.0, 2.0), (1.0, 3.0)].into_iter()).unwrap().correlation, None);
        assert_eq!(Agreement::of([(f64::NAN, 2.0)].into_iter()), None);
    }
}
