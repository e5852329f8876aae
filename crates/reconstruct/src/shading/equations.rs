//! The normal equations of one step: a symmetric 4×4 tensor per cell, whatever the number of pictures, and what is free for whole
//! pictures, eliminated jointly.

use crate::field::conjugate::{ConjugateGradients, dot};
use crate::field::cosine::{Preconditioner, Symbol};
use crate::field::filter::ROWS_PER_TASK;
use crate::field::plate;
use rayon::prelude::*;
use selenograph_geometry::DMatrix;
use selenograph_raster::Raster;

/// A quantity of a cell for each of its unknowns: slope along columns, slope along rows, height, log albedo.
pub(super) type PerUnknown = [f32; 4];

/// `Σ w j jᵀ` and `Σ w j r` of a cell over all pictures.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CellEquations {
    /// Upper triangle, row by row.
    pub(super) matrix: [f32; 10],
    pub(super) right: PerUnknown,
}

impl CellEquations {
    #[inline]
    pub(super) fn add(&mut self, weight: f32, j: PerUnknown, residual: f32) {
        let mut at = 0;
        for a in 0..4 {
            let scaled = weight * j[a];
            for &other in &j[a..] {
                self.matrix[at] += scaled * other;
                at += 1;
            }
            self.right[a] += scaled * residual;
        }
    }

    #[inline]
    fn times(&self, x: PerUnknown) -> PerUnknown {
        let [uu, uv, uh, ua, vv, vh, va, hh, ha, aa] = self.matrix;
        let [u, v, h, a] = x;
        [
            uu * u + uv * v + uh * h + ua * a,
            uv * u + vv * v + vh * h + va * a,
            uh * u + vh * v + hh * h + ha * a,
            ua * u + va * v + ha * h + aa * a,
        ]
    }
}

/// Central differences along a row, one-sided at its ends.
#[inline]
pub(super) fn along(row: &[f32], x: usize) -> f32 {
    let last = row.len() - 1;
    match x {
        0 => row[1] - row[0],
        x if x == last => row[last] - row[last - 1],
        _ => 0.5 * (row[x + 1] - row[x - 1]),
    }
}

/// Rows above and below, and the factor of their difference.
#[inline]
pub(super) fn neighbours(y: usize, height: usize) -> (usize, usize, f32) {
    match y {
        0 => (0, 1, 1.0),
        y if y + 1 == height => (y - 1, y, 1.0),
        _ => (y - 1, y + 1, 0.5),
    }
}

/// Weight with which the difference at `from` counts for the sample at `to`, along an axis of `count` samples.
#[inline]
fn adjoint_weight(from: usize, to: usize, count: usize) -> f32 {
    let half = if from == 0 || from + 1 == count { 1.0 } else { 0.5 };
    match (from, to) {
        (0, 0) => -1.0,
        (from, to) if from == to => {
            if from + 1 == count {
                1.0
            } else {
                0.0
            }
        }
        (from, to) if to > from => half,
        _ => -half,
    }
}

/// `out_h += Dᵀ (tu, tv)` over a row: the adjoint of the central differences.
fn add_adjoint(tu: &[f32], tv: &[f32], width: usize, height: usize, y: usize, out: &mut [f32]) {
    let row = &tu[y * width..(y + 1) * width];
    let last = width - 1;
    for x in 1..last {
        out[x] += 0.5 * (row[x - 1] - row[x + 1]);
    }
    // The two ends, and their neighbours, whose difference towards the end is one-sided there.
    out[0] += -row[0] - 0.5 * row[1];
    out[last] += row[last] + 0.5 * row[last - 1];
    if last >= 2 {
        out[1] += 0.5 * row[0];
        out[last - 1] -= 0.5 * row[last];
    }
    for from in y.saturating_sub(1)..(y + 2).min(height) {
        let weight = adjoint_weight(from, y, height);
        if weight != 0.0 {
            for (o, &t) in out.iter_mut().zip(&tv[from * width..(from + 1) * width]) {
                *o += weight * t;
            }
        }
    }
}

