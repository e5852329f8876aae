//! Points into an elevation model: both pointmaps as surfaces, sampled at the cells of a regular grid.

pub(crate) mod fade;
pub mod frame;
pub mod lift;
pub mod mesh;
pub mod plane;
pub(crate) mod rasterise;
pub mod wkt;

use crate::Error;
use crate::prediction::{Fill, Prediction};
use crate::scale::Placement;
pub use frame::GridFrame;
use lift::{Lifted, LiftedView, round_to};
use rasterise::{Gathered, Layout};
use selenograph_raster::statistics::{median, quantiles};
use selenograph_raster::{Affine, Raster};
use serde::{Deserialize, Serialize};

/// What is done with completed points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Completed {
    /// They are left out: the model holds what was measured.
    #[default]
    Leave,
    /// They fill cells that nothing measured covers, and are marked.
    Include,
}

/// How a grid is made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GridOptions {
    /// Side of a cell in the grid's unit; `None` takes the median ground sampling distance, two significant digits.
    pub cell: Option<f64>,
    /// What is done with completed points.
    pub completed: Completed,
    /// Largest number of cells; where no cell is asked for, a grid that would have more gets larger ones.
    pub max_cells: usize,
}

impl Default for GridOptions {
    fn default() -> Self {
        Self { cell: None, completed: Completed::Leave, max_cells: 1 << 24 }
    }
}

/// An elevation model with its uncertainty.
#[derive(Debug, Clone)]
pub struct Dem {
    /// Its coordinates.
    pub frame: GridFrame,
    /// Side of a cell, in units of x and y.
    pub cell: f64,
    /// Corner-based raster coordinates → x, y.
    pub map_from_pixel: Affine,
    /// Height above the body's sphere, or above the local frame's zero; NaN where absent.
    pub heights: Raster<f32>,
    /// Standard deviation of the height; NaN where absent or where the method has no sigma.
    pub sigma: Raster<f32>,
    /// Number of views that cover the cell.
    pub count: Raster<u8>,
    /// Whether a cell was measured or completed.
    pub fill: Raster<Fill>,
}

impl Dem {
    /// Ground lengths of a cell across and down, at the middle of the grid.
    pub fn ground_cell(&self) -> [f64; 2] {
        let [x, y] =
            self.map_from_pixel.apply(self.heights.width as f64 / 2.0, self.heights.height as f64 / 2.0);
        self.frame.ground_per_unit(x, y).map(|ground| ground * self.cell)
    }

    /// Share of the cells that hold a height.
    pub fn coverage(&self) -> f64 {
        let num_there = self.heights.data.iter().filter(|h| !h.is_nan()).count();
        num_there as f64 / self.heights.data.len().max(1) as f64
    }
}

/// An elevation model of a placed prediction, with the points it was made of.
///
/// Both views are gridded as surfaces and fused by inverse variance: `h = Σ wᵢ hᵢ / Σ wᵢ`, `wᵢ = fᵢ/σᵢ²`, where `fᵢ` falls from
/// 1 towards the border of what a view has measured, so that the heights have no step there. Both come from the same two
/// pictures, so their errors are not independent and averaging them is no gain:
/// `σ² = Σ fᵢ / Σ wᵢ + Σ wᵢ (hᵢ − h)² / Σ wᵢ` (their typical variance, and how far they disagree).
///
/// # Errors
/// [`Error::TooFewPoints`] for a prediction without a surface; [`Error::Value`] for a cell that is not positive,
/// [`Error::Cell`] for one that is larger than the ground, or of which the ground would hold too many.
pub fn grid<'a>(
    prediction: &'a Prediction,
    placement: &Placement,
    options: &GridOptions,
) -> Result<(Dem, Lifted<'a>), Error> {
    let frame = GridFrame::of(prediction, placement)?;
    let lifted = lift::lift(prediction, &frame)?;
    let dem = grid_lifted(frame, &lifted, options)?;
    Ok((dem, lifted))
}

/// The same from points that are already in the grid's coordinates.
///
/// # Errors
/// Those of [`grid`].
pub fn grid_lifted(frame: GridFrame, lifted: &Lifted, options: &GridOptions) -> Result<Dem, Error> {
    let cell = match options.cell {
        Some(cell) if cell.is_finite() && cell > 0.0 => cell,
        Some(cell) => {
            let expected = "a length > 0 in the grid's unit";
            return Err(Error::Value { key: "cell", expected, found: cell.to_string() });
        }
        None => round_to(ground_sampling(&lifted.views)?, 2.0),
    };
    let (layout, map_from_pixel, cell) = lay_out(lifted, cell, options)?;
    let joins = lifted.views.each_ref().map(mesh::joins);
    let completed = options.completed == Completed::Include;
    let cells = rasterise::gather(lifted, joins.each_ref().map(Option::as_deref), &layout, completed);
    let with_sigma = lifted.views.iter().all(|view| view.sigma.is_some());
    let raster = |f: &dyn Fn(&Gathered) -> f32| Raster {
        width: layout.width,
        height: layout.height,
        data: cells.iter().map(f).collect(),
    };
    let heights = raster(&|c| (c.weighted / c.weight + lifted.origin[2]) as f32);
    let sigma = raster(&|c| if with_sigma { c.sigma() as f32 } else { f32::NAN });
    let (width, height) = (layout.width, layout.height);
    let count = Raster { width, height, data: cells.iter().map(|c| c.count.min(255) as u8).collect() };
    let fill = Raster { width, height, data: cells.iter().map(|c| c.fill).collect() };
    Ok(Dem { frame, cell, map_from_pixel, heights, sigma, count, fill })
}

