//! Triangles of both views' surfaces into the cells of a grid, tile by tile.
//!
//! Each tile is filled by one thread in a fixed order of triangles, so the result does not depend on the number of
//! threads. Neighbouring triangles share their edge exactly (no cell is missed, none is counted twice).

use super::fade;
use super::lift::{Lifted, LiftedView};
use super::mesh::{DOWN, RIGHT};
use crate::prediction::Fill;
use rayon::prelude::*;
use selenograph_geometry::pixel::HALF_PIXEL;

/// Side of a tile, cells.
const TILE: usize = 64;
/// Side of a block of pixels that is skipped as a whole, pixels.
const BLOCK: usize = 32;
/// Where a cell is sampled.
const CENTER: f32 = HALF_PIXEL as f32;

/// Where a grid's cells lie against [`Lifted::origin`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// x of the left edge.
    pub left: f32,
    /// y of the upper edge.
    pub top: f32,
    /// Side of a cell.
    pub cell: f32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// What one cell has gathered.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gathered {
    /// Σ f: how much the views count there.
    pub presence: f64,
    /// Σ f w.
    pub weight: f64,
    /// Σ f w h.
    pub weighted: f64,
    /// Σ f w h².
    pub squared: f64,
    /// Number of triangles (as a rule, of views) over the cell's centre.
    pub count: u32,
    /// Whether all of them were measured.
    pub fill: Fill,
}

/// A view with its joins, cut into blocks.
struct Surface<'a> {
    view: &'a LiftedView<'a>,
    joins: &'a [u8],
    /// How much each pixel counts beside the other view.
    fade: Vec<f32>,
    center: [f32; 3],
    /// Columns and rows covered by each block: `[u0, v0, u1, v1]`.
    blocks: Vec<[f32; 4]>,
    blocks_across: usize,
}

/// A corner of a triangle: column, row, height, and the weight's spread or the confidence.
type Corner = [f32; 4];

/// Gathers the heights of both surfaces in the cells of a layout; cells that no measured surface covers take completed
/// points where `completed` is set.
pub fn gather(lifted: &Lifted, joins: [Option<&[u8]>; 2], layout: &Layout, completed: bool) -> Vec<Gathered> {
    let surfaces: Vec<Surface> = lifted
        .views
        .iter()
        .zip(joins)
        .filter_map(|(view, joins)| Some(Surface::new(view, joins?, view.center?, layout)))
        .collect();
    let (across, down) = (layout.width.div_ceil(TILE), layout.height.div_ceil(TILE));
    let tiles: Vec<Vec<Gathered>> = (0..across * down)
        .into_par_iter()
        .map(|idx| {
            let mut tile = Tile::new(idx % across * TILE, idx / across * TILE);
            for surface in &surfaces {
                surface.draw(&mut tile, layout, Fill::Measured);
            }
            if completed {
                for surface in &surfaces {
                    surface.draw(&mut tile, layout, Fill::Completed);
                }
            }
            tile.cells
        })
        .collect();
    let mut cells = vec![Gathered::default(); layout.width * layout.height];
    for (y, row) in cells.chunks_mut(layout.width.max(1)).enumerate() {
        for (tile_x, part) in row.chunks_mut(TILE).enumerate() {
            let tile = &tiles[y / TILE * across + tile_x];
            part.copy_from_slice(&tile[y % TILE * TILE..][..part.len()]);
        }
    }
    cells
}

struct Tile {
    left: usize,
    top: usize,
    cells: Vec<Gathered>,
}

impl Tile {
    fn new(left: usize, top: usize) -> Self {
        Self { left, top, cells: vec![Gathered::default(); TILE * TILE] }
    }
}

impl<'a> Surface<'a> {
    fn new(view: &'a LiftedView<'a>, joins: &'a [u8], center: [f32; 3], layout: &Layout) -> Self {
        let (width, height) = (view.points.width, view.points.height);
        let blocks_across = width.div_ceil(BLOCK);
        let blocks = (0..blocks_across * height.div_ceil(BLOCK))
            .into_par_iter()
            .map(|idx| {
                let (x0, y0) = (idx % blocks_across * BLOCK, idx / blocks_across * BLOCK);
                let mut bounds = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
                // A block's triangles reach the first pixels of the next one.
                for y in y0..(y0 + BLOCK + 1).min(height) {
                    for p in &view.points.row(y)[x0..(x0 + BLOCK + 1).min(width)] {
                        let [u, v] = layout.place(p);
                        bounds = [bounds[0].min(u), bounds[1].min(v), bounds[2].max(u), bounds[3].max(v)];
                    }
                }
                bounds
            })
            .collect();
        Self { view, joins, fade: fade::weights(view), center, blocks, blocks_across }
    }

