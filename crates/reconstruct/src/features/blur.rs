//! Separable Gaussian blur.

use crate::dispatch::widest;
use rayon::prelude::*;
use selenograph_raster::Raster;

/// Rows of one piece of work: a fixed number, so that results do not depend on the threads.
const STRIP_ROWS: usize = 64;

/// Samples computed together: two registers of 16.
const BLOCK: usize = 32;

/// Half the kernel in standard deviations: what is cut off holds 0.3 %.
const REACH_SIGMAS: f64 = 3.0;

/// The centre of a normalised Gaussian kernel and the taps on one side of it.
pub fn half_kernel(sigma: f64) -> Vec<f32> {
    let reach = (REACH_SIGMAS * sigma).ceil().max(1.0) as usize;
    let taps: Vec<f64> = (0..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f64>();
    taps.iter().map(|tap| (tap / sum) as f32).collect()
}

/// A Gaussian blur; the rim is continued by its last sample. A `sigma` of 0 or less copies.
pub fn gaussian(source: &Raster<f32>, sigma: f64) -> Raster<f32> {
    if sigma <= 0.0 || source.data.is_empty() {
        return source.clone();
    }
    symmetric(source, &half_kernel(sigma))
}

/// Convolution by the same symmetric kernel (centre, then one side) along rows and columns.
pub fn symmetric(source: &Raster<f32>, half: &[f32]) -> Raster<f32> {
    let (width, height, reach) = (source.width, source.height, half.len() - 1);
    let mut out = Raster { width, height, data: vec![0.0f32; width * height] };
    let room = || (vec![0.0f32; width + 2 * reach], vec![0.0f32; (STRIP_ROWS + 2 * reach) * width]);
    out.data.par_chunks_mut(STRIP_ROWS * width).enumerate().for_each_init(
        room,
        |(padded, along_rows), (strip_idx, strip)| {
            let top = strip_idx * STRIP_ROWS;
            let rows = strip.len() / width;
            let along_rows = &mut along_rows[..(rows + 2 * reach) * width];
            for (i, target) in along_rows.chunks_exact_mut(width).enumerate() {
                let y = (top + i).saturating_sub(reach).min(height - 1);
                let row = source.row(y);
                padded[..reach].fill(row[0]);
                padded[reach..reach + width].copy_from_slice(row);
                padded[reach + width..].fill(row[width - 1]);
                convolve_row(padded, half, target);
            }
            convolve_columns(along_rows, width, half, strip);
        },
    );
    out
}

widest! {
    /// `out[x] = Σ half[|i|] · padded[x + reach + i]`.
    fn convolve_row(padded: &[f32], half: &[f32], out: &mut [f32]) = convolve_row_body
}

#[inline(always)]
fn convolve_row_body(padded: &[f32], half: &[f32], out: &mut [f32]) {
    let reach = half.len() - 1;
    let whole = out.len() / BLOCK * BLOCK;
    let mut x = 0;
    while x < whole {
        let mut sum = [0.0f32; BLOCK];
        let centre = &padded[x + reach..x + reach + BLOCK];
        for j in 0..BLOCK {
            sum[j] = half[0] * centre[j];
        }
        for i in 1..=reach {
            let tap = half[i];
            let (left, right) = (&padded[x + reach - i..][..BLOCK], &padded[x + reach + i..][..BLOCK]);
            for j in 0..BLOCK {
                sum[j] += tap * (left[j] + right[j]);
            }
        }
        out[x..x + BLOCK].copy_from_slice(&sum);
        x += BLOCK;
    }
    for x in whole..out.len() {
        let mut sum = half[0] * padded[x + reach];
        for i in 1..=reach {
            sum += half[i] * (padded[x + reach - i] + padded[x + reach + i]);
        }
        out[x] = sum;
    }
}

widest! {
    /// The same along columns: `source` has `reach` rows more than `out` on both sides.
    fn convolve_columns(source: &[f32], width: usize, half: &[f32], out: &mut [f32]) = convolve_columns_body
}

#[inline(always)]
fn convolve_columns_body(source: &[f32], width: usize, half: &[f32], out: &mut [f32]) {
    let reach = half.len() - 1;
    let whole = width / BLOCK * BLOCK;
    let mut y = 0;
    while (y + 1) * width <= out.len() {
        let target = &mut out[y * width..(y + 1) * width];
        let mut x = 0;
        while x < whole {
            let mut sum = [0.0f32; BLOCK];
            let centre = &source[(y + reach) * width + x..][..BLOCK];
            for j in 0..BLOCK {
                sum[j] = half[0] * centre[j];
            }
            for i in 1..=reach {
                let tap = half[i];
                let above = &source[(y + reach - i) * width + x..][..BLOCK];
                let below = &source[(y + reach + i) * width + x..][..BLOCK];
                for j in 0..BLOCK {
                    sum[j] += tap * (above[j] + below[j]);
                }
            }
            target[x..x + BLOCK].copy_from_slice(&sum);
            x += BLOCK;
        }
        for x in whole..width {
            let mut sum = half[0] * source[(y + reach) * width + x];
            for i in 1..=reach {
                sum += half[i] * (source[(y + reach - i) * width + x] + source[(y + reach + i) * width + x]);
            }
            target[x] = sum;
        }
        y += 1;
    }
}

/// Every second sample of every second row.
pub fn decimated(source: &Raster<f32>) -> Raster<f32> {
    let (width, height) = (source.width.div_ceil(2), source.height.div_ceil(2));
    let mut data = Vec::with_capacity(width * height);
    for row in source.rows().step_by(2) {
        data.extend(row.iter().step_by(2));
    }
    Raster { width, height, data }
}

/// Twice as many samples a side: sample `2i` is the source's sample `i`, those between are means of their neighbours.
pub fn doubled(source: &Raster<f32>) -> Raster<f32> {
    let (width, height) = (2 * source.width, 2 * source.height);
    let mut out = Raster { width, height, data: vec![0.0f32; width * height] };
    out.data.par_chunks_mut(2 * width.max(1)).enumerate().for_each(|(y, two)| {
        let (upper, between) = two.split_at_mut(width);
        let above = source.row(y);
        let below = source.row((y + 1).min(source.height - 1));
        for x in 0..source.width {
            let right = (x + 1).min(source.width - 1);
            upper[2 * x] = above[x];
            upper[2 * x + 1] = 0.5 * (above[x] + above[right]);
            between[2 * x] = 0.5 * (above[x] + below[x]);
            between[2 * x + 1] = 0.25 * (above[x] + above[right] + below[x] + below[right]);
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single precision over some twenty taps.
    const ROUNDING: f32 = 1e-5;

    #[test]
    fn constants_stay_and_an_impulse_becomes_the_kernel() {
        let flat = Raster { width: 45, height: 70, data: vec![0.25f32; 45 * 70] };
        assert!(gaussian(&flat, 2.3).data.iter().all(|v| (v - 0.25).abs() < ROUNDING));
        let mut impulse = Raster { width: 71, height: 131, data: vec![0.0f32; 71 * 131] };
        impulse[(35, 65)] = 1.0;
        let blurred = gaussian(&impulse, 1.7);
        let half = half_kernel(1.7);
        for (dx, dy) in [(0, 0), (1, 0), (0, 2), (3, 4), (5, 5)] {
            let expected = half[dx] * half[dy];
            for (x, y) in [(35 + dx, 65 + dy), (35 - dx, 65 - dy)] {
                assert!((blurred[(x, y)] - expected).abs() < ROUNDING, "{dx} {dy}");
            }
        }
    }

    #[test]
    fn sizes_change_where_samples_say() {
        let source = Raster::from_fn(5, 3, |x, y| (x + 10 * y) as f32);
        let twice = doubled(&source);
        assert_eq!((twice.width, twice.height), (10, 6));
        assert_eq!((twice[(4, 2)], twice[(5, 2)], twice[(4, 3)], twice[(9, 5)]), (12.0, 12.5, 17.0, 24.0));
        assert_eq!(decimated(&twice), source);
    }
}
