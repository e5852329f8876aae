//! How far a finer model and the coarser terrain are apart where they must meet, and how wide the fade has to be.

use super::scratch::Scratch;
use super::under::Under;
use super::weight::{BlockDistance, Widths};
use crate::layer::SUPPORT_BLOCK;
use crate::{Error, Grid};
use serde::{Deserialize, Serialize};

/// Blocks beside holes in which the step is sampled.
const STEP_BLOCKS: f32 = 3.0;
/// Share of each side that is left out at its ends: there the neighbouring side's fade is at work already.
const CORNER: f64 = 0.1;
/// Steepest slope of `smoothstep`, per unit.
const STEEPEST: f64 = 1.5;

/// How a finer layer is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NestOptions {
    /// Least width of the fade, in cells of the coarser terrain.
    pub blend_cells: f64,
    /// Slope (tangent) that fading may add, for 99 of 100 places at the rim: the width grows until it holds.
    pub max_seam_slope: f64,
    /// The fade takes at most this share of the layer's shorter side from each side.
    pub max_share: f64,
}

impl Default for NestOptions {
    /// 0.05 is 2.9°, a quarter of the median slope of the polar sites.
    fn default() -> Self {
        Self { blend_cells: 2.0, max_seam_slope: 0.05, max_share: 0.2 }
    }
}

/// |fine − coarse| along one stretch of border: a side of the rim, or the holes.
#[derive(Default)]
struct Stretch {
    steps_m: Vec<f64>,
    coarse_cell_m: f64,
}

impl Stretch {
    fn p99_m(&self) -> f64 {
        self.steps_m.get(self.steps_m.len().saturating_sub(1) * 99 / 100).copied().unwrap_or(0.0)
    }

    fn width_m(&self, grid: &Grid, options: &NestOptions) -> f64 {
        let [step_c, step_r] = step_m(grid);
        let side = ((grid.cols - 1) as f64 * step_c).min((grid.rows - 1) as f64 * step_r);
        let coarse_cell_m = self.coarse_cell_m.max(grid.cell_m());
        let wanted = (options.blend_cells.max(1.0) * coarse_cell_m)
            .max(STEEPEST * self.p99_m() / options.max_seam_slope.max(1e-3));
        // Never narrower than one coarse cell, unless the layer itself is hardly wider.
        let most = (options.max_share.clamp(0.0, 0.5) * side).max(coarse_cell_m.min(0.5 * side));
        wanted.min(most)
    }
}

/// The steps of every stretch: left, right, top, bottom, holes.
pub(super) struct Steps([Stretch; 5]);

impl Steps {
    /// Samples a finer model's raw rows: at the rim itself, and beside holes once in every block.
    pub fn sample(
        under: &Under<'_>,
        scratch: &mut Scratch,
        holes: Option<&BlockDistance>,
        block_cols: usize,
        block_rows: usize,
    ) -> Result<Self, Error> {
        let (last_col, last_row) = (under.fine.cols - 1, under.fine.rows - 1);
        let mut stretches: [Stretch; 5] = Default::default();
        let mut add = |stretch: usize, col: usize, row: usize, heights: &[f32]| {
            if let (Some((coarse, cell)), true) =
                (under.sample(col as f64, row as f64), heights[col].is_finite())
            {
                stretches[stretch].steps_m.push((f64::from(heights[col]) - coarse).abs());
                stretches[stretch].coarse_cell_m = stretches[stretch].coarse_cell_m.max(cell);
            }
        };
        let is_corner = |n: usize, last: usize| (n as f64 / last as f64 - 0.5).abs() > 0.5 - CORNER;
        let middle = |block: usize, last: usize| (block * SUPPORT_BLOCK + SUPPORT_BLOCK / 2).min(last);
        for (stretch, row) in [(2, 0), (3, last_row)] {
            let heights = scratch.read(row, 1)?;
            for col in (0..block_cols).map(|block| middle(block, last_col)) {
                if !is_corner(col, last_col) {
                    add(stretch, col, row, &heights);
                }
            }
        }
        for block_row in 0..block_rows {
            let row = middle(block_row, last_row);
            let heights = scratch.read(row, 1)?;
            if !is_corner(row, last_row) {
                add(0, 0, row, &heights);
                add(1, last_col, row, &heights);
            }
            let Some(holes) = holes else { continue };
            for block_col in 0..block_cols {
                if holes.block(block_col, block_row) <= STEP_BLOCKS {
                    add(4, middle(block_col, last_col), row, &heights);
                }
            }
        }
        for stretch in &mut stretches {
            stretch.steps_m.sort_by(f64::total_cmp);
        }
        Ok(Self(stretches))
    }

    /// Widths of the fade.
    pub fn widths(&self, grid: &Grid, options: &NestOptions) -> Widths {
        let [left_m, right_m, top_m, bottom_m, holes_m] =
            std::array::from_fn(|n| self.0[n].width_m(grid, options));
        Widths { left_m, right_m, top_m, bottom_m, holes_m }
    }

    /// 99th percentile and maximum over all stretches, metres.
    pub(crate) fn p99_and_max_m(&self) -> (f64, f64) {
        let mut all: Vec<f64> = self.0.iter().flat_map(|s| s.steps_m.iter().copied()).collect();
        all.sort_by(f64::total_cmp);
        let p99 = all.get(all.len().saturating_sub(1) * 99 / 100).copied().unwrap_or(0.0);
        (p99, all.last().copied().unwrap_or(0.0))
    }
}

/// Metres per column and per row at the middle.
pub(super) fn step_m(grid: &Grid) -> [f64; 2] {
    let [step_c, step_r] = grid.map_from_grid().steps();
    let scale = grid.cell_m() / (step_c * step_r).sqrt();
    [step_c * scale, step_r * scale]
}