    /// Draws the triangles whose least certain corner is of kind `fill`.
    fn draw(&self, tile: &mut Tile, layout: &Layout, fill: Fill) {
        let (width, height) = (self.view.points.width, self.view.points.height);
        let reach = [tile.left as f32, tile.top as f32, (tile.left + TILE) as f32, (tile.top + TILE) as f32];
        for (idx, bounds) in self.blocks.iter().enumerate() {
            if !overlaps(bounds, &reach) {
                continue;
            }
            let (x0, y0) = (idx % self.blocks_across * BLOCK, idx / self.blocks_across * BLOCK);
            for y in y0..(y0 + BLOCK).min(height.saturating_sub(1)) {
                for x in x0..(x0 + BLOCK).min(width.saturating_sub(1)) {
                    self.draw_quad(tile, layout, &reach, y * width + x, fill);
                }
            }
        }
    }

    /// The two triangles between a pixel and its neighbours right, below and across, as far as they are there.
    fn draw_quad(&self, tile: &mut Tile, layout: &Layout, reach: &[f32; 4], i: usize, fill: Fill) {
        let width = self.view.points.width;
        let at = [i, i + 1, i + width, i + width + 1];
        let corners: [Corner; 4] = at.map(|i| {
            let p = &self.view.points.data[i];
            let [u, v] = layout.place(p);
            [u, v, p[2], self.spread(i)]
        });
        let mut bounds = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
        for [u, v, ..] in &corners {
            bounds = [bounds[0].min(*u), bounds[1].min(*v), bounds[2].max(*u), bounds[3].max(*v)];
        }
        if !overlaps(&bounds, reach) {
            return;
        }
        let (here, right, below) = (self.joins[i], self.joins[i + 1], self.joins[i + width]);
        let (top, left) = (here & RIGHT != 0, here & DOWN != 0);
        let (bottom, far) = (below & RIGHT != 0, right & DOWN != 0);
        // Split between right and below; where one corner is missing or torn off, the other three still make a triangle.
        let halves = [(top && left, [0, 1, 2]), (bottom && far, [3, 2, 1])];
        let others = [(top && far, [1, 3, 0]), (left && bottom, [2, 0, 3])];
        let chosen = if halves.iter().any(|(joined, _)| *joined) { halves } else { others };
        for (_, [a, b, c]) in chosen.into_iter().filter(|(joined, _)| *joined) {
            self.draw_triangle(tile, layout, [&corners[a], &corners[b], &corners[c]], at, [a, b, c], fill);
        }
    }

    /// Sigma where the method has one, else the confidence.
    fn spread(&self, i: usize) -> f32 {
        self.view.sigma.as_ref().map_or(self.view.confidence.data[i], |sigma| sigma.data[i])
    }

    fn draw_triangle(
        &self,
        tile: &mut Tile,
        layout: &Layout,
        corners: [&Corner; 3],
        at: [usize; 4],
        which: [usize; 3],
        fill: Fill,
    ) {
        let kinds = which.map(|k| self.view.fill.data[at[k]]);
        let kind = if kinds.contains(&Fill::Completed) { Fill::Completed } else { Fill::Measured };
        if kind != fill {
            return;
        }
        let Some(plane) = Facet::new(corners) else { return };
        let weight = self.weight(&plane, corners, layout);
        // Over the facet as heights are: constant in each, it would make terraces where the views disagree.
        let fades: [Corner; 3] = std::array::from_fn(|k| {
            let [u, v, ..] = *corners[k];
            [u, v, self.fade[at[which[k]]], 0.0]
        });
        let Some(fading) = Facet::new(fades.each_ref()) else { return };
        let span = |axis: usize, from: usize| {
            let values = corners.map(|c| c[axis]);
            let low = values[0].min(values[1]).min(values[2]);
            let high = values[0].max(values[1]).max(values[2]);
            let first = (low - CENTER).ceil().max(from as f32) as usize;
            let end = ((high - CENTER).floor() + 1.0).clamp(0.0, (from + TILE) as f32) as usize;
            first..end
        };
        for row in span(1, tile.top) {
            for column in span(0, tile.left) {
                let (u, v) = (column as f32 + CENTER, row as f32 + CENTER);
                if plane.holds(u, v) {
                    let cell = &mut tile.cells[(row - tile.top) * TILE + column - tile.left];
                    // Just outside a thin facet, by rounding, it could be none.
                    let fade = f64::from(fading.height(u, v)).clamp(fade::LEAST, 1.0);
                    cell.add(f64::from(plane.height(u, v)), weight, fade, fill);
                }
            }
        }
    }

