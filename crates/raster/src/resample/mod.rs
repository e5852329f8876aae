//! Values between and over pixels, absent ones (NaN) respected; pictures in another size.

pub mod pillow;

use crate::Raster;
use selenograph_geometry::pixel;

/// Bilinear value at continuous pixel coordinates (the first pixel's centre at (0.5, 0.5)).
///
/// `None` outside the rectangle of the pixel centres, and where a neighbour that counts is not finite.
pub fn bilinear(raster: &Raster<f32>, x: f64, y: f64) -> Option<f64> {
    let (column, fx) = split(pixel::sample_position(x), raster.width)?;
    let (row, fy) = split(pixel::sample_position(y), raster.height)?;
    let mut value = 0.0;
    for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
        for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
            // A neighbour without weight may be absent, or lie outside at the far edge.
            if wx * wy > 0.0 {
                value += wx * wy * f64::from(raster[(column + dx, row + dy)]);
            }
        }
    }
    value.is_finite().then_some(value)
}

/// Number of the sample at or before a position, and the fraction beyond it.
fn split(position: f64, count: usize) -> Option<(usize, f64)> {
    if !(position >= 0.0 && position <= count as f64 - 1.0) {
        return None;
    }
    let whole = position.floor();
    Some((whole as usize, position - whole))
}

/// Means over blocks of `factor × factor` pixels; NaN samples are left out, an empty block is NaN. Blocks cut off at
/// the right and lower edge count as they are.
///
/// A factor of 0 is taken as 1.
pub fn block_mean(raster: &Raster<f32>, factor: usize) -> Raster<f32> {
    let factor = factor.max(1);
    let (width, height) = (raster.width.div_ceil(factor), raster.height.div_ceil(factor));
    Raster::from_fn(width, height, |x, y| {
        let columns = x * factor..((x + 1) * factor).min(raster.width);
        let (mut sum, mut count) = (0.0, 0u32);
        for row in y * factor..((y + 1) * factor).min(raster.height) {
            for &sample in raster.row(row)[columns.clone()].iter().filter(|sample| !sample.is_nan()) {
                sum += f64::from(sample);
                count += 1;
            }
        }
        if count > 0 { (sum / f64::from(count)) as f32 } else { f32::NAN }
    })
}

/// Resizes to `width × height` by area-weighted means (any ratio, also enlarging); NaN samples are left out, and a
/// pixel over NaN only is NaN.
pub fn area_mean(raster: &Raster<f32>, width: usize, height: usize) -> Raster<f32> {
    let columns: Vec<_> = (0..width).map(|x| cover(x, width, raster.width)).collect();
    let rows: Vec<_> = (0..height).map(|y| cover(y, height, raster.height)).collect();
    Raster::from_fn(width, height, |x, y| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for &(row, wy) in &rows[y] {
            for &(column, wx) in &columns[x] {
                let sample = raster[(column, row)];
                if !sample.is_nan() {
                    sum += wx * wy * f64::from(sample);
                    weight += wx * wy;
                }
            }
        }
        if weight > 0.0 { (sum / weight) as f32 } else { f32::NAN }
    })
}

/// The source pixels under target pixel `idx` of `to`, with the length of each that it covers.
fn cover(idx: usize, to: usize, from: usize) -> Vec<(usize, f64)> {
    let scale = from as f64 / to as f64;
    let (start, end) = (idx as f64 * scale, (idx + 1) as f64 * scale);
    let last = (end.ceil() as usize).min(from);
    (start as usize..last)
        .map(|pixel| (pixel, end.min((pixel + 1) as f64) - start.max(pixel as f64)))
        .filter(|&(_, length)| length > 1e-9)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize) -> Raster<f32> {
        Raster::from_fn(width, height, |x, y| 2.0 * x as f32 - 3.0 * y as f32)
    }

    #[test]
    fn bilinear_is_exact_on_a_plane_and_at_the_rim() {
        let raster = plane(6, 4);
        let value = bilinear(&raster, 3.2, 1.9).unwrap();
        assert!((value - (2.0 * 2.7 - 3.0 * 1.4)).abs() < 1e-12);
        assert_eq!(bilinear(&raster, 0.5, 0.5), Some(0.0));
        assert_eq!(bilinear(&raster, 5.5, 3.5), Some(1.0));
        assert_eq!(bilinear(&raster, 0.49, 1.0), None);
        assert_eq!(bilinear(&raster, 1.0, 3.51), None);
        assert_eq!(bilinear(&raster, f64::NAN, 1.0), None);
        assert_eq!(bilinear(&Raster { width: 0, height: 0, data: vec![] }, 0.5, 0.5), None);
    }

    #[test]
    fn absent_neighbours_matter_only_where_they_have_weight() {
        let mut raster = plane(4, 4);
        raster[(2, 1)] = f32::NAN;
        assert_eq!(bilinear(&raster, 2.0, 1.5), None);
        assert_eq!(bilinear(&raster, 1.5, 1.5), Some(-1.0));
        assert_eq!(bilinear(&raster, 1.5, 2.0), Some(-2.5));
    }

    #[test]
    fn means_keep_the_mean_and_skip_the_absent() {
        let mut raster = plane(6, 4);
        let halved = block_mean(&raster, 2);
        assert_eq!((halved.width, halved.height, halved.data[0]), (3, 2, -0.5));
        let resized = area_mean(&raster, 4, 3);
        let mean = |r: &Raster<f32>| r.data.iter().sum::<f32>() / r.data.len() as f32;
        assert!((mean(&resized) - mean(&raster)).abs() < 1e-5);
        assert_eq!(area_mean(&raster, 12, 8).data[..4], [0.0, 0.0, 2.0, 2.0]);
        raster.data[0] = f32::NAN;
        assert_eq!(block_mean(&raster, 2).data[0], -2.0 / 3.0);
        raster.data.fill(f32::NAN);
        assert!(block_mean(&raster, 3).data.iter().chain(&area_mean(&raster, 2, 2).data).all(|v| v.is_nan()));
    }
}
