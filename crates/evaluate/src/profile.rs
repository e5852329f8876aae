//! Agreement of two maps along rows.

use crate::agreement::Agreement;
use selenograph_raster::Raster;

/// Rows from one profile to the next.
pub const ROW_STEP: usize = 50;
/// Fewest samples of a profile.
pub const MIN_SAMPLES: usize = 10;

/// Agreement along one profile, or the mean of that over several.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileError {
    /// Mean absolute difference.
    pub mean_abs: f64,
    /// Pearson correlation; `None` where a profile is constant.
    pub correlation: Option<f64>,
}

/// Along the central row (number `height / 2`), where both maps have samples; `None` below ten of them.
pub fn central(a: &Raster<f64>, b: &Raster<f64>) -> Option<ProfileError> {
    row(a, b, a.height / 2)
}

/// Means over every 50th row from the first; rows with fewer than ten samples are left out, and `None` if all are.
pub fn spaced(a: &Raster<f64>, b: &Raster<f64>) -> Option<ProfileError> {
    let rows: Vec<ProfileError> = (0..a.height).step_by(ROW_STEP).filter_map(|y| row(a, b, y)).collect();
    let correlations: Vec<f64> = rows.iter().filter_map(|row| row.correlation).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    (!rows.is_empty()).then(|| ProfileError {
        mean_abs: mean(&rows.iter().map(|row| row.mean_abs).collect::<Vec<_>>()),
        correlation: (!correlations.is_empty()).then(|| mean(&correlations)),
    })
}

fn row(a: &Raster<f64>, b: &Raster<f64>, y: usize) -> Option<ProfileError> {
    if y >= a.height || y >= b.height {
        return None;
    }
    let agreement = Agreement::of(a.row(y).iter().copied().zip(b.row(y).iter().copied()))?;
    (agreement.count >= MIN_SAMPLES)
        .then_some(ProfileError { mean_abs: agreement.mean_abs, correlation: agreement.correlation })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_compared_where_both_are() {
        let a = Raster::from_fn(20, 120, |x, y| x as f64 * (1.0 + y as f64));
        let mut b = a.map(|v| v + 2.0);
        let found = central(&a, &b).unwrap();
        assert!((found.mean_abs - 2.0).abs() < 1e-12 && (found.correlation.unwrap() - 1.0).abs() < 1e-12);
        // Of the rows 0, 50 and 100 the first keeps too few samples.
        b.row_mut(0)[..11].fill(f64::NAN);
        b.row_mut(100).iter_mut().for_each(|v| *v += 2.0);
        assert!((spaced(&a, &b).unwrap().mean_abs - 3.0).abs() < 1e-12);
        b.row_mut(60).fill(f64::NAN);
        assert_eq!(central(&a, &b), None);
        assert_eq!(central(&Raster::filled(0, 0, 0.0), &Raster::filled(0, 0, 0.0)), None);
    }
}
