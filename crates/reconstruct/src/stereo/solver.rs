//! The linear step: a diagonal data term and a thin plate, by conjugate gradients preconditioned with a cosine transform.

use super::filter::ROWS_PER_TASK;
use rayon::prelude::*;
use rustdct::{DctPlanner, TransformType2And3};
use selenograph_raster::Raster;
use std::sync::Arc;

/// `out = weight · q + P q`, with `P` the thin plate `Σ s (q_xx² + 2 q_xy² + q_yy²)` of stiffness `s` over the second
/// differences that lie inside (natural boundary: planes cost nothing).
pub(crate) fn apply(q: &Raster<f32>, weight: &[f32], stiffness: &Raster<f32>, out: &mut [f32]) {
    let width = q.width;
    out.par_chunks_mut(width * ROWS_PER_TASK).enumerate().for_each(|(task, rows)| {
        let mut xx = vec![0.0f32; width + 2];
        let mut cells = [vec![0.0f32; width + 1], vec![0.0f32; width + 1]];
        for (dy, out_row) in rows.chunks_exact_mut(width).enumerate() {
            let y = task * ROWS_PER_TASK + dy;
            plate_row(q, stiffness, y, &mut xx, &mut cells, out_row);
            let here = &weight[y * width..(y + 1) * width];
            for ((o, &w), &v) in out_row.iter_mut().zip(here).zip(q.row(y)) {
                *o += w * v;
            }
        }
    });
}