/// What is held against the data, everywhere alike.
#[derive(Debug, Clone)]
pub(super) struct Regular {
    /// Stiffness of the plate that the heights form.
    pub(super) stiffness: Raster<f32>,
    /// Tension of the membrane that the log albedo forms.
    pub(super) tension: f32,
    /// What holds the log albedo to 0.
    pub(super) hold: f32,
}

/// The equations of one step; the vector of unknowns is all heights, then all log albedos.
pub(super) struct Equations {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) cells: Vec<CellEquations>,
    pub(super) regular: Regular,
    /// `Σ w j c` of each global unknown over all cells, as the unknowns see it.
    pub(super) columns: Vec<Vec<f32>>,
    /// Inverse of the globals' own matrix `Σ w c cᵀ` with their priors.
    pub(super) inverse: DMatrix<f64>,
}

impl Equations {
    fn count(&self) -> usize {
        self.width * self.height
    }

    /// What a field over the cells' four unknowns is for the unknowns themselves: `Dᵀ t`.
    pub(super) fn gathered(width: usize, height: usize, t: &[PerUnknown]) -> Vec<f32> {
        let count = width * height;
        let mut out = vec![0.0; 2 * count];
        let (heights, albedo) = out.split_at_mut(count);
        let (tu, tv): (Vec<f32>, Vec<f32>) = t.iter().map(|t| (t[0], t[1])).unzip();
        heights.par_chunks_mut(width).zip(albedo.par_chunks_mut(width)).enumerate().for_each(
            |(y, (h, a))| {
                for ((h, a), t) in h.iter_mut().zip(a).zip(&t[y * width..]) {
                    (*h, *a) = (t[2], t[3]);
                }
                add_adjoint(&tu, &tv, width, height, y, h);
            },
        );
        out
    }

    /// `Σ w j r` of all cells, less what the plate and the membrane pull back.
    pub(super) fn right(&self, heights: &[f32], albedo: &[f32]) -> Vec<f32> {
        let rights: Vec<PerUnknown> = self.cells.iter().map(|cell| cell.right).collect();
        let mut out = Self::gathered(self.width, self.height, &rights);
        let (of_heights, of_albedo) = out.split_at_mut(self.count());
        let mut pulled = vec![0.0; self.count()];
        plate::apply(heights, None, &self.regular.stiffness, &mut pulled);
        subtract(of_heights, &pulled);
        pulled.fill(0.0);
        self.add_membrane(albedo, &mut pulled);
        subtract(of_albedo, &pulled);
        out
    }

    fn add_membrane(&self, albedo: &[f32], out: &mut [f32]) {
        let (width, height) = (self.width, self.height);
        let Regular { tension, hold, .. } = self.regular;
        out.par_chunks_mut(width * ROWS_PER_TASK).enumerate().for_each(|(task, rows)| {
            for (dy, out) in rows.chunks_exact_mut(width).enumerate() {
                let y = task * ROWS_PER_TASK + dy;
                let here = &albedo[y * width..(y + 1) * width];
                for (o, &a) in out.iter_mut().zip(here) {
                    *o += hold * a;
                }
                for x in 1..width {
                    let step = tension * (here[x] - here[x - 1]);
                    out[x] += step;
                    out[x - 1] -= step;
                }
                for other in [y.checked_sub(1), (y + 1 < height).then_some(y + 1)].into_iter().flatten() {
                    let there = &albedo[other * width..(other + 1) * width];
                    for ((o, &a), &b) in out.iter_mut().zip(here).zip(there) {
                        *o += tension * (a - b);
                    }
                }
            }
        });
    }

