//! Operators that are diagonal in cosines, inverted: what conjugate gradients are preconditioned with.

use super::filter::ROWS_PER_TASK;
use rayon::prelude::*;
use rustdct::{DctPlanner, TransformType2And3};
use std::sync::Arc;

/// An even operator under mirrored boundaries, where it is diagonal in cosines: what it multiplies the wave `(k, l)` by is
/// `mass + along_x sin² k + along_y sin² l + membrane κ + plate κ²`, with `κ = 4 sin²(k/2) + 4 sin²(l/2)`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Symbol {
    pub mass: f32,
    pub along_x: f32,
    pub along_y: f32,
    pub membrane: f32,
    pub plate: f32,
}

/// The inverse of such an operator.
pub(crate) struct Preconditioner {
    width: usize,
    height: usize,
    along_rows: Arc<dyn TransformType2And3<f32>>,
    along_columns: Arc<dyn TransformType2And3<f32>>,
    turned: Vec<f32>,
}

impl Preconditioner {
    /// For rasters of this size.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let mut planner = DctPlanner::new();
        Self {
            width,
            height,
            along_rows: planner.plan_dct2(width),
            along_columns: planner.plan_dct2(height),
            turned: vec![0.0; width * height],
        }
    }

    /// `data` becomes the inverse of `symbol`'s operator applied to it.
    pub(crate) fn run(&mut self, data: &mut [f32], symbol: &Symbol) {
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
        let sine2 =
            |k: usize, count: usize| (std::f64::consts::PI * k as f64 / count as f64).sin().powi(2) as f32;
        let Symbol { mass, along_x, along_y, membrane, plate } = *symbol;
        let down: Vec<(f32, f32)> =
            (0..height).map(|k| (eigen(k, height), along_y * sine2(k, height))).collect();
        // A forward and backward pair of cosine transforms multiplies by a quarter of the number of samples.
        let norm = 4.0 / (width as f32 * height as f32);
        self.turned.par_chunks_mut(height * chunk).enumerate().for_each_init(
            || vec![0.0; columns.get_scratch_len()],
            |scratch, (task, block)| {
                for (i, column) in block.chunks_exact_mut(height).enumerate() {
                    columns.process_dct2_with_scratch(column, scratch);
                    let k = task * chunk + i;
                    let (across, mass) = (eigen(k, width), mass + along_x * sine2(k, width));
                    for (v, &(along, slope)) in column.iter_mut().zip(&down) {
                        let k2 = across + along;
                        *v *= norm / (mass + slope + (membrane + plate * k2) * k2);
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
