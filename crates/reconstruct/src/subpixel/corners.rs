//! Where windows are worth aligning: the best corner of each square of a grid.

use super::window::MARGIN;
use crate::dispatch::widest;
use rayon::prelude::*;
use selenograph_raster::Raster;

/// Radius over which gradients are gathered, samples.
const RADIUS: usize = 4;

/// For each square of side `spacing`, the sample whose surroundings fix a shift best (the smaller eigenvalue of the gradients'
/// matrix, Shi & Tomasi 1994), where both pictures have a whole window.
pub(super) fn strongest(a: &Raster<f32>, warped: &Raster<f32>, spacing: usize) -> Vec<[usize; 2]> {
    let spacing = spacing.max(1);
    if a.width <= 2 * MARGIN || a.height <= 2 * MARGIN {
        return Vec::new();
    }
    let bands: Vec<usize> = (MARGIN..a.height - MARGIN).step_by(spacing).collect();
    let found: Vec<Vec<[usize; 2]>> = bands
        .into_par_iter()
        .map(|top| band(a, warped, top, (top + spacing).min(a.height - MARGIN), spacing))
        .collect();
    found.concat()
}

fn band(a: &Raster<f32>, warped: &Raster<f32>, top: usize, bottom: usize, spacing: usize) -> Vec<[usize; 2]> {
    let width = a.width;
    let mut best = vec![(0.0f32, None); width.div_ceil(spacing)];
    let mut columns = [vec![0.0f32; width], vec![0.0f32; width], vec![0.0f32; width]];
    let mut smaller = vec![0.0f32; width];
    for row in top - RADIUS..top + RADIUS {
        add_products(a.row(row - 1), a.row(row), a.row(row + 1), 1.0, &mut columns);
    }
    for y in top..bottom {
        let (enters, leaves) = (y + RADIUS, y - RADIUS);
        add_products(a.row(enters - 1), a.row(enters), a.row(enters + 1), 1.0, &mut columns);
        smaller_eigenvalues(&columns, &mut smaller);
        for x in MARGIN..width - MARGIN {
            let cell = &mut best[(x - MARGIN) / spacing];
            if smaller[x] > cell.0 && warped.data[y * width + x].is_finite() {
                *cell = (smaller[x], Some([x, y]));
            }
        }
        add_products(a.row(leaves - 1), a.row(leaves), a.row(leaves + 1), -1.0, &mut columns);
    }
    best.into_iter().filter_map(|(_, place)| place).collect()
}

widest! {
    /// Adds the products of a row's gradients to the sums of its columns.
    fn add_products(above: &[f32], row: &[f32], below: &[f32], sign: f32, columns: &mut [Vec<f32>; 3]) = add_products_body
}

#[inline(always)]
fn add_products_body(above: &[f32], row: &[f32], below: &[f32], sign: f32, columns: &mut [Vec<f32>; 3]) {
    let n = row.len() - 2;
    let (left, right) = (&row[..n], &row[2..]);
    let (above, below) = (&above[1..n + 1], &below[1..n + 1]);
    let [xx, yy, xy] = columns;
    let (xx, yy, xy) = (&mut xx[1..n + 1], &mut yy[1..n + 1], &mut xy[1..n + 1]);
    for i in 0..n {
        let (dx, dy) = (right[i] - left[i], below[i] - above[i]);
        xx[i] += sign * dx * dx;
        yy[i] += sign * dy * dy;
        xy[i] += sign * dx * dy;
    }
}

widest! {
    /// The smaller eigenvalue of the sums over `2 · RADIUS + 1` columns.
    fn smaller_eigenvalues(columns: &[Vec<f32>; 3], out: &mut [f32]) = smaller_eigenvalues_body
}

#[inline(always)]
fn smaller_eigenvalues_body(columns: &[Vec<f32>; 3], out: &mut [f32]) {
    let n = out.len() - 2 * RADIUS;
    let out = &mut out[RADIUS..RADIUS + n];
    let [xx, yy, xy] = columns;
    for i in 0..n {
        let mut sums = [0.0f32; 3];
        for k in 0..2 * RADIUS + 1 {
            sums[0] += xx[i + k];
            sums[1] += yy[i + k];
            sums[2] += xy[i + k];
        }
        let [xx, yy, xy] = sums;
        out[i] = 0.5 * (xx + yy - ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt());
    }
}
