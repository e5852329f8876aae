//! Structural similarity of two maps, also where parts of them are absent.

use selenograph_raster::Raster;

/// Side of the uniform window.
pub const WINDOW: usize = 7;
const K1: f64 = 0.01;
const K2: f64 = 0.03;
/// Maps within a window that is summed: a, b, a², b², ab.
const NUM_SUMS: usize = 5;

/// Mean structural similarity over the windows of 7×7 that hold no absent sample of either map and do not leave the frame;
/// `None` if there is no such window or the maps have no range.
///
/// Without absent samples it is scikit-image's `structural_similarity(a, b, data_range = range of both together)`: uniform
/// window, sample covariance, K1 = 0.01, K2 = 0.03, three pixels cropped at each side.
///
/// # Source
/// Wang et al. 2004, "Image quality assessment: from error visibility to structural similarity", IEEE TIP 13(4), eq. 13.
pub fn ssim(a: &Raster<f64>, b: &Raster<f64>) -> Option<f64> {
    let (width, height) = (a.width, a.height);
    if width < WINDOW || height < WINDOW || (b.width, b.height) != (width, height) {
        return None;
    }
    let present = |idx: usize| a.data[idx].is_finite() && b.data[idx].is_finite();
    let (mut low, mut high, mut sum, mut count) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0usize);
    for idx in (0..width * height).filter(|&idx| present(idx)) {
        let (x, y) = (a.data[idx], b.data[idx]);
        (low, high) = (low.min(x).min(y), high.max(x).max(y));
        sum += x;
        count += 1;
    }
    let range = high - low;
    if !(range.is_finite() && range > 0.0) {
        return None;
    }
    // Squares of a radius of the Moon would leave the variance few digits.
    let shift = sum / count as f64;
    let c1 = (K1 * range).powi(2);
    let c2 = (K2 * range).powi(2);
    let mut total = 0.0;
    let mut num_windows = 0usize;
    let mut columns = vec![([0.0; NUM_SUMS], 0usize); width];
    for top in 0..=height - WINDOW {
        for (x, (sums, present_count)) in columns.iter_mut().enumerate() {
            (*sums, *present_count) = ([0.0; NUM_SUMS], 0);
            for idx in (top..top + WINDOW).map(|y| y * width + x).filter(|&idx| present(idx)) {
                let (p, q) = (a.data[idx] - shift, b.data[idx] - shift);
                for (sum, term) in sums.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                    *sum += term;
                }
                *present_count += 1;
            }
        }
        for window in columns.windows(WINDOW) {
            if window.iter().all(|(_, present_count)| *present_count == WINDOW) {
                total += of_window(window.iter().map(|(sums, _)| sums), shift, c1, c2);
                num_windows += 1;
            }
        }
    }
    (num_windows > 0).then(|| total / num_windows as f64)
}

fn of_window<'a>(columns: impl Iterator<Item = &'a [f64; NUM_SUMS]>, shift: f64, c1: f64, c2: f64) -> f64 {
    let n = (WINDOW * WINDOW) as f64;
    let mut means = [0.0; NUM_SUMS];
    for sums in columns {
        for (mean, sum) in means.iter_mut().zip(sums) {
            *mean += sum / n;
        }
    }
    let [a, b, aa, bb, ab] = means;
    let sample = n / (n - 1.0);
    let (var_a, var_b, cov) = (sample * (aa - a * a), sample * (bb - b * b), sample * (ab - a * b));
    let (mean_a, mean_b) = (a + shift, b + shift);
    (2.0 * mean_a * mean_b + c1) * (2.0 * cov + c2)
        / ((mean_a * mean_a + mean_b * mean_b + c1) * (var_a + var_b + c2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(phase: f64) -> Raster<f64> {
        Raster::from_fn(30, 20, |x, y| (0.4 * x as f64 + phase).sin() * 50.0 + 3.0 * y as f64 - 1.7374e6)
    }

    #[test]
    fn equal_maps_score_one_and_others_less() {
        assert!((ssim(&map(0.0), &map(0.0)).unwrap() - 1.0).abs() < 1e-9);
        let other = ssim(&map(0.0), &map(0.8)).unwrap();
        assert!(other < 0.99 && other > 0.0, "{other}");
    }

    #[test]
    fn windows_with_absent_samples_are_left_out() {
        let a = map(0.0);
        let mut b = a.clone();
        for x in 0..30 {
            b[(x, 9)] = f64::NAN;
        }
        // Rows 0..9 and 10..20 remain: what is wrong in one of them alone shows in its share.
        assert!((ssim(&a, &b).unwrap() - 1.0).abs() < 1e-9);
        b.data.iter_mut().skip(6 * 30).step_by(7).for_each(|v| *v = f64::NAN);
        b.data.iter_mut().take(6 * 30).step_by(7).for_each(|v| *v = f64::NAN);
        assert_eq!(ssim(&a, &b), None);
        assert_eq!(ssim(&Raster::filled(9, 9, 1.0), &Raster::filled(9, 9, 1.0)), None);
        assert_eq!(ssim(&Raster::filled(6, 9, 1.0), &Raster::filled(6, 9, 2.0)), None);
    }
}
