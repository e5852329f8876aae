//! Grey levels of any range on a common one, with what the picture does not say left out.

use selenograph_raster::Raster;
use selenograph_raster::resample::block_mean;

/// Quantile of the grey levels that becomes 0; its complement becomes 1.
const TAIL: f32 = 0.005;

/// Samples that the quantiles are taken from: enough for a tail of half a percent.
const QUANTILE_SAMPLES: usize = 1 << 14;

/// A picture on the range of its own quantiles, with its absent samples filled smoothly.
#[derive(Debug, Clone, PartialEq)]
pub struct Intensity {
    /// Grey levels: 0 at the 0.5 % quantile, 1 at the 99.5 % quantile, not clipped.
    pub image: Raster<f32>,
    /// Where samples were absent; `None` if none was.
    absent: Option<AbsentCount>,
}

/// Sums of absent samples over all rectangles from the corner.
#[derive(Debug, Clone, PartialEq)]
struct AbsentCount {
    width: usize,
    height: usize,
    /// `(width + 1) × (height + 1)`.
    sums: Vec<u32>,
}

impl Intensity {
    /// Stretches a picture; `None` where there is nothing to see: no finite sample, or all (but the tails) of one level.
    pub fn new(picture: &Raster<f32>) -> Option<Self> {
        let (low, high) = range(picture)?;
        let scale = 1.0 / (high - low);
        let mut image = picture.map(|&grey| if grey.is_finite() { (grey - low) * scale } else { f32::NAN });
        let absent = image.data.iter().any(|grey| !grey.is_finite()).then(|| {
            let counted = AbsentCount::new(&image);
            fill(&mut image);
            counted
        });
        Some(Self { image, absent })
    }

    /// Whether no absent sample lies within `radius` samples of a position between samples (as a square).
    pub fn is_known_around(&self, x: f64, y: f64, radius: f64) -> bool {
        self.absent.as_ref().is_none_or(|absent| absent.count(x, y, radius) == 0)
    }
}

/// The quantiles that become 0 and 1, from a fixed subset of the samples.
fn range(picture: &Raster<f32>) -> Option<(f32, f32)> {
    // A stride that shares no factor with common widths, so that the subset is no set of columns.
    let stride = (picture.data.len() / QUANTILE_SAMPLES).max(1) | 1;
    let mut sampled: Vec<f32> =
        picture.data.iter().step_by(stride).copied().filter(|v| v.is_finite()).collect();
    let last = sampled.len().checked_sub(1)?;
    let at = |fraction: f32| (fraction * last as f32).round() as usize;
    let low = *sampled.select_nth_unstable_by(at(TAIL), f32::total_cmp).1;
    let high = *sampled.select_nth_unstable_by(at(1.0 - TAIL), f32::total_cmp).1;
    (high > low && (1.0 / (high - low)).is_finite()).then_some((low, high))
}

impl AbsentCount {
    fn new(image: &Raster<f32>) -> Self {
        let (width, height) = (image.width, image.height);
        let stride = width + 1;
        let mut sums = vec![0u32; stride * (height + 1)];
        for (y, row) in image.rows().enumerate() {
            let mut along = 0;
            for (x, grey) in row.iter().enumerate() {
                along += u32::from(!grey.is_finite());
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + along;
            }
        }
        Self { width, height, sums }
    }

    fn count(&self, x: f64, y: f64, radius: f64) -> u32 {
        let span = |centre: f64, side: usize| {
            let low = (centre - radius).ceil().clamp(0.0, side as f64) as usize;
            let high = ((centre + radius).floor() + 1.0).clamp(0.0, side as f64) as usize;
            (low.min(high), high)
        };
        let ((left, right), (top, bottom)) = (span(x, self.width), span(y, self.height));
        let at = |x: usize, y: usize| self.sums[y * (self.width + 1) + x];
        at(right, bottom) + at(left, top) - at(right, top) - at(left, bottom)
    }
}

/// Fills absent samples from the means of ever larger blocks: smooth, so that the fill makes no features.
fn fill(image: &mut Raster<f32>) {
    let coarser = (image.width > 1 || image.height > 1).then(|| {
        let mut half = block_mean(image, 2);
        if half.data.iter().any(|grey| !grey.is_finite()) {
            fill(&mut half);
        }
        half
    });
    let Some(coarser) = coarser else {
        return;
    };
    let width = image.width;
    for (i, grey) in image.data.iter_mut().enumerate() {
        if !grey.is_finite() {
            *grey = coarser[(i % width / 2, i / width / 2)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_range_becomes_the_same_picture() {
        let picture = Raster::from_fn(64, 48, |x, y| ((x * 7 + y * 13) % 101) as f32);
        let plain = Intensity::new(&picture).unwrap();
        let dark = Intensity::new(&picture.map(|v| 3e-6 * v + 2e-5)).unwrap();
        for (a, b) in plain.image.data.iter().zip(&dark.image.data) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }

    #[test]
    fn pictures_of_one_level_are_refused() {
        for level in [0.0, 1.0, f32::NAN, f32::INFINITY] {
            assert!(Intensity::new(&Raster { width: 8, height: 8, data: vec![level; 64] }).is_none());
        }
        assert!(Intensity::new(&Raster { width: 0, height: 0, data: vec![] }).is_none());
    }

    #[test]
    fn absent_samples_are_filled_and_remembered() {
        let mut picture = Raster::from_fn(33, 21, |x, y| (x + 2 * y) as f32);
        for y in 4..9 {
            picture.row_mut(y)[10..17].fill(f32::NAN);
        }
        let known = Intensity::new(&picture).unwrap();
        assert!(known.image.data.iter().all(|v| v.is_finite()));
        assert!((known.image[(13, 6)] - known.image[(8, 6)]).abs() < 0.5);
        assert!(!known.is_known_around(13.0, 6.0, 0.0));
        assert!(!known.is_known_around(8.2, 6.0, 1.9));
        assert!(known.is_known_around(8.2, 6.0, 1.7));
        assert!(known.is_known_around(-30.0, 6.0, 1.7));
    }
}