/// One row of `P q`. The buffers hold a zero at both ends of what they compute.
fn plate_row(
    q: &Raster<f32>,
    stiffness: &Raster<f32>,
    y: usize,
    xx: &mut [f32],
    cells: &mut [Vec<f32>; 2],
    out: &mut [f32],
) {
    let (width, height) = (q.width, q.height);
    let row = q.row(y);
    out.fill(0.0);
    for (middle, weight) in [(y.wrapping_sub(1), 1.0f32), (y, -2.0), (y + 1, 1.0)] {
        if middle >= 1 && middle < height - 1 {
            let (above, at, below) = (q.row(middle - 1), q.row(middle), q.row(middle + 1));
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
            let (upper, lower) = (q.row(top), q.row(top + 1));
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

/// Sum of products in f64 over fixed runs: the same for any number of threads.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    const RUN: usize = 1 << 14;
    let parts: Vec<f64> = a
        .par_chunks(RUN)
        .zip(b.par_chunks(RUN))
        .map(|(a, b)| {
            let mut lanes = [0.0f32; 16];
            let mut sum = 0.0f64;
            for (a, b) in a.chunks(512).zip(b.chunks(512)) {
                lanes.fill(0.0);
                for (a, b) in a.chunks_exact(16).zip(b.chunks_exact(16)) {
                    for i in 0..16 {
                        lanes[i] += a[i] * b[i];
                    }
                }
                let rest = a.len() / 16 * 16;
                let tail: f32 = a[rest..].iter().zip(&b[rest..]).map(|(a, b)| a * b).sum();
                sum += lanes.iter().map(|&v| f64::from(v)).sum::<f64>() + f64::from(tail);
            }
            sum
        })
        .collect();
    parts.iter().sum()
}

fn mean_of(values: &[f32]) -> f32 {
    (values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len().max(1) as f64) as f32
}

/// The inverse of `mean weight + smoothness · P` under mirrored boundaries, where it is diagonal in cosines.
struct Preconditioner {
    width: usize,
    height: usize,
    along_rows: Arc<dyn TransformType2And3<f32>>,
    along_columns: Arc<dyn TransformType2And3<f32>>,
    turned: Vec<f32>,
}

impl Preconditioner {
    fn new(width: usize, height: usize) -> Self {
        let mut planner = DctPlanner::new();
        Self {
            width,
            height,
            along_rows: planner.plan_dct2(width),
            along_columns: planner.plan_dct2(height),
            turned: vec![0.0; width * height],
        }
    }

    fn run(&mut self, data: &mut [f32], mean_weight: f32, smoothness: f32) {
        let (width, height) = (self.width, self.height);
        let (rows, columns) = (&self.along_rows, &self.along_columns);
        let chunk = ROWS_PER_TASK;
        data.par_chunks_mut(width * chunk).for_each_init(
            || vec![0.0; rows.get_scratch_len()],
            |scratch, block| {
                for row in block.chunks_exact_mut(width) {
                    rows.process_dct2_with_scratch(row, scratch);
                }
            },
        );
        transpose(data, width, height, &mut self.turned);
        let eigen = |k: usize, count: usize| {
            (2.0 - 2.0 * (std::f64::consts::PI * k as f64 / count as f64).cos()) as f32
        };
        let down: Vec<f32> = (0..height).map(|k| eigen(k, height)).collect();
        // A forward and backward pair of cosine transforms multiplies by a quarter of the number of samples.
        let norm = 4.0 / (width as f32 * height as f32);
        self.turned.par_chunks_mut(height * chunk).enumerate().for_each_init(
            || vec![0.0; columns.get_scratch_len()],
            |scratch, (task, block)| {
                for (i, column) in block.chunks_exact_mut(height).enumerate() {
                    columns.process_dct2_with_scratch(column, scratch);
                    let across = eigen(task * chunk + i, width);
                    for (v, &along) in column.iter_mut().zip(&down) {
                        let k2 = across + along;
                        *v *= norm / (mean_weight + smoothness * k2 * k2);
                    }
                    columns.process_dct3_with_scratch(column, scratch);
                }
            },
        );
        transpose(&self.turned, height, width, data);
        data.par_chunks_mut(width * chunk).for_each_init(
            || vec![0.0; rows.get_scratch_len()],
            |scratch, block| {
                for row in block.chunks_exact_mut(width) {
                    rows.process_dct3_with_scratch(row, scratch);
                }
            },
        );
    }
}

/// `out[x][y] = source[y][x]`, in square tiles that stay in the cache.
fn transpose(source: &[f32], width: usize, height: usize, out: &mut [f32]) {
    const TILE: usize = 32;
    out.par_chunks_mut(height * TILE).enumerate().for_each(|(task, block)| {
        let left = task * TILE;
        let columns = block.len() / height;
        for top in (0..height).step_by(TILE) {
            for y in top..(top + TILE).min(height) {
                let row = &source[y * width + left..y * width + left + columns];
                for (i, &v) in row.iter().enumerate() {
                    block[i * height + y] = v;
                }
            }
        }
    });
}

/// Buffers of the conjugate gradients for one size.
pub(crate) struct Solver {
    preconditioner: Preconditioner,
    residual: Vec<f32>,
    direction: Raster<f32>,
    image: Vec<f32>,
    scaled: Vec<f32>,
}

impl Solver {
    /// For rasters of this size.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let count = width * height;
        Self {
            preconditioner: Preconditioner::new(width, height),
            residual: vec![0.0; count],
            direction: Raster::filled(width, height, 0.0),
            image: vec![0.0; count],
            scaled: vec![0.0; count],
        }
    }

    /// Improves `q` towards `(weight + P) q = right`, in at most `iterations` steps or until the residual has
    /// fallen by `tolerance`.
    pub(crate) fn solve(
        &mut self,
        q: &mut Raster<f32>,
        weight: &[f32],
        right: &[f32],
        stiffness: &Raster<f32>,
        iterations: usize,
        tolerance: f64,
    ) {
        let mean = mean_of(weight).max(f32::MIN_POSITIVE * 1e6);
        let mean_stiffness = mean_of(&stiffness.data);
        apply(q, weight, stiffness, &mut self.image);
        for ((r, &b), &i) in self.residual.iter_mut().zip(right).zip(&self.image) {
            *r = b - i;
        }
        let mut rho_before = 0.0;
        let mut first = None;
        for _ in 0..iterations {
            self.scaled.copy_from_slice(&self.residual);
            self.preconditioner.run(&mut self.scaled, mean, mean_stiffness);
            let rho = dot(&self.residual, &self.scaled);
            let start = *first.get_or_insert(rho);
            if rho <= start * tolerance * tolerance || !rho.is_finite() {
                return;
            }
            let beta = if rho_before > 0.0 { (rho / rho_before) as f32 } else { 0.0 };
            for (d, &s) in self.direction.data.iter_mut().zip(&self.scaled) {
                *d = s + beta * *d;
            }
            apply(&self.direction, weight, stiffness, &mut self.image);
            let curvature = dot(&self.direction.data, &self.image);
            if curvature <= 0.0 || curvature.is_nan() {
                return;
            }
            let step = (rho / curvature) as f32;
            for ((v, r), (&d, &i)) in
                q.data.iter_mut().zip(&mut self.residual).zip(self.direction.data.iter().zip(&self.image))
            {
                *v += step * d;
                *r -= step * i;
            }
            rho_before = rho;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_cost_nothing_and_the_plate_is_symmetric() {
        let plane = Raster::from_fn(17, 13, |x, y| 3.0 + 0.5 * x as f32 - 0.25 * y as f32);
        let none = vec![0.0; 17 * 13];
        let mut out = vec![1.0; 17 * 13];
        let even = Raster::from_fn(17, 13, |x, y| 1.0 + ((x * 5 + y * 3) % 4) as f32);
        apply(&plane, &none, &even, &mut out);
        assert!(out.iter().all(|v| v.abs() < 1e-4));
        let a = Raster::from_fn(17, 13, |x, y| ((x * 7 + y * 5) % 11) as f32);
        let b = Raster::from_fn(17, 13, |x, y| ((x * 3 + y * 13) % 7) as f32);
        let (mut pa, mut pb) = (out.clone(), out);
        apply(&a, &none, &even, &mut pa);
        apply(&b, &none, &even, &mut pb);
        assert!((dot(&pa, &b.data) - dot(&pb, &a.data)).abs() < 1e-2);
        assert!(dot(&pa, &a.data) > 0.0);
    }

    #[test]
    fn the_solver_finds_what_made_the_right_side() {
        let truth = Raster::from_fn(40, 30, |x, y| (0.2 * x as f32).sin() * 3.0 + 0.1 * y as f32);
        let weight: Vec<f32> =
            (0..1200).map(|i| if i % 3 == 0 { 0.0 } else { 0.5 + (i % 5) as f32 }).collect();
        let mut right = vec![0.0; 1200];
        let stiffness = Raster::from_fn(40, 30, |x, _| if x < 20 { 2.0 } else { 1.0 });
        apply(&truth, &weight, &stiffness, &mut right);
        let mut q = Raster::filled(40, 30, 0.0);
        Solver::new(40, 30).solve(&mut q, &weight, &right, &stiffness, 200, 1e-7);
        let worst = q.data.iter().zip(&truth.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{worst}");
    }
}
