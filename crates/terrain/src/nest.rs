//! A fine elevation model fitted onto coarser ones, so that the surface is continuous and its seam is no cliff.
//!
//! The height of a node becomes `coarse + w · (fine − coarse)`: the *residual* fades, not the terrain, so that the long
//! waves of both agree everywhere. `w` is C¹, 1 inside, 0 at the rim and at absent nodes, over a width of at least one
//! coarse cell, and wider where the two differ much: the slope that fading adds is at most `1.5 · |step| / width`.

mod report;
mod scratch;
mod steps;
mod under;
mod weight;

use crate::layer::SUPPORT_BLOCK;
use crate::layer_file::support_size;
use crate::store::{NewLayer, Source, TerrainWriter};
use crate::{Error, Grid};
use rayon::prelude::*;
pub use report::NestReport;
use scratch::Scratch;
pub use steps::NestOptions;
use steps::{Steps, step_m};
use under::Under;
pub use weight::Widths;
use weight::{BlockDistance, Weight};

/// Rows handled at a time.
const BAND_ROWS: usize = 64;

/// Fits a finer elevation model onto what a writer holds already and adds it as its next layer.
///
/// `read_rows(first, count, out)` gives the model's node rows, called from the top; `progress(rows done, rows to do)`
/// counts both passes.
///
/// # Errors
/// [`Error::AllAbsent`] without a single height; errors of the reader; [`Error::Io`].
pub fn add_nested(
    writer: &mut TerrainWriter,
    grid: &Grid,
    source: Source,
    options: &NestOptions,
    mut read_rows: impl FnMut(usize, usize, &mut Vec<f32>) -> Result<(), Error>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<NestReport, Error> {
    let surface = writer.surface()?;
    let under = Under::new(&surface, grid);
    let mut scratch = Scratch::create(writer.scratch(), grid.cols)?;
    let (block_cols, block_rows) = (grid.cols.div_ceil(SUPPORT_BLOCK), grid.rows.div_ceil(SUPPORT_BLOCK));
    let mut has_absent = vec![false; block_cols * block_rows];
    let mut num_present = 0u64;
    let mut band = Vec::new();
    for first in (0..grid.rows).step_by(BAND_ROWS) {
        let count = BAND_ROWS.min(grid.rows - first);
        read_rows(first, count, &mut band)?;
        for (j, row) in band.chunks_exact(grid.cols).enumerate() {
            let blocks = &mut has_absent[(first + j) / SUPPORT_BLOCK * block_cols..][..block_cols];
            for (i, height) in row.iter().enumerate() {
                if height.is_nan() {
                    blocks[i / SUPPORT_BLOCK] = true;
                } else {
                    num_present += 1;
                }
            }
        }
        scratch.push(&band)?;
        progress(first + count, 2 * grid.rows);
    }
    if num_present == 0 {
        return Err(Error::AllAbsent { name: source.name, cells: grid.cols * grid.rows });
    }
    let holes = BlockDistance::new(block_cols, block_rows, &has_absent);
    let uncovered =
        BlockDistance::new(block_cols, block_rows, &uncovered_blocks(&under, block_cols, block_rows));
    let steps = Steps::sample(&under, &mut scratch, holes.as_ref(), block_cols, block_rows)?;
    let weight = Weight {
        widths: steps.widths(grid, options),
        step_m: step_m(grid),
        last: [(grid.cols - 1) as f64, (grid.rows - 1) as f64],
        holes,
        uncovered,
    };
    let mut layer = writer.begin_layer(grid, true)?;
    let (num_filled, rim_residual_m) = fit(&under, &weight, &mut scratch, &mut layer, progress)?;
    scratch.remove()?;
    let (step_p99_m, step_max_m) = steps.p99_and_max_m();
    let report = NestReport {
        widths: weight.widths,
        step_p99_m,
        step_max_m,
        rim_residual_m,
        rim_between_nodes_m: between_nodes(&under),
        num_filled,
    };
    let support = support(&under, &weight, &has_absent, block_cols);
    drop(surface);
    writer.finish_layer(layer, source, Some(&support), Some(report))?;
    Ok(report)
}

/// Blocks with a corner under which the coarser terrain is absent.
fn uncovered_blocks(under: &Under<'_>, block_cols: usize, block_rows: usize) -> Vec<bool> {
    let [last_c, last_r] = [(under.fine.cols - 1) as f64, (under.fine.rows - 1) as f64];
    let corner = |n: usize, last: f64| ((n * SUPPORT_BLOCK) as f64).min(last);
    let absent: Vec<Vec<bool>> = (0..=block_rows)
        .into_par_iter()
        .map(|j| {
            let r = corner(j, last_r);
            (0..=block_cols).map(|i| under.sample(corner(i, last_c), r).is_none()).collect()
        })
        .collect();
    let block =
        |i: usize, j: usize| absent[j][i] || absent[j][i + 1] || absent[j + 1][i] || absent[j + 1][i + 1];
    (0..block_rows).flat_map(|j| (0..block_cols).map(move |i| (i, j))).map(|(i, j)| block(i, j)).collect()
}

/// The second pass: blended rows into the layer. Returns the number of filled nodes and the residual at the rim.
fn fit(
    under: &Under<'_>,
    weight: &Weight,
    scratch: &mut Scratch,
    layer: &mut NewLayer,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(u64, f64), Error> {
    let grid = under.fine;
    let (mut num_filled, mut residual) = (0u64, 0f64);
    for first in (0..grid.rows).step_by(BAND_ROWS) {
        let count = BAND_ROWS.min(grid.rows - first);
        let mut band = scratch.read(first, count)?;
        let rows: Vec<(u64, f64)> = band
            .par_chunks_exact_mut(grid.cols)
            .enumerate()
            .map(|(j, row)| fit_row(under, weight, first + j, row))
            .collect();
        for (filled, rim) in rows {
            num_filled += filled;
            residual = residual.max(rim);
        }
        layer.push_rows(&band)?;
        progress(grid.rows + first + count, 2 * grid.rows);
    }
    Ok((num_filled, residual))
}

fn fit_row(under: &Under<'_>, weight: &Weight, row: usize, heights: &mut [f32]) -> (u64, f64) {
    let (mut num_filled, mut residual) = (0, 0f64);
    let (last_col, last_row) = (under.fine.cols - 1, under.fine.rows - 1);
    for (col, height) in heights.iter_mut().enumerate() {
        let (c, r) = (col as f64, row as f64);
        let w = weight.at(c, r);
        if w >= 1.0 && height.is_finite() {
            continue;
        }
        let Some((coarse, _)) = under.sample(c, r) else { continue };
        if height.is_nan() {
            num_filled += 1;
            *height = coarse as f32;
        } else {
            *height = (coarse + w * (f64::from(*height) - coarse)) as f32;
        }
        if w == 0.0 && (row == 0 || row == last_row || col == 0 || col == last_col) {
            residual = residual.max((f64::from(*height) - coarse).abs());
        }
    }
    (num_filled, residual)
}

/// Largest deviation of the coarse surface from a straight line between neighbouring nodes of the rim.
fn between_nodes(under: &Under<'_>) -> f64 {
    let (last_c, last_r) = (under.fine.cols - 1, under.fine.rows - 1);
    let along_c = [0, last_r].into_iter().flat_map(|r| (0..last_c).map(move |c| ([c, r], [c + 1, r])));
    let along_r = [0, last_c].into_iter().flat_map(|c| (0..last_r).map(move |r| ([c, r], [c, r + 1])));
    along_c
        .chain(along_r)
        .filter_map(|(a, b)| {
            let height = |c: f64, r: f64| Some(under.sample(c, r)?.0);
            let (ac, ar, bc, br) = (a[0] as f64, a[1] as f64, b[0] as f64, b[1] as f64);
            let middle = height(f64::midpoint(ac, bc), f64::midpoint(ar, br))?;
            Some((f64::midpoint(height(ac, ar)?, height(bc, br)?) - middle).abs())
        })
        .fold(0.0, f64::max)
}

/// Effective cell size per support block: the coarser terrain's where less than half of the residual is left.
fn support(under: &Under<'_>, weight: &Weight, has_absent: &[bool], block_cols: usize) -> Vec<f32> {
    let grid = under.fine;
    let (cols, rows) = support_size(grid);
    let own = grid.cell_m();
    let mut out = Vec::with_capacity(cols * rows);
    for j in 0..rows {
        for i in 0..cols {
            let middle = |n: usize, last: usize| ((n * SUPPORT_BLOCK + SUPPORT_BLOCK / 2).min(last)) as f64;
            let (c, r) = (middle(i, grid.cols - 1), middle(j, grid.rows - 1));
            let from_coarse = has_absent[j * block_cols + i] || weight.at(c, r) < 0.5;
            let coarse = if from_coarse { under.sample(c, r) } else { None };
            out.push(coarse.map_or(own, |(_, cell)| cell.max(own)) as f32);
        }
    }
    out
}
