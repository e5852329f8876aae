//! One grid of node heights and the surface between the nodes.

use crate::{Block, Error, Grid, Pyramid};
use std::sync::Arc;

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
    /// Effective cell size per `SUPPORT_BLOCK`² cells, metres: larger than the grid's own where the layer was filled
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

    /// Bounds of the bilinear surface over the part of a box `[c0, r0, c1, r1]` that lies on the grid, metres. The lower bound
    /// is −∞ where a node may be absent; both are −∞ where all are.
    pub fn height_bounds(&self, [c0, r0, c1, r1]: [f64; 4]) -> (f32, f32) {
        /// Boxes of more cells than this are bounded by the pyramid, smaller ones tightly, cell by cell.
        const MAX_CLIPPED_CELLS: f64 = 64.0;
        if (c1 - c0 + 2.0) * (r1 - r0 + 2.0) > MAX_CLIPPED_CELLS {
            return self.pyramid.bounds(c0, r0, c1, r1);
        }
        let (i0, j0) = self.cell_of([c0, r0]);
        let (i1, j1) = self.cell_of([c1, r1]);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for j in j0..=j1 {
            for i in i0..=i1 {
                let Some(patch) = self.patch(i, j) else {
                    low = f64::NEG_INFINITY;
                    continue;
                };
                // A bilinear patch is extreme at the corners of whatever rectangle the box cuts out of it.
                for u in [c0, c1] {
                    for v in [r0, r1] {
                        let (h, ..) =
                            patch.eval((u - i as f64).clamp(0.0, 1.0), (v - j as f64).clamp(0.0, 1.0));
                        (low, high) = (low.min(h), high.max(h));
                    }
                }
            }
        }
        // To the nearest f32 outwards.
        ((low as f32).next_down(), (high as f32).next_up())
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

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Body, Projection, proj_string::Crs};
    use selenograph_raster::georef::Affine;

    #[test]
    fn height_bounds_hold_and_are_tight_over_small_boxes() {
        let body = Body::moon();
        let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
        let grid = Grid::new(crs, 40, 30, Affine::new([0.0, 10.0, 0.0, 0.0, 0.0, -10.0])).unwrap();
        let heights = (0..40 * 30).map(|k| ((k as f32) * 0.7).sin() * 100.0).collect();
        let layer = Layer::from_heights(grid, heights).unwrap();
        for bounds in
            [[3.2, 4.1, 3.6, 4.4], [7.5, 2.5, 10.2, 5.0], [-3.0, -2.0, 0.4, 0.3], [0.0, 0.0, 39.0, 29.0]]
        {
            let (low, high) = layer.height_bounds(bounds);
            let (mut seen_low, mut seen_high) = (f64::INFINITY, f64::NEG_INFINITY);
            let (cols, rows) = (39.0, 29.0);
            for k in 0..=400 {
                for l in 0..=400 {
                    let at = |a: f64, b: f64, t: i32| a + (b - a) * f64::from(t) / 400.0;
                    let c = at(bounds[0].max(0.0), bounds[2].min(cols), k);
                    let (h, ..) =
                        layer.bilinear([c, at(bounds[1].max(0.0), bounds[3].min(rows), l)]).unwrap();
                    (seen_low, seen_high) = (seen_low.min(h), seen_high.max(h));
                }
            }
            assert!(f64::from(low) <= seen_low && f64::from(high) >= seen_high, "{bounds:?}");
            let small = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]) < 20.0;
            assert!(
                !small || (seen_low - f64::from(low) < 1.0 && f64::from(high) - seen_high < 1.0),
                "{bounds:?}"
            );
        }
    }
}