    /// The operator: data, plate, membrane, less what the globals explain.
    pub(super) fn apply(&self, x: &[f32], tu: &mut [f32], tv: &mut [f32], out: &mut [f32]) {
        let (width, height, count) = (self.width, self.height, self.count());
        let (heights, albedo) = x.split_at(count);
        let (out_h, out_a) = out.split_at_mut(count);
        plate::apply(heights, None, &self.regular.stiffness, out_h);
        let rows = width * ROWS_PER_TASK;
        out_h
            .par_chunks_mut(rows)
            .zip(out_a.par_chunks_mut(rows))
            .zip(tu.par_chunks_mut(rows).zip(tv.par_chunks_mut(rows)))
            .enumerate()
            .for_each(|(task, ((out_h, out_a), (tu, tv)))| {
                for dy in 0..out_h.len() / width {
                    let y = task * ROWS_PER_TASK + dy;
                    let (above, below, factor) = neighbours(y, height);
                    let row = |y: usize| &heights[y * width..(y + 1) * width];
                    let (above, here, below) = (row(above), row(y), row(below));
                    for x in 0..width {
                        let unknowns =
                            [along(here, x), factor * (below[x] - above[x]), here[x], albedo[y * width + x]];
                        let t = self.cells[y * width + x].times(unknowns);
                        let at = dy * width + x;
                        (tu[at], tv[at], out_a[at]) = (t[0], t[1], t[3]);
                        out_h[at] += t[2];
                    }
                }
            });
        out_h
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, out)| add_adjoint(tu, tv, width, height, y, out));
        self.add_membrane(albedo, out_a);
        let seen: Vec<f64> = self.columns.iter().map(|column| dot(column, x)).collect();
        for (k, column) in self.columns.iter().enumerate() {
            let weight: f64 = seen.iter().enumerate().map(|(l, v)| self.inverse[(k, l)] * v).sum();
            add_scaled(out, column, -weight as f32);
        }
    }

    /// The step of heights and log albedo towards `right`.
    pub(super) fn solve(
        &self,
        right: &[f32],
        solver: &mut Solver,
        iterations: usize,
        tolerance: f64,
    ) -> Vec<f32> {
        let count = self.count();
        let mut mean = [0.0f64; 10];
        for cell in &self.cells {
            for (sum, &m) in mean.iter_mut().zip(&cell.matrix) {
                *sum += f64::from(m);
            }
        }
        let mean = mean.map(|sum| (sum / count as f64) as f32);
        let plate = crate::field::conjugate::mean_of(&self.regular.stiffness.data);
        let of_heights =
            Symbol { mass: mean[7] + LEAST_MASS, along_x: mean[0], along_y: mean[4], plate, membrane: 0.0 };
        let Regular { tension, hold, .. } = self.regular;
        let of_albedo = Symbol { mass: mean[9] + hold, membrane: tension, ..Symbol::default() };
        let mut x = vec![0.0; 2 * count];
        let Solver { preconditioner, gradients, tu, tv } = solver;
        gradients.solve(
            &mut x,
            right,
            |x, out| self.apply(x, tu, tv, out),
            |x| {
                let (heights, albedo) = x.split_at_mut(count);
                preconditioner.run(heights, &of_heights);
                preconditioner.run(albedo, &of_albedo);
            },
            iterations,
            tolerance,
        );
        x
    }
}

/// Keeps the preconditioner finite for the mean height, which the slopes do not tell.
const LEAST_MASS: f32 = 1e-9;

/// Buffers for one size.
pub(super) struct Solver {
    preconditioner: Preconditioner,
    gradients: ConjugateGradients,
    tu: Vec<f32>,
    tv: Vec<f32>,
}

impl Solver {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let count = width * height;
        Self {
            preconditioner: Preconditioner::new(width, height),
            gradients: ConjugateGradients::new(2 * count),
            tu: vec![0.0; count],
            tv: vec![0.0; count],
        }
    }
}

fn subtract(out: &mut [f32], other: &[f32]) {
    for (o, &v) in out.iter_mut().zip(other) {
        *o -= v;
    }
}

pub(super) fn add_scaled(out: &mut [f32], other: &[f32], factor: f32) {
    out.par_chunks_mut(1 << 14).zip(other.par_chunks(1 << 14)).for_each(|(out, other)| {
        for (o, &v) in out.iter_mut().zip(other) {
            *o += factor * v;
        }
    });
}
