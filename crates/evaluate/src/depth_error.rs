//! Errors of z-depth, as the field reports them.

/// Bounds on the ratio of two depths: the field's three, and two that tell good ones apart.
pub const DELTAS: [f64; 5] = [1.25, 1.5625, 1.953_125, 1.01, 1.001];

/// Errors over paired depths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthError {
    /// Mean of `|z − z true| / z true`.
    pub abs_rel: f64,
    /// Root mean square of `z − z true`.
    pub rmse: f64,
    /// Standard deviation of `ln z − ln z true`.
    pub silog: f64,
    /// Share with a ratio below each of [`DELTAS`].
    pub deltas: [f64; 5],
}

/// Errors of depths `(predicted, true)` where both are finite and the true one positive; `None` if they never are. A predicted depth
/// behind the camera fails every bound and is left out of the logarithms.
///
/// # Source
/// Eigen et al. 2014, "Depth map prediction from a single image using a multi-scale deep network", §3.2 and 4.
pub fn depth_error(depths: impl Iterator<Item = (f64, f64)> + Clone) -> Option<DepthError> {
    let (mut count, mut num_logs) = (0usize, 0usize);
    let (mut rel, mut squares, mut log_sum) = (0.0, 0.0, 0.0);
    let mut below = [0usize; 5];
    let finite = depths.filter(|(z, truth)| z.is_finite() && truth.is_finite() && *truth > 0.0);
    for (z, truth) in finite.clone() {
        count += 1;
        rel += (z - truth).abs() / truth;
        squares += (z - truth).powi(2);
        if z > 0.0 {
            num_logs += 1;
            log_sum += (z / truth).ln();
            let ratio = (z / truth).max(truth / z);
            for (count, bound) in below.iter_mut().zip(DELTAS) {
                *count += usize::from(ratio < bound);
            }
        }
    }
    if count == 0 {
        return None;
    }
    let log_mean = log_sum / num_logs as f64;
    let log_squares: f64 =
        finite.filter(|(z, _)| *z > 0.0).map(|(z, truth)| ((z / truth).ln() - log_mean).powi(2)).sum();
    let n = count as f64;
    Some(DepthError {
        abs_rel: rel / n,
        rmse: (squares / n).sqrt(),
        silog: (log_squares / num_logs as f64).sqrt(),
        deltas: below.map(|count| count as f64 / n),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_a_few_depths() {
        let found =
            depth_error([(100.0, 100.0), (110.0, 100.0), (f64::NAN, 1.0), (-5.0, 10.0)].into_iter()).unwrap();
        assert!((found.abs_rel - (0.1 + 1.5) / 3.0).abs() < 1e-12);
        assert!((found.rmse - (325.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((found.silog - 0.5 * 1.1f64.ln()).abs() < 1e-12);
        assert_eq!(found.deltas, [2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0]);
        assert_eq!(depth_error(std::iter::empty()), None);
    }
}
