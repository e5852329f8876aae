//! One grid of node heights and the surface between the nodes.

use crate::{Error, Grid, Pyramid};
use std::sync::Arc;

/// Floats in memory or in a mapped file.
pub type Block = Arc<dyn AsRef<[f32]> + Send + Sync>;

/// Side of the blocks for which a layer records its effective cell size, cells.
pub const SUPPORT_BLOCK: usize = 16;

/// A regular grid of node heights in metres above the sphere (NaN: absent), with its pyramid.
#[derive(Clone)]
pub struct Layer {
    /// Where the nodes lie.
    pub grid: Grid,
    /// Node heights, rows first, `grid.cols` to a row, metres above the sphere; NaN where absent.
    pub heights: Block,
    /// Max and min levels.
    pub pyramid: Pyramid,
    /// Effective cell size per [`SUPPORT_BLOCK`]² cells, metres: larger than the grid's own where the layer was filled
    /// from a coarser one; `None` if it is the grid's own everywhere.
    pub support_m: Option<Block>,
    /// Size of the grid's own cells, metres.
    pub cell_m: f64,
    /// Lowest and highest height, metres.
    pub height_range: (f32, f32),
}

/// One bilinear cell: heights of its corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// At `(i, j)`.
    pub h00: f64,
    /// At `(i + 1, j)`.
    pub h10: f64,
    /// At `(i, j + 1)`.
    pub h01: f64,
    /// At `(i + 1, j + 1)`.
    pub h11: f64,
}

impl Patch {
    /// Height and its derivatives along column and row at fractions `(u, v)` of the cell.
    #[inline]
    pub fn eval(&self, u: f64, v: f64) -> (f64, f64, f64) {
        let d0 = self.h10 - self.h00;
        let d1 = self.h11 - self.h01;
        let e0 = self.h01 - self.h00;
        let cross = d1 - d0;
        (self.h00 + u * d0 + v * (e0 + u * cross), d0 + v * cross, e0 + u * cross)
    }
}

impl Layer {
    /// A layer in memory; builds its pyramid.
    ///
    /// # Errors
    /// [`Error::Grid`] if the number of heights is not that of the nodes, [`Error::AllAbsent`] if every height is NaN.
    pub fn from_heights(grid: Grid, heights: Vec<f32>) -> Result<Self, Error> {
        if heights.len() != grid.cols * grid.rows {
            return Err(Error::Grid {
                expected: "one height per node",
                found: format!("{} heights for {}×{} nodes", heights.len(), grid.cols, grid.rows),
            });
        }
        let pyramid = Pyramid::build(grid.cols, grid.rows, &heights);
        Self::from_parts(grid, Arc::new(heights), pyramid, None)
    }

    /// A layer from blocks that are already there (a mapped file).
    ///
    /// # Errors
    /// [`Error::AllAbsent`] if the pyramid's top says that there is no height.
    pub fn from_parts(
        grid: Grid,
        heights: Block,
        pyramid: Pyramid,
        support_m: Option<Block>,
    ) -> Result<Self, Error> {
        let top = pyramid.shape.top();
        let highest = pyramid.max_at(top, 0, 0);
        if highest == f32::NEG_INFINITY {
            return Err(Error::AllAbsent { name: "layer".into(), cells: grid.cols * grid.rows });
        }
        let lowest = lowest_present(&pyramid, (*heights).as_ref());
        let cell_m = grid.cell_m();
        Ok(Self { grid, heights, pyramid, support_m, cell_m, height_range: (lowest, highest) })
    }

    /// The node heights.
    #[inline]
    pub fn nodes(&self) -> &[f32] {
        (*self.heights).as_ref()
    }

    /// Height of node `(i, j)`, NaN if absent.
    #[inline]
    pub fn node(&self, i: usize, j: usize) -> f32 {
        self.nodes()[j * self.grid.cols + i]
    }

    /// The cell `(i, j)`; `None` if a corner is absent.
    #[inline]
    pub fn patch(&self, i: usize, j: usize) -> Option<Patch> {
        let at = j * self.grid.cols + i;
        let nodes = self.nodes();
        let below = at + self.grid.cols;
        let patch = Patch {
            h00: f64::from(nodes[at]),
            h10: f64::from(nodes[at + 1]),
            h01: f64::from(nodes[below]),
            h11: f64::from(nodes[below + 1]),
        };
        (patch.h00 + patch.h10 + patch.h01 + patch.h11).is_finite().then_some(patch)
    }

    /// The cell that holds grid coordinates on the node rectangle.
    #[inline]
    pub fn cell_of(&self, [c, r]: [f64; 2]) -> (usize, usize) {
        ((c.max(0.0) as usize).min(self.grid.cols - 2), (r.max(0.0) as usize).min(self.grid.rows - 2))
    }

    /// Bilinear height and its derivatives (metres per cell) at grid coordinates; `None` outside or where absent.
    pub fn bilinear(&self, at: [f64; 2]) -> Option<(f64, f64, f64)> {
        if !self.grid.contains(at) {
            return None;
        }
        let (i, j) = self.cell_of(at);
        Some(self.patch(i, j)?.eval(at[0] - i as f64, at[1] - j as f64))
    }

    /// Height and derivatives (metres per cell) of the C¹ surface: the biquadratic B-spline whose control points are the
    /// nodes, so that it stays within its 3×3 nodes and smooths them by (1, 6, 1)/8. `None` outside, within half a
    /// cell of the border, or next to an absent node.
    pub fn quadratic_b_spline(&self, at: [f64; 2]) -> Option<(f64, f64, f64)> {
        let (ci, rj) = (at[0].round(), at[1].round());
        let (cols, rows) = (self.grid.cols as f64, self.grid.rows as f64);
        if !(ci >= 1.0 && rj >= 1.0 && ci <= cols - 2.0 && rj <= rows - 2.0) {
            return None;
        }
        let weights = |t: f64| {
            // t in [-½, ½] from the middle node.
            let (a, b) = (0.5 - t, 0.5 + t);
            ([0.5 * a * a, 0.75 - t * t, 0.5 * b * b], [-a, -2.0 * t, b])
        };
        let (wc, dc) = weights(at[0] - ci);
        let (wr, dr) = weights(at[1] - rj);
        let (mut h, mut hc, mut hr) = (0.0, 0.0, 0.0);
        for j in 0..3 {
            for i in 0..3 {
                let node = f64::from(self.node(ci as usize + i - 1, rj as usize + j - 1));
                h += wc[i] * wr[j] * node;
                hc += dc[i] * wr[j] * node;
                hr += wc[i] * dr[j] * node;
            }
        }
        h.is_finite().then_some((h, hc, hr))
    }

    /// Effective cell size at grid coordinates, metres: what the heights there were really measured at.
    pub fn effective_cell_m(&self, at: [f64; 2]) -> f64 {
        let Some(support) = &self.support_m else { return self.cell_m };
        let (i, j) = self.cell_of(at);
        let blocks = (self.grid.cols - 1).div_ceil(SUPPORT_BLOCK);
        f64::from((**support).as_ref()[(j / SUPPORT_BLOCK) * blocks + i / SUPPORT_BLOCK])
    }
}

/// Lowest height: from the pyramid where no node is absent, else by walking down to the blocks with holes.
fn lowest_present(pyramid: &Pyramid, heights: &[f32]) -> f32 {
    let top = pyramid.min_at(pyramid.shape.top(), 0, 0);
    if top.is_finite() {
        return top;
    }
    heights.iter().copied().filter(|h| h.is_finite()).fold(f32::INFINITY, f32::min)
}