impl Gathered {
    fn sigma(&self) -> f64 {
        let mean = self.weighted / self.weight;
        let disagreement = (self.squared / self.weight - mean * mean).max(0.0);
        (self.presence / self.weight + disagreement).sqrt()
    }
}

/// Median ground sampling distance: root of the horizontal area between a pixel and its neighbours.
fn ground_sampling(views: &[LiftedView; 2]) -> Result<f64, Error> {
    let mut sides = Vec::new();
    for view in views {
        let p = &view.points;
        let step = (p.data.len() / 65_536).max(1);
        for i in (0..p.data.len().saturating_sub(p.width)).step_by(step) {
            if (i + 1) % p.width == 0 || view.fill.data[i] == Fill::Absent {
                continue;
            }
            let (a, b, c) = (p.data[i], p.data[i + 1], p.data[i + p.width]);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            if area.is_finite() {
                sides.push(f64::from(area.abs().sqrt()));
            }
        }
    }
    let found = sides.len();
    median(sides).filter(|side| *side > 0.0).ok_or(Error::TooFewPoints {
        what: "an elevation model",
        needed: 3,
        found,
    })
}

/// Share of the points left out at each side before the extent is taken: a few blunders must not blow up the grid.
const OUTSIDE: f64 = 0.002;
/// What is added again at each side, as a share of the extent between those quantiles.
const MARGIN: f64 = 0.1;

/// Factor on the least side of a cell, so that a row and a column at the edges still fit.
const ROOM: f64 = 1.01;

/// The grid that holds the points, its corner on a multiple of the cell.
fn lay_out(lifted: &Lifted, cell: f64, options: &GridOptions) -> Result<(Layout, Affine, f64), Error> {
    let mut ranges = [[0.0; 2]; 2];
    for (axis, range) in ranges.iter_mut().enumerate() {
        let kept = |view: &LiftedView, i: usize| {
            options.completed == Completed::Include || view.fill.data[i] == Fill::Measured
        };
        let all = || {
            lifted.views.iter().filter(|view| view.center.is_some()).flat_map(|view| {
                let values = view.points.data.iter().enumerate();
                values.filter(|(i, p)| p[0].is_finite() && kept(view, *i)).map(|(_, p)| f64::from(p[axis]))
            })
        };
        let step = (all().count() / 65_536).max(1);
        let none = Error::TooFewPoints { what: "an elevation model", needed: 3, found: 0 };
        let [low, high] = quantiles(all().step_by(step), [OUTSIDE, 1.0 - OUTSIDE]).ok_or(none)?;
        let margin = MARGIN * (high - low);
        let (least, most) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        *range = [least.max(low - margin), most.min(high + margin)];
    }
    let mut cell = cell;
    let cells_of = |cell: f64| ranges.map(|[low, high]| ((high - low) / cell).ceil() + 1.0);
    let [across, down] = cells_of(cell);
    let [length, width] = ranges.map(|[low, high]| high - low);
    let is_too_many = across * down > options.max_cells as f64;
    if let Some(found) = options.cell.filter(|cell| is_too_many || *cell > length.min(width)) {
        // At most two cells more on either axis than lengths over cells: (length / c + 2)(width / c + 2) is the most there may be.
        let (area, half) = (length * width, length + width);
        let most_cells = (options.max_cells as f64).max(5.0);
        let least = (area / ((half * half + area * (most_cells - 4.0)).sqrt() - half)).max(0.0);
        return Err(Error::Cell { found, least, most: length.min(width) });
    }
    if is_too_many {
        cell *= (across * down / options.max_cells as f64).sqrt() * ROOM;
    }
    let [[x0, x1], [y0, y1]] = ranges;
    let left = ((lifted.origin[0] + x0) / cell).floor();
    let top = ((lifted.origin[1] + y1) / cell).ceil();
    let width = (((lifted.origin[0] + x1) / cell).ceil() - left).max(1.0) as usize;
    let height = (top - ((lifted.origin[1] + y0) / cell).floor()).max(1.0) as usize;
    let layout = Layout {
        left: (left * cell - lifted.origin[0]) as f32,
        top: (top * cell - lifted.origin[1]) as f32,
        cell: cell as f32,
        width,
        height,
    };
    Ok((layout, Affine::north_up(left * cell, top * cell, cell, cell), cell))
}

#[cfg(test)]
mod tests;
