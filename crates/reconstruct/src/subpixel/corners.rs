//! Where windows are worth aligning: the best corner of each square of a grid.

use super::window::MARGIN;
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
    let mut columns = vec![[0.0f32; 3]; width];
    for y in top..bottom {
        columns.fill([0.0; 3]);
        for row in y - RADIUS..=y + RADIUS {
            let (line, above, below) = (a.row(row), a.row(row - 1), a.row(row + 1));
            for x in 1..width - 1 {
                let (dx, dy) = (line[x + 1] - line[x - 1], below[x] - above[x]);
                let sums = &mut columns[x];
                sums[0] += dx * dx;
                sums[1] += dy * dy;
                sums[2] += dx * dy;
            }
        }
        let mut sums = [0.0f32; 3];
        for x in MARGIN - RADIUS..width - MARGIN + RADIUS {
            for k in 0..3 {
                sums[k] += columns[x][k];
            }
            if x < MARGIN + RADIUS {
                continue;
            }
            let centre = x - RADIUS;
            let [xx, yy, xy] = sums;
            let smaller = 0.5 * (xx + yy - ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt());
            let cell = &mut best[(centre - MARGIN) / spacing];
            if smaller > cell.0 && warped.data[y * width + centre].is_finite() {
                *cell = (smaller, Some([centre, y]));
            }
            for k in 0..3 {
                sums[k] -= columns[centre - RADIUS][k];
            }
        }
    }
    best.into_iter().filter_map(|(_, place)| place).collect()
}
