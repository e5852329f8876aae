//! The thin plate on a raster.

use super::filter::ROWS_PER_TASK;
use rayon::prelude::*;
use selenograph_raster::Raster;

/// `out = weight · q + P q`, with `P` the thin plate `Σ s (q_xx² + 2 q_xy² + q_yy²)` of stiffness `s` over the second
/// differences that lie inside (natural boundary: planes cost nothing). Without weights: `out = P q`.
pub(crate) fn apply(q: &[f32], weight: Option<&[f32]>, stiffness: &Raster<f32>, out: &mut [f32]) {
    let width = stiffness.width;
    out.par_chunks_mut(width * ROWS_PER_TASK).enumerate().for_each(|(task, rows)| {
        let mut xx = vec![0.0f32; width + 2];
        let mut cells = [vec![0.0f32; width + 1], vec![0.0f32; width + 1]];
        for (dy, out_row) in rows.chunks_exact_mut(width).enumerate() {
            let y = task * ROWS_PER_TASK + dy;
            plate_row(q, stiffness, y, &mut xx, &mut cells, out_row);
            let here = y * width..(y + 1) * width;
            if let Some(weight) = weight {
                for ((o, &w), &v) in out_row.iter_mut().zip(&weight[here.clone()]).zip(&q[here]) {
                    *o += w * v;
                }
            }
        }
    });
}

/// One row of `P q`. The buffers hold a zero at both ends of what they compute.
fn plate_row(
    q: &[f32],
    stiffness: &Raster<f32>,
    y: usize,
    xx: &mut [f32],
    cells: &mut [Vec<f32>; 2],
    out: &mut [f32],
) {
    let (width, height) = (stiffness.width, stiffness.height);
    let row_of = |y: usize| &q[y * width..(y + 1) * width];
    let row = row_of(y);
    out.fill(0.0);
    for (middle, weight) in [(y.wrapping_sub(1), 1.0f32), (y, -2.0), (y + 1, 1.0)] {
        if middle >= 1 && middle < height - 1 {
            let (above, at, below) = (row_of(middle - 1), row_of(middle), row_of(middle + 1));
            let s = stiffness.row(middle);
            for ((((o, &a), &b), &c), &s) in out.iter_mut().zip(above).zip(at).zip(below).zip(s) {
                *o += weight * s * (a - 2.0 * b + c);
            }
        }
    }
    // xx[x + 1] is the second difference at x; its ends stay 0.
    for ((d, w), &s) in xx[2..].iter_mut().zip(row.windows(3)).zip(&stiffness.row(y)[1..]) {
        *d = s * (w[0] - 2.0 * w[1] + w[2]);
    }
    xx[1] = 0.0;
    xx[width] = 0.0;
    for (o, w) in out.iter_mut().zip(xx.windows(3)) {
        *o += w[0] - 2.0 * w[1] + w[2];
    }
    for (cell, top) in cells.iter_mut().zip([y.wrapping_sub(1), y]) {
        if top < height - 1 {
            let (upper, lower) = (row_of(top), row_of(top + 1));
            let s = stiffness.row(top);
            for (((c, u), l), &s) in cell[1..].iter_mut().zip(upper.windows(2)).zip(lower.windows(2)).zip(s) {
                *c = s * (l[1] - l[0] - u[1] + u[0]);
            }
        } else {
            cell.fill(0.0);
        }
        cell[width] = 0.0;
    }
    let [above, here] = cells;
    for ((o, a), h) in out.iter_mut().zip(above.windows(2)).zip(here.windows(2)) {
        *o += 2.0 * (h[1] - h[0] - a[1] + a[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::conjugate::dot;
    use super::*;

    #[test]
    fn planes_cost_nothing_and_the_plate_is_symmetric() {
        let plane = Raster::from_fn(17, 13, |x, y| 3.0 + 0.5 * x as f32 - 0.25 * y as f32);
        let mut out = vec![1.0; 17 * 13];
        let even = Raster::from_fn(17, 13, |x, y| 1.0 + ((x * 5 + y * 3) % 4) as f32);
        apply(&plane.data, None, &even, &mut out);
        assert!(out.iter().all(|v| v.abs() < 1e-4));
        let a = Raster::from_fn(17, 13, |x, y| ((x * 7 + y * 5) % 11) as f32);
        let b = Raster::from_fn(17, 13, |x, y| ((x * 3 + y * 13) % 7) as f32);
        let (mut pa, mut pb) = (out.clone(), out);
        apply(&a.data, None, &even, &mut pa);
        apply(&b.data, None, &even, &mut pb);
        assert!((dot(&pa, &b.data) - dot(&pb, &a.data)).abs() < 1e-2);
        assert!(dot(&pa, &a.data) > 0.0);
    }
}
