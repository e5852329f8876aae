//! Resizing of pictures as the Python Imaging Library does it, which all published networks were trained with.
//!
//! Separable, antialiased convolution: first along rows, then along columns; the filter is as wide as the reduction asks for.
//! Bytes are rounded after each pass, and their weights are fixed-point numbers of 22 bits after the point; floats are kept.
//!
//! # Source
//! Pillow's documentation, "Concepts: Filters"; Lanczos windowed sinc of 3 lobes, Keys 1981 cubic convolution with a = −½.

use crate::Raster;
use selenograph_geometry::pixel;
use serde::Serialize;

/// Bits after the point of a weight for bytes.
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

/// What a pixel is made of: sums of weighted samples.
trait Sample: Copy {
    type Sum: Copy;
    type Weight: Copy;
    const START: Self::Sum;
    fn weight(weight: f64) -> Self::Weight;
    fn add(sum: &mut Self::Sum, sample: Self, weight: Self::Weight);
    fn finish(sum: Self::Sum) -> Self;
}

impl Sample for u8 {
    type Sum = i32;
    type Weight = i32;
    /// Cutting the bits after the point of what begins here rounds.
    const START: i32 = 1 << (PRECISION_BITS - 1);

    fn weight(weight: f64) -> i32 {
        (weight * f64::from(1u32 << PRECISION_BITS)).round() as i32
    }

    fn add(sum: &mut i32, sample: Self, weight: i32) {
        *sum += i32::from(sample) * weight;
    }

    fn finish(sum: i32) -> Self {
        (sum >> PRECISION_BITS).clamp(0, 255) as Self
    }
}

impl Sample for f32 {
    type Sum = Self;
    type Weight = Self;
    const START: Self = 0.0;

    fn weight(weight: f64) -> Self {
        weight as Self
    }

    fn add(sum: &mut Self, sample: Self, weight: Self) {
        *sum += sample * weight;
    }

    fn finish(sum: Self) -> Self {
        sum
    }
}

/// A picture of bytes in another size; neither side may be 0, which is made 1.
pub fn resize<const N: usize>(
    picture: &Raster<[u8; N]>,
    width: usize,
    height: usize,
    filter: Filter,
) -> Raster<[u8; N]> {
    convolve(picture, width.max(1), height.max(1), filter)
}

/// A picture of floats in another size, not clipped; neither side may be 0, which is made 1.
pub fn resize_float(picture: &Raster<f32>, width: usize, height: usize, filter: Filter) -> Raster<f32> {
    let samples = picture.map(|value| [*value]);
    convolve(&samples, width.max(1), height.max(1), filter).map(|[value]| *value)
}

fn convolve<S: Sample, const N: usize>(
    picture: &Raster<[S; N]>,
    width: usize,
    height: usize,
    filter: Filter,
) -> Raster<[S; N]> {
    let rows = if width == picture.width {
        picture.data.clone()
    } else {
        let taps = taps::<S>(picture.width, width, filter);
        picture.rows().flat_map(|row| along_row(row, &taps)).collect()
    };
    let data = if height == picture.height {
        rows
    } else {
        along_columns(&rows, width, &taps::<S>(picture.height, height, filter))
    };
    Raster { width, height, data }
}

/// The pixels that make one, and their weights.
struct Taps<S: Sample> {
    first: usize,
    weights: Vec<S::Weight>,
}

fn taps<S: Sample>(from: usize, to: usize, filter: Filter) -> Vec<Taps<S>> {
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
        Taps { first, weights: weights.iter().map(|weight| S::weight(weight / sum)).collect() }
    };
    (0..to).map(place).collect()
}

fn along_row<S: Sample, const N: usize>(row: &[[S; N]], taps: &[Taps<S>]) -> Vec<[S; N]> {
    let mut out = Vec::with_capacity(taps.len());
    for tap in taps {
        let mut sums = [S::START; N];
        for (pixel, weight) in row[tap.first..].iter().zip(&tap.weights) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                S::add(sum, *value, *weight);
            }
        }
        out.push(sums.map(S::finish));
    }
    out
}

fn along_columns<S: Sample, const N: usize>(data: &[[S; N]], width: usize, taps: &[Taps<S>]) -> Vec<[S; N]> {
    let mut out = Vec::with_capacity(taps.len() * width);
    let mut sums = vec![[S::START; N]; width];
    for tap in taps {
        sums.fill([S::START; N]);
        let rows = data[tap.first * width..].chunks_exact(width);
        for (row, weight) in rows.zip(&tap.weights) {
            for (sum, value) in sums.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
                S::add(sum, *value, *weight);
            }
        }
        out.extend(sums.iter().map(|sum| sum.map(S::finish)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_picture_stays_flat_in_every_size() {
        let picture = Raster::filled(37, 23, [10, 128, 255]);
        for filter in [Filter::Lanczos, Filter::Bicubic] {
            for (width, height) in [(1, 1), (16, 48), (37, 23), (100, 5)] {
                let resized = resize(&picture, width, height, filter);
                assert_eq!(
                    resized,
                    Raster::filled(width, height, [10, 128, 255]),
                    "{filter:?} {width}×{height}"
                );
            }
        }
    }

    #[test]
    fn the_same_size_changes_nothing() {
        let picture = Raster::from_fn(9, 7, |x, y| [(x * 37 + y * 91) as u8; 3]);
        assert_eq!(resize(&picture, 9, 7, Filter::Lanczos), picture);
    }

    #[test]
    fn floats_are_what_bytes_round() {
        // Two passes, each rounded to a byte, and an overshoot carried on where bytes clip it.
        const TWO_ROUNDINGS: f32 = 1.25;
        let bytes = Raster::from_fn(40, 30, |x, y| [(60 + x * 37 % 89 + y * 53 % 71) as u8]);
        let floats = bytes.map(|[value]| f32::from(*value));
        for (filter, width, height) in [(Filter::Lanczos, 17, 12), (Filter::Bicubic, 63, 50)] {
            let (whole, exact) =
                (resize(&bytes, width, height, filter), resize_float(&floats, width, height, filter));
            for ([byte], exact) in whole.data.iter().zip(&exact.data) {
                assert!((f32::from(*byte) - exact).abs() < TWO_ROUNDINGS, "{byte} {exact}");
            }
        }
    }
}