    /// Inverse variance of the facet's height: an error δ along the ray `d` lifts the surface by `δ |d_z − ∇h·d_xy|`. A
    /// method without sigma is weighted by its confidence.
    fn weight(&self, facet: &Facet, corners: [&Corner; 3], layout: &Layout) -> f64 {
        let spread = corners.iter().map(|c| c[3]).sum::<f32>() / 3.0;
        if self.view.sigma.is_none() {
            return f64::from(spread.max(MIN_CONFIDENCE));
        }
        let [u, v, h, _] = corners[0];
        let x = layout.left + u * layout.cell - self.center[0];
        let y = layout.top - v * layout.cell - self.center[1];
        let z = h - self.center[2];
        let range = (x * x + y * y + z * z).sqrt();
        // Rows run down, y up.
        let lift = (z - (facet.per_column * x - facet.per_row * y) / layout.cell) / range;
        let sigma = f64::from(spread * lift.abs().max(MIN_LIFT));
        1.0 / (sigma * sigma).max(f64::MIN_POSITIVE)
    }
}

/// A point of no confidence still counts a little: it is there.
const MIN_CONFIDENCE: f32 = 1e-6;
/// A surface in the line of sight would seem to have no error in height; its error across is as large as elsewhere.
const MIN_LIFT: f32 = 0.05;

impl Layout {
    /// Column and row of a point, measured from the grid's corner.
    #[inline]
    fn place(&self, p: &[f32; 3]) -> [f32; 2] {
        [(p[0] - self.left) / self.cell, (self.top - p[1]) / self.cell]
    }
}

fn overlaps(a: &[f32; 4], b: &[f32; 4]) -> bool {
    a[0] <= b[2] && a[2] >= b[0] && a[1] <= b[3] && a[3] >= b[1]
}

impl Gathered {
    fn add(&mut self, height: f64, weight: f64, fade: f64, fill: Fill) {
        if fill == Fill::Completed && self.fill == Fill::Measured {
            return;
        }
        let faded = fade * weight;
        self.presence += fade;
        self.weight += faded;
        self.weighted += faded * height;
        self.squared += faded * height * height;
        self.count += 1;
        self.fill = fill;
    }
}

/// A triangle over the grid: its edges and the plane of its heights.
struct Facet {
    corners: [[f32; 2]; 3],
    /// +1 or −1: the sense in which the corners go round.
    sense: f32,
    per_column: f32,
    per_row: f32,
    base: [f32; 3],
}

impl Facet {
    /// `None` for a triangle without area (or with an absent corner).
    #[inline]
    fn new(corners: [&Corner; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        let (ux, uy, uh) = (b[0] - a[0], b[1] - a[1], b[2] - a[2]);
        let (vx, vy, vh) = (c[0] - a[0], c[1] - a[1], c[2] - a[2]);
        let area = ux * vy - uy * vx;
        if area == 0.0 || !area.is_finite() {
            return None;
        }
        Some(Self {
            corners: corners.map(|c| [c[0], c[1]]),
            sense: area.signum(),
            per_column: (uh * vy - vh * uy) / area,
            per_row: (vh * ux - uh * vx) / area,
            base: [a[0], a[1], a[2]],
        })
    }

    #[inline]
    fn height(&self, u: f32, v: f32) -> f32 {
        self.base[2] + self.per_column * (u - self.base[0]) + self.per_row * (v - self.base[1])
    }

    /// Whether a place lies inside; one on an edge belongs to the triangle on one side of it only.
    #[inline]
    fn holds(&self, u: f32, v: f32) -> bool {
        let [a, b, c] = self.corners;
        self.is_left_of(a, b, u, v) && self.is_left_of(b, c, u, v) && self.is_left_of(c, a, u, v)
    }

    #[inline]
    fn is_left_of(&self, from: [f32; 2], to: [f32; 2], u: f32, v: f32) -> bool {
        // Both triangles of an edge compute the same number, because its ends are put in one order.
        let turned = from > to;
        let (a, b) = if turned { (to, from) } else { (from, to) };
        let side = (b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0]);
        let side = if turned { -side } else { side } * self.sense;
        side > 0.0 || (side == 0.0 && (turned == (self.sense > 0.0)))
    }
}
