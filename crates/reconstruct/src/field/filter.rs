//! Filters of pictures: Gaussian windows, halving, cubic B-spline coefficients.

use rayon::prelude::*;
use selenograph_raster::Raster;

/// Rows that one task works on: fixed, so that sums do not depend on the number of threads.
pub(crate) const ROWS_PER_TASK: usize = 32;

/// Radius of a Gaussian window in standard deviations; beyond it lies 1 % of its weight.
const RADIUS_IN_SIGMAS: f32 = 2.6;

/// A sampled Gaussian with sum 1.
fn gaussian_kernel(sigma_px: f32) -> Vec<f32> {
    let radius = (RADIUS_IN_SIGMAS * sigma_px).ceil().max(1.0) as i32;
    let weights: Vec<f32> =
        (-radius..=radius).map(|i| (-0.5 * (i as f32 / sigma_px).powi(2)).exp()).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

/// `out += weight · row`.
fn add_scaled(out: &mut [f32], row: &[f32], weight: f32) {
    for (o, &v) in out.iter_mut().zip(row) {
        *o += weight * v;
    }
}

/// Convolution with a Gaussian, the outside taken as 0 (so that a mask and what it weighs are cut alike).
pub(crate) fn gaussian(source: &Raster<f32>, sigma_px: f32) -> Raster<f32> {
    if sigma_px <= 0.0 {
        return source.clone();
    }
    let (width, height) = (source.width, source.height);
    let kernel = gaussian_kernel(sigma_px);
    let radius = kernel.len() / 2;
    let mut out = Raster::filled(width, height, 0.0f32);
    out.data.par_chunks_mut(width * ROWS_PER_TASK).enumerate().for_each(|(task, rows)| {
        let mut padded = vec![0.0f32; width + 2 * radius];
        for (dy, out_row) in rows.chunks_exact_mut(width).enumerate() {
            let y = task * ROWS_PER_TASK + dy;
            let middle = &mut padded[radius..radius + width];
            middle.fill(0.0);
            for (j, &weight) in kernel.iter().enumerate() {
                if let Some(row) = (y + j).checked_sub(radius).filter(|&row| row < height) {
                    add_scaled(middle, source.row(row), weight);
                }
            }
            for (j, &weight) in kernel.iter().enumerate() {
                add_scaled(out_row, &padded[j..j + width], weight);
            }
        }
    });
    out
}

/// Half the size by the kernel `1 3 3 1`, which keeps corner-based coordinates a pure scale; an odd last row or column is
/// cut. Means are weighted by `mask`; a pixel over nothing is 0 with mask 0.
pub(crate) fn halve(image: &Raster<f32>, mask: &Raster<f32>) -> (Raster<f32>, Raster<f32>) {
    const TAPS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
    let (width, height) = (image.width / 2, image.height / 2);
    let mut means = Raster::filled(width, height, 0.0f32);
    let mut masks = Raster::filled(width, height, 0.0f32);
    let clamp = |i: usize, k: usize, count: usize| (2 * i + k).saturating_sub(1).min(count - 1);
    means.data.par_chunks_mut(width).zip(masks.data.par_chunks_mut(width)).enumerate().for_each(
        |(y, (mean_row, mask_row))| {
            for x in 0..width {
                let (mut sum, mut weight) = (0.0, 0.0);
                for (j, &wy) in TAPS.iter().enumerate() {
                    let row = clamp(y, j, image.height);
                    for (i, &wx) in TAPS.iter().enumerate() {
                        let at = (clamp(x, i, image.width), row);
                        let w = wx * wy * mask[at];
                        sum += w * image[at];
                        weight += w;
                    }
                }
                mean_row[x] = if weight > 0.0 { sum / weight } else { 0.0 };
                mask_row[x] = if weight > 0.5 { 1.0 } else { 0.0 };
            }
        },
    );
    (means, masks)
}

/// Twice the size (to `width × height`, at most one more than twice), by linear interpolation at corner-based coordinates,
/// times `scale`.
pub(crate) fn double(source: &Raster<f32>, width: usize, height: usize, scale: f32) -> Raster<f32> {
    let split = |i: usize, count: usize| {
        let position = ((i as f32 + 0.5) / 2.0 - 0.5).clamp(0.0, (count - 1) as f32);
        let first = (position as usize).min(count.saturating_sub(2));
        (first, (first + 1).min(count - 1), position - first as f32)
    };
    let mut out = Raster::filled(width, height, 0.0f32);
    out.data.par_chunks_mut(width).enumerate().for_each(|(y, out_row)| {
        let (top, bottom, fy) = split(y, source.height);
        let (upper, lower) = (source.row(top), source.row(bottom));
        for (x, o) in out_row.iter_mut().enumerate() {
            let (left, right, fx) = split(x, source.width);
            let above = upper[left] + fx * (upper[right] - upper[left]);
            let below = lower[left] + fx * (lower[right] - lower[left]);
            *o = scale * (above + fy * (below - above));
        }
    });
    out
}

/// Pole of the cubic B-spline's inverse filter.
///
/// # Source
/// Unser 1999, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing Magazine 16(6).
const SPLINE_POLE: f32 = -0.267_949_2;

/// Samples that [`spline_coefficients`] adds on each side.
pub(crate) const SPLINE_MARGIN: usize = 2;

/// Coefficients of the cubic B-spline through the samples, mirrored at the rim, with [`SPLINE_MARGIN`] more on each side.
pub(crate) fn spline_coefficients(image: &Raster<f32>) -> Raster<f32> {
    let (width, height) = (image.width, image.height);
    let mut c = image.clone();
    c.data.par_chunks_mut(width).for_each(filter_row);
    filter_columns(&mut c.data, width, height);
    let mirror = |i: usize, count: usize| {
        let i = i as i64 - SPLINE_MARGIN as i64;
        let last = count as i64 - 1;
        let i = if i < 0 { -i } else { i };
        (if i > last { 2 * last - i } else { i }).clamp(0, last) as usize
    };
    Raster::from_fn(width + 2 * SPLINE_MARGIN, height + 2 * SPLINE_MARGIN, |x, y| {
        c[(mirror(x, width), mirror(y, height))]
    })
}

/// Samples after which the pole's powers vanish in f32.
const SPLINE_HORIZON: usize = 14;

fn filter_row(row: &mut [f32]) {
    let z = SPLINE_POLE;
    let count = row.len();
    if count < 2 {
        return;
    }
    let gain = (1.0 - z) * (1.0 - 1.0 / z);
    let mut first = 0.0;
    let mut power = 1.0;
    for &v in row.iter().take(SPLINE_HORIZON) {
        first += power * v;
        power *= z;
    }
    row[0] = first;
    for i in 1..count {
        row[i] += z * row[i - 1];
    }
    row[count - 1] = z / (z * z - 1.0) * (row[count - 1] + z * row[count - 2]);
    for i in (0..count - 1).rev() {
        row[i] = z * (row[i + 1] - row[i]);
    }
    for v in row {
        *v *= gain;
    }
}

/// [`filter_row`] down all columns at once.
fn filter_columns(data: &mut [f32], width: usize, height: usize) {
    let z = SPLINE_POLE;
    if height < 2 {
        return;
    }
    let gain = (1.0 - z) * (1.0 - 1.0 / z);
    let mut first = vec![0.0f32; width];
    let mut power = 1.0;
    for row in data.chunks_exact(width).take(SPLINE_HORIZON) {
        add_scaled(&mut first, row, power);
        power *= z;
    }
    data[..width].copy_from_slice(&first);
    for y in 1..height {
        let (before, here) = data.split_at_mut(y * width);
        add_scaled(&mut here[..width], &before[(y - 1) * width..], z);
    }
    let (before, last) = data.split_at_mut((height - 1) * width);
    for (v, &above) in last.iter_mut().zip(&before[(height - 2) * width..]) {
        *v = z / (z * z - 1.0) * (*v + z * above);
    }
    for y in (0..height - 1).rev() {
        let (here, after) = data.split_at_mut((y + 1) * width);
        for (v, &below) in here[y * width..].iter_mut().zip(&after[..width]) {
            *v = z * (below - *v);
        }
    }
    for v in data {
        *v *= gain;
    }
}

/// Value and derivatives along x and y of the spline with `coefficients` at a position between pixel centres (0 at the first),
/// which must lie within the picture's centres.
#[inline]
pub(crate) fn spline_at(coefficients: &Raster<f32>, x: f32, y: f32) -> (f32, f32, f32) {
    let (ix, iy) = (x.floor(), y.floor());
    let (wx, dx) = spline_weights(x - ix);
    let (wy, dy) = spline_weights(y - iy);
    // The first of the four taps is one before the sample at or before the position.
    let start = (iy as usize + SPLINE_MARGIN - 1) * coefficients.width + ix as usize + SPLINE_MARGIN - 1;
    let (mut value, mut along_x, mut along_y) = (0.0, 0.0, 0.0);
    for j in 0..4 {
        let Some(&[a, b, c, d]) = coefficients.data[start + j * coefficients.width..].first_chunk::<4>()
        else {
            return (0.0, 0.0, 0.0);
        };
        let line = wx[0] * a + wx[1] * b + wx[2] * c + wx[3] * d;
        let slope = dx[0] * a + dx[1] * b + dx[2] * c + dx[3] * d;
        value += wy[j] * line;
        along_x += wy[j] * slope;
        along_y += dy[j] * line;
    }
    (value, along_x, along_y)
}

/// Weights of the four taps and their derivatives, at a fraction in [0, 1).
#[inline]
fn spline_weights(f: f32) -> ([f32; 4], [f32; 4]) {
    let g = 1.0 - f;
    let sixth = 1.0 / 6.0;
    let w0 = g * g * g * sixth;
    let w3 = f * f * f * sixth;
    let w1 = 2.0 / 3.0 - 0.5 * f * f * (2.0 - f);
    let w2 = 2.0 / 3.0 - 0.5 * g * g * (2.0 - g);
    ([w0, w1, w2, w3], [-0.5 * g * g, f * (1.5 * f - 2.0), g * (2.0 - 1.5 * g), 0.5 * f * f])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f32 sums over a few dozen terms of order 1.
    const ROUNDING: f32 = 2e-4;

    fn waves(width: usize, height: usize) -> Raster<f32> {
        Raster::from_fn(width, height, |x, y| (0.5 * x as f32).sin() + (0.3 * y as f32).cos() * 0.7)
    }

    #[test]
    fn the_spline_goes_through_its_samples_and_its_slopes_are_derivatives() {
        let image = waves(37, 29);
        let c = spline_coefficients(&image);
        for (x, y) in [(0, 0), (36, 28), (5, 17), (35, 1), (1, 27)] {
            assert!((spline_at(&c, x as f32, y as f32).0 - image[(x, y)]).abs() < ROUNDING, "{x} {y}");
        }
        let (x, y, step) = (11.3f32, 7.8f32, 0.01);
        let (_, dx, dy) = spline_at(&c, x, y);
        let numeric_x = (spline_at(&c, x + step, y).0 - spline_at(&c, x - step, y).0) / (2.0 * step);
        let numeric_y = (spline_at(&c, x, y + step).0 - spline_at(&c, x, y - step).0) / (2.0 * step);
        assert!((dx - numeric_x).abs() < 1e-3 && (dy - numeric_y).abs() < 1e-3);
        // A band-limited signal between the samples.
        assert!((spline_at(&c, x, y).0 - ((0.5 * x).sin() + (0.3 * y).cos() * 0.7)).abs() < 2e-3);
    }

    #[test]
    fn a_gaussian_keeps_the_sum_inside_and_halving_keeps_corner_coordinates() {
        let mut dot = Raster::filled(31, 31, 0.0f32);
        dot[(15, 15)] = 1.0;
        assert!((gaussian(&dot, 2.0).data.iter().sum::<f32>() - 1.0).abs() < ROUNDING);
        let ramp = Raster::from_fn(20, 10, |x, y| x as f32 + 0.5 + 3.0 * (y as f32 + 0.5));
        let (half, _) = halve(&ramp, &Raster::filled(20, 10, 1.0));
        // The value at half the corner coordinates is the same.
        assert!((half[(4, 2)] - (2.0 * 4.5 + 3.0 * 2.0 * 2.5)).abs() < ROUNDING);
        let back = double(&half, 20, 10, 1.0);
        assert!((back[(9, 5)] - ramp[(9, 5)]).abs() < ROUNDING);
    }
}
