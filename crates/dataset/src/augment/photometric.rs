//! The published lunar augmentations of grey levels, in their order: bilateral filter, grey tint, contrast, colour jitter.
//!
//! Each is what the reference's libraries do to 8-bit pictures. Lunar pictures are grey, and stay so: of the colour jitter
//! only brightness and contrast can change them, since saturation and hue leave a grey pixel as it is.
//!
//! # Source
//! The run of the StereoLunar paper (ICCV 2025); OpenCV's documentation of `bilateralFilter`; Pillow's of `ImageEnhance` and
//! `Image.blend`.

use crate::rng::Stream;
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};

/// What is done how often. The defaults are the published run's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Photometric {
    /// Probability of the bilateral filter.
    pub bilateral_share: f64,
    /// Probability of the tint.
    pub tint_share: f64,
    /// Least factor of the tint; the largest is 1.
    pub tint_min: f64,
    /// Probability of a change of contrast.
    pub contrast_share: f64,
    /// Its factors.
    pub contrast_factors: Vec<f64>,
    /// The jitter's brightness and contrast factors lie this far round 1 (0: no jitter).
    pub jitter: f64,
}

impl Default for Photometric {
    fn default() -> Self {
        Self {
            bilateral_share: 0.5,
            tint_share: 0.3,
            tint_min: 0.3,
            contrast_share: 0.7,
            contrast_factors: vec![0.5, 1.0, 1.5],
            jitter: 0.5,
        }
    }
}

impl Photometric {
    /// One view's picture, changed by draws of its own.
    pub fn apply(&self, mut levels: Raster<u8>, stream: &mut Stream) -> Raster<u8> {
        // Every draw is made, so that switching one step off leaves the others as they were.
        let [bilateral_draw, tint_draw, contrast_draw] = std::array::from_fn(|_| stream.unit());
        let tint = stream.uniform(self.tint_min, 1.0);
        let factor = self.contrast_factors.get(stream.index(self.contrast_factors.len()));
        let around_one =
            |stream: &mut Stream| stream.uniform((1.0 - self.jitter).max(0.0), 1.0 + self.jitter);
        let (brightness, again) = (around_one(stream), around_one(stream));
        let brightness_first = stream.sign() > 0.0;
        if bilateral_draw < self.bilateral_share {
            levels = bilateral(&levels);
        }
        if tint_draw < self.tint_share {
            levels = levels.map(|level| (f64::from(*level) * tint) as u8);
        }
        if let Some(factor) = factor.filter(|_| contrast_draw < self.contrast_share) {
            contrast(&mut levels, *factor as f32);
        }
        if self.jitter > 0.0 && brightness_first {
            blend(&mut levels, 0, brightness as f32);
            contrast(&mut levels, again as f32);
        } else if self.jitter > 0.0 {
            contrast(&mut levels, again as f32);
            blend(&mut levels, 0, brightness as f32);
        }
        levels
    }
}

/// Every level moved away from one level by a factor, cut down to whole levels.
fn blend(levels: &mut Raster<u8>, from: u8, factor: f32) {
    for level in &mut levels.data {
        // The conversion cuts the fraction off and stays within a byte.
        *level = (f32::from(from) + factor * (f32::from(*level) - f32::from(from))) as u8;
    }
}

/// Contrast about the mean level.
fn contrast(levels: &mut Raster<u8>, factor: f32) {
    let sum: u64 = levels.data.iter().map(|level| u64::from(*level)).sum();
    let mean = (sum as f64 / levels.data.len().max(1) as f64).round() as u8;
    blend(levels, mean, factor);
}

/// Reach of the bilateral filter, pixels.
const RADIUS: i64 = 7;
/// Its spread over levels of a pixel's three channels together.
const SIGMA_COLOR: f32 = 75.0;
/// Its spread over pixels.
const SIGMA_SPACE: f32 = 100.0;

/// The bilateral filter of a colour picture whose channels are equal.
fn bilateral(levels: &Raster<u8>) -> Raster<u8> {
    // The difference of two colours is the sum of those of their channels.
    let by_level: [f32; 256] = std::array::from_fn(|step| {
        let difference = 3.0 * step as f32;
        (-0.5 * difference * difference / (SIGMA_COLOR * SIGMA_COLOR)).exp()
    });
    let offsets = || (-RADIUS..=RADIUS).flat_map(|dy| (-RADIUS..=RADIUS).map(move |dx| (dx, dy)));
    let taps: Vec<(i64, i64, f32)> = offsets()
        .filter(|(dx, dy)| dx * dx + dy * dy <= RADIUS * RADIUS)
        .map(|(dx, dy)| {
            let square = (dx * dx + dy * dy) as f32;
            (dx, dy, (-0.5 * square / (SIGMA_SPACE * SIGMA_SPACE)).exp())
        })
        .collect();
    let (width, height) = (levels.width, levels.height);
    // Mirrored about the border's pixels, once; in pictures smaller than the reach, the last pixel goes on.
    let mirrored = |n: i64, side: usize| {
        let last = side as i64 - 1;
        let n = if n < 0 { -n } else { n };
        (if n > last { 2 * last - n } else { n }).clamp(0, last) as usize
    };
    let reach = RADIUS as usize;
    let padded =
        Raster::from_fn(width + 2 * reach, height, |x, y| levels[(mirrored(x as i64 - RADIUS, width), y)]);
    let mut out = Raster::filled(width, height, 0);
    let (mut sums, mut weights) = (vec![0.0f32; width], vec![0.0f32; width]);
    for y in 0..height {
        sums.fill(0.0);
        weights.fill(0.0);
        let own = levels.row(y);
        for (dx, dy, near) in &taps {
            let other = &padded.row(mirrored(y as i64 + dy, height))[(RADIUS + dx) as usize..];
            for (((sum, total), own), other) in sums.iter_mut().zip(&mut weights).zip(own).zip(other) {
                let weight = near * by_level[usize::from(own.abs_diff(*other))];
                *sum += weight * f32::from(*other);
                *total += weight;
            }
        }
        for ((out, sum), weight) in out.row_mut(y).iter_mut().zip(&sums).zip(&weights) {
            *out = (sum / weight).round_ties_even() as u8;
        }
    }
    out
}

#[cfg(test)]
mod tests;
