//! The surface under sixteen points: a layer's nodes and the bilinear cells between them.

use crate::simd::{F32x16, I32x16, floor};

/// A layer's nodes as the lanes address them.
#[derive(Clone, Copy)]
pub(crate) struct Nodes {
    pub(crate) base: *const f32,
    pub(crate) cols: i32,
    pub(crate) rows: i32,
}

/// The surface under sixteen points.
#[derive(Clone, Copy)]
pub(crate) struct Ground<F> {
    /// Height above the tile's reference height.
    pub(crate) z: F,
    /// Derivatives along columns and rows, metres per cell.
    pub(crate) hc: F,
    pub(crate) hr: F,
}

impl Nodes {
    /// The bilinear surface at grid coordinates given from node `base`; coordinates outside the grid use its border
    /// cells.
    #[inline(always)]
    pub(crate) fn ground<F: F32x16>(&self, base: [i32; 2], z_base: f32, c: F, r: F) -> Ground<F> {
        let (i, j) = (floor(c), floor(r));
        let cell = Cell::new(self.cell::<F>(base, z_base, i, j), i, j);
        let (fu, fv) = (c - cell.i, r - cell.j);
        let hr = cell.e0 + fu * cell.cross;
        Ground { z: cell.h00 + fu * cell.d0 + fv * hr, hc: cell.d0 + fv * cell.cross, hr }
    }

    /// Corner heights of the cells `(i, j)` counted from node `base`.
    #[inline(always)]
    pub(crate) fn cell<F: F32x16>(&self, base: [i32; 2], z_base: f32, i: F::Int, j: F::Int) -> [F; 4] {
        let row = clamped_cell::<F>(j, base[1], self.rows).mul(F::Int::splat(self.cols));
        let idx = row.add(clamped_cell::<F>(i, base[0], self.cols));
        // SAFETY: column and row were clamped to cells, so node, right neighbour, lower neighbour and the one right of
        // that are inside the layer's nodes.
        let ((h00, h10), (h01, h11)) = unsafe {
            (F::gather_pair(self.base, idx), F::gather_pair(self.base, idx.add(F::Int::splat(self.cols))))
        };
        let z = F::splat(z_base);
        [h00 - z, h10 - z, h01 - z, h11 - z]
    }
}

/// Sixteen bilinear cells.
pub(crate) struct Cell<F> {
    pub(crate) h00: F,
    /// Steps from the first corner along columns and rows, and what the opposite corner adds to both.
    pub(crate) d0: F,
    pub(crate) e0: F,
    pub(crate) cross: F,
    /// Its first corner.
    pub(crate) i: F,
    pub(crate) j: F,
}

impl<F: F32x16> Cell<F> {
    #[inline(always)]
    pub(crate) fn new([h00, h10, h01, h11]: [F; 4], i: F::Int, j: F::Int) -> Self {
        let d0 = h10 - h00;
        Self { h00, d0, e0: h01 - h00, cross: (h11 - h01) - d0, i: F::from_int(i), j: F::from_int(j) }
    }

    /// The surface at grid coordinates.
    #[inline(always)]
    pub(crate) fn height(&self, c: F, r: F) -> F {
        let (u, v) = (c - self.i, r - self.j);
        self.h00 + u * self.d0 + v * (self.e0 + u * self.cross)
    }
}

/// Column or row of a cell from that relative to `first`, brought into a grid of `n` nodes.
#[inline(always)]
pub(crate) fn clamped_cell<F: F32x16>(v: F::Int, first: i32, n: i32) -> F::Int {
    v.add(F::Int::splat(first)).max(F::Int::splat(0)).min(F::Int::splat(n - 2))
}
