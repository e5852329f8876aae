//! An elevation model of the ground on the cells: what the pictures sharpen.
//!
//! Of a model that is coarser than the pictures the long waves are right and the short ones missing, so it holds in two ways: each
//! cell loosely, within the relief that the model does not show, and means over the model's own resolution tightly.

use super::anchor::{Anchor, Means};
use super::patch::Patch;
use rayon::prelude::*;
use selenograph_geometry::Vector3;
use selenograph_raster::Raster;
use std::fmt;

/// How far a point of the scene lies above an elevation model, in the scene's unit; `None` where it has no data.
pub type HeightOver<'a> = dyn Fn(&Vector3<f64>) -> Option<f64> + Sync + 'a;

/// An elevation model that is known beforehand. Lengths are in the scene's unit.
#[derive(Clone, Copy)]
pub struct KnownGround<'a> {
    /// The model.
    pub height_over: &'a HeightOver<'a>,
    /// Length below which the model holds no relief; at least its cell.
    pub resolution: f64,
    /// Standard deviation of the model's heights, means over its resolution compared with means of the ground.
    pub sigma: f64,
    /// Standard deviation of the relief that the model does not hold.
    pub missing_relief: f64,
}

impl fmt::Debug for KnownGround<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { height_over: _, resolution, sigma, missing_relief } = self;
        f.debug_struct("KnownGround")
            .field("resolution", resolution)
            .field("sigma", sigma)
            .field("missing_relief", missing_relief)
            .finish_non_exhaustive()
    }
}

/// Steps with which a line is brought to the ground.
const STEPS: usize = 24;
/// Distance from the ground at which they end, in cells.
const REACHED: f64 = 2e-4;
/// Longest step, in cells: over a cliff the secant would leave the model.
const LONGEST_STEP: f64 = 64.0;
/// Least rise over the ground for a step along a line, of which a line at 80° from the vertical still has two thirds.
const LEAST_RISE: f64 = 0.1;
/// Least standard deviation that is believed, in cells.
const LEAST_SIGMA: f64 = 1e-3;

impl KnownGround<'_> {
    /// How many levels of cells are coarser than what the model shows: the surface starts at the last of them.
    pub(super) fn levels(&self, cell: f64) -> usize {
        (self.resolution / cell).log2().floor().max(0.0) as usize
    }

    /// Height at which the line of a column and row meets the model, in cells, from a height near it.
    pub(super) fn height_on_line(&self, patch: &Patch, x: f32, y: f32, near: f64) -> Option<f64> {
        let over =
            |height: f64| Some((self.height_over)(&patch.point_of([x, y, height as f32]))? / patch.cell);
        let mut height = near;
        let mut above = over(height)?;
        let mut rise = 1.0f64;
        for _ in 0..STEPS {
            if above.abs() < REACHED {
                return Some(height);
            }
            let step = (-above / rise).clamp(-LONGEST_STEP, LONGEST_STEP);
            let next = over(height + step)?;
            rise = ((next - above) / step).max(LEAST_RISE);
            (height, above) = (height + step, next);
        }
        None
    }
}

impl Anchor {
    /// The model's heights on the cells of the finest level.
    pub(super) fn of_ground(ground: &KnownGround<'_>, patch: &Patch) -> Self {
        let (width, height) = (patch.width, patch.height);
        let mut heights = Raster::filled(width, height, f32::NAN);
        heights.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                if let Some(found) = ground.height_on_line(patch, x as f32 + 0.5, y as f32 + 0.5, 0.0) {
                    *out = found as f32;
                }
            }
        });
        let precision = |sigma: f64| (sigma / patch.cell).max(LEAST_SIGMA).powi(-2) as f32;
        let of_cells = precision(ground.missing_relief.max(ground.sigma));
        let side = ground.resolution / patch.cell;
        // Means about neighbours are nearly one: as many as a square has cells count as one.
        Self {
            precision: heights.map(|h| if h.is_nan() { 0.0 } else { of_cells }),
            heights: heights.map(|h| if h.is_nan() { 0.0 } else { *h }),
            share: 1.0,
            follows_pose: false,
            means: Some(Means { side, precision: precision(ground.sigma) / (side * side).max(1.0) as f32 }),
        }
    }
}
