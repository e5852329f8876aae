//! Resizing of 8-bit pictures as the Python Imaging Library does it, which all published networks were trained with.
//!
//! Separable, antialiased convolution: first along rows, then along columns, each pass rounded to 8 bits; the filter is as
//! wide as the reduction asks for, and its weights are fixed-point numbers of 22 bits after the point.
//!
//! # Source
//! Pillow's documentation, "Concepts: Filters"; Lanczos windowed sinc of 3 lobes, Keys 1981 cubic convolution with a = −½.

use super::Rgb8;
use selenograph_geometry::pixel;
use serde::Serialize;

/// Bits after the point of a weight.
const PRECISION_BITS: u32 = 22;

/// How pixels between pixels are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// Three lobes.
    Lanczos,
    /// Keys's cubic convolution.
    Bicubic,
}

impl Filter {
    fn support(self) -> f64 {
        match self {
            Self::Lanczos => 3.0,
            Self::Bicubic => 2.0,
        }
    }

    fn weight(self, x: f64) -> f64 {
        let x = x.abs();
        match self {
            Self::Lanczos if x < 3.0 => sinc(x) * sinc(x / 3.0),
            Self::Bicubic if x < 1.0 => (1.5 * x - 2.5) * x * x + 1.0,
            Self::Bicubic if x < 2.0 => ((-x / 2.0 + 2.5) * x - 4.0) * x + 2.0,
            _ => 0.0,
        }
    }
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 {
        return 1.0;
    }
    let angle = x * std::f64::consts::PI;
    angle.sin() / angle
}

/// A picture in another size; neither side may be 0, which is made 1.
pub fn resize(picture: &Rgb8, width: usize, height: usize, filter: Filter) -> Rgb8 {
    let (width, height) = (width.max(1), height.max(1));
    let rows = if width == picture.width {
        picture.data.clone()
    } else {
        let taps = taps(picture.width, width, filter);
        let pass = |row: &[u8]| along_row(row, &taps);
        picture.data.chunks_exact(picture.width * 3).flat_map(pass).collect()
    };
    let data = if height == picture.height {
        rows
    } else {
        along_columns(&rows, width * 3, &taps(picture.height, height, filter))
    };
    Rgb8 { width, height, data }
}

/// The pixels that make one, and their weights.
struct Taps {
    first: usize,
    weights: Vec<i32>,
}

fn taps(from: usize, to: usize, filter: Filter) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    // Enlarging interpolates, reducing averages over as much more.
    let stretch = scale.max(1.0);
    let support = filter.support() * stretch;
    let place = |out: usize| {
        let center = pixel::center_of(out) * scale;
        let first = (center - support).round().max(0.0) as usize;
        let end = ((center + support).round() as usize).clamp(first + 1, from);
        let weights: Vec<f64> =
            (first..end).map(|idx| filter.weight((pixel::center_of(idx) - center) / stretch)).collect();
        let sum: f64 = weights.iter().sum();
        let one = f64::from(1u32 << PRECISION_BITS);
        Taps { first, weights: weights.iter().map(|weight| (weight / sum * one).round() as i32).collect() }
    };
    (0..to).map(place).collect()
}

/// Rounds a fixed-point sum to a byte.
fn to_byte(sum: i32) -> u8 {
    (sum >> PRECISION_BITS).clamp(0, 255) as u8
}

/// What a sum begins with, so that cutting the bits after the point rounds.
const ROUNDING: i32 = 1 << (PRECISION_BITS - 1);

fn along_row(row: &[u8], taps: &[Taps]) -> Vec<u8> {
    let mut out = Vec::with_capacity(taps.len() * 3);
    for tap in taps {
        let mut sums = [ROUNDING; 3];
        let pixels = row[tap.first * 3..].as_chunks::<3>().0;
        for (pixel, weight) in pixels.iter().zip(&tap.weights) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                *sum += i32::from(*value) * weight;
            }
        }
        out.extend(sums.map(to_byte));
    }
    out
}

fn along_columns(data: &[u8], stride: usize, taps: &[Taps]) -> Vec<u8> {
    let mut out = Vec::with_capacity(taps.len() * stride);
    let mut sums = vec![0; stride];
    for tap in taps {
        sums.fill(ROUNDING);
        let rows = data[tap.first * stride..].chunks_exact(stride);
        for (row, weight) in rows.zip(&tap.weights) {
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum += i32::from(*value) * weight;
            }
        }
        out.extend(sums.iter().map(|sum| to_byte(*sum)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_picture_stays_flat_in_every_size() {
        let picture = Rgb8::new(37, 23, [10, 128, 255].repeat(37 * 23)).unwrap();
        for filter in [Filter::Lanczos, Filter::Bicubic] {
            for (width, height) in [(1, 1), (16, 48), (37, 23), (100, 5)] {
                let resized = resize(&picture, width, height, filter);
                assert_eq!(
                    resized.data,
                    [10, 128, 255].repeat(width * height),
                    "{filter:?} {width}×{height}"
                );
            }
        }
    }

    #[test]
    fn the_same_size_changes_nothing() {
        let picture = Rgb8::new(9, 7, (0..9 * 7 * 3).map(|i| (i * 37 % 256) as u8).collect()).unwrap();
        assert_eq!(resize(&picture, 9, 7, Filter::Lanczos), picture);
    }
}
