//! Distance between answer and truth, pixel by pixel, with what a pixel without answer counts as.

/// Errors over the pixels of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointError {
    /// Mean over all pixels.
    pub mean: f64,
    /// Median over all pixels.
    pub median: f64,
    /// Root mean square over all pixels.
    pub rmse: f64,
    /// Mean over answered pixels; `None` without any.
    pub mean_answered: Option<f64>,
    /// Share of answered pixels.
    pub coverage: f64,
}

/// Of pairs `(error of the answer, error that counts where there is none)`; `None` without a pixel. An absent answer is NaN.
pub fn point_error(pixels: impl Iterator<Item = (f64, f64)>) -> Option<PointError> {
    let (mut answered, mut answered_sum) = (0usize, 0.0);
    let mut errors: Vec<f64> = pixels
        .map(|(error, otherwise)| {
            if error.is_finite() {
                answered += 1;
                answered_sum += error;
                error
            } else {
                otherwise
            }
        })
        .collect();
    if errors.is_empty() {
        return None;
    }
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let rmse = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
    let middle = errors.len() / 2;
    let (below, upper, _) = errors.select_nth_unstable_by(middle, f64::total_cmp);
    let upper = *upper;
    let median = match below.iter().copied().reduce(f64::max) {
        Some(lower) if n % 2.0 == 0.0 => 0.5 * (lower + upper),
        _ => upper,
    };
    Some(PointError {
        mean,
        median,
        rmse,
        mean_answered: (answered > 0).then(|| answered_sum / answered as f64),
        coverage: answered as f64 / n,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_answer_counts_with_the_other_error() {
        let found =
            point_error([(1.0, 9.0), (f64::NAN, 5.0), (3.0, 9.0), (f64::NAN, 7.0)].into_iter()).unwrap();
        assert_eq!((found.mean, found.median, found.coverage), (4.0, 4.0, 0.5));
        assert_eq!((found.rmse, found.mean_answered), (21f64.sqrt(), Some(2.0)));
        let none = point_error([(f64::NAN, 2.0)].into_iter()).unwrap();
        assert_eq!((none.mean, none.coverage, none.mean_answered), (2.0, 0.0, None));
        assert_eq!(point_error(std::iter::empty()), None);
    }
}
