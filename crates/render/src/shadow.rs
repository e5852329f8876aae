//! Shadow rays in lanes: column by column through the horizon's blocks, cell by cell only where a block is higher than the
//! ray.

use crate::horizon::{FOREIGN_M, Horizon, SKIPS};
use crate::nodes::{Cell, Nodes};
use crate::simd::{F32x16, I32x16, Mask32x16, floor, nonzero};
use crate::tile::Tile;

/// A ray is hidden if the ground stands this much above it, metres: rounding of the start.
const DEEP_M: f32 = 2e-3;
/// A cell is picked this far beyond a cell's edge, cells.
const NUDGE_CELLS: f32 = 1e-3;

/// Sixteen points on the ground and directions to the Sun.
pub(crate) struct ShadowRays<F> {
    /// Grid coordinates from the tile's first node.
    pub(crate) c: F,
    pub(crate) r: F,
    /// Height above the tile's reference height.
    pub(crate) z: F,
    /// Metres along the tile's tangents.
    pub(crate) a: F,
    pub(crate) b: F,
    /// Towards the Sun in the tile's frame.
    pub(crate) sun: [F; 3],
}

/// A ray over the grid by metres of its length: linear in column and row, quadratic in height.
#[derive(Clone, Copy)]
struct Line<F> {
    c: F,
    r: F,
    z: F,
    dc: F,
    dr: F,
    dz: F,
    bend: F,
}

impl<F: F32x16> Line<F> {
    #[inline(always)]
    fn height(&self, s: F) -> F {
        self.z + s * (self.dz + s * self.bend)
    }
}

/// An index brought into `0..n`.
#[inline(always)]
fn clamped<F: F32x16>(value: F::Int, n: i32) -> F::Int {
    value.max(F::Int::splat(0)).min(F::Int::splat(n - 1))
}

/// What is known of sixteen shadow rays.
pub(crate) struct Occlusion<F: F32x16> {
    /// Lanes that the ground hides.
    pub(crate) hidden: F::Mask,
    /// Lanes that are not decided.
    pub(crate) open: F::Mask,
    /// How far an undecided lane's ray is known to be clear, metres.
    pub(crate) clear_m: F,
}

/// Follows the `active` lanes towards the Sun.
#[inline(always)]
pub(crate) fn occlusion<F: F32x16>(
    tile: &Tile,
    nodes: &Nodes,
    horizon: Option<&Horizon>,
    rays: &ShadowRays<F>,
    mut active: F::Mask,
) -> Occlusion<F> {
    let s = F::splat;
    let int = F::Int::splat;
    let none = F::Mask::from_bits(0);
    let mut found = Occlusion { hidden: none, open: none, clear_m: s(0.0) };
    let Some(horizon) = horizon else {
        found.open = active;
        return found;
    };
    let [l1, l2, lw] = rays.sun;
    let line = Line {
        c: rays.c,
        r: rays.r,
        z: rays.z,
        dc: s(tile.jc[0]) * l1 + s(tile.jc[1]) * l2,
        dr: s(tile.jr[0]) * l1 + s(tile.jr[1]) * l2,
        dz: lw + s(tile.inv_r) * (rays.a * l1 + rays.b * l2),
        bend: s(0.5 * tile.inv_r) * (l1 * l1 + l2 * l2),
    };
    let m = &horizon.block_from_grid;
    let (bc, br) = (f64::from(tile.base[0]), f64::from(tile.base[1]));
    let (u_base, v_base) = ((m[0] * bc + m[1] * br + m[2]) as f32, (m[3] * bc + m[4] * br + m[5]) as f32);
    let m = m.map(|v| v as f32);
    let u = s(u_base) + s(m[0]) * line.c + s(m[1]) * line.r;
    let v = s(v_base) + s(m[3]) * line.c + s(m[4]) * line.r;
    let inv_du = s(1.0) / (s(m[0]) * line.dc + s(m[1]) * line.dr);
    let dv = s(m[3]) * line.dc + s(m[4]) * line.dr;
    let (columns, strips) = (horizon.columns as i32, horizon.strips as i32);
    let z_base = s(tile.z_base);
    let mut column = floor(u);
    let mut along = s(0.0);
    let groups = SKIPS.map(|skip| horizon.columns.div_ceil(skip) as i32);
    while active.any() {
        let leave = ((F::from_int(column) + s(1.0)) - u) * inv_du;
        let (strip, strip_out) = (floor(v + along * dv), floor(v + leave * dv));
        let col = clamped::<F>(column, columns);
        let (row, row_out) = (clamped::<F>(strip, strips), clamped::<F>(strip_out, strips));
        let inside = F::int_eq(column, col) & F::int_eq(strip, row) & F::int_eq(strip_out, row_out);
        found.clear_m = F::select(active, along, found.clear_m);
        found.open = found.open | (active & !inside);
        active = active & inside;
        let z_in = line.height(along) + z_base;
        // Above all of the next columns at once? Then they are one step.
        let mut step = int(1);
        for (k, skip) in SKIPS.into_iter().enumerate() {
            let by = int(skip.trailing_zeros() as i32);
            let aligned = F::int_eq(column.shr(by).shl(by), column);
            if (active & aligned).any() {
                let group = row.mul(int(groups[k])).add(col.shr(by));
                // SAFETY: `row` is a strip and `col` a column, so this is one of its groups.
                let highest = unsafe { F::gather(horizon.highest_of[k].as_ptr(), group) };
                step = F::select_int(aligned & !z_in.lt(highest), int(skip as i32), step);
            }
        }
        let next = column.add(step).min(int(columns));
        let skips = !F::int_eq(step, int(1));
        let leave = (F::from_int(next) - u) * inv_du;
        let row_out = clamped::<F>(floor(v + leave * dv), strips);
        // What lies beyond first: ground in this column does not matter to a ray that is hidden further on.
        let idx = row_out.mul(int(columns + 1)).add(clamped::<F>(next, columns + 1));
        // SAFETY: these have one column more than there are blocks.
        let (lit_above, dark_below) = unsafe {
            (F::gather(horizon.lit_above.as_ptr(), idx), F::gather(horizon.dark_below.as_ptr(), idx))
        };
        let z = line.height(leave) + z_base;
        let dark = active & z.lt(dark_below);
        found.hidden = found.hidden | dark;
        active = active & !dark;
        let walking = active & !skips;
        if walking.any() {
            // A ray drifts by less than a strip in a column: it touches these two blocks.
            let (block, block_out) = (row.mul(int(columns)).add(col), row_out.mul(int(columns)).add(col));
            // SAFETY: column and strips are clamped to the blocks.
            let (first, second) = unsafe {
                (F::gather(horizon.highest.as_ptr(), block), F::gather(horizon.highest.as_ptr(), block_out))
            };
            let (mark, half_mark) = (s(FOREIGN_M), s(0.5 * FOREIGN_M));
            let foreign = half_mark.lt(first.max(second));
            let first = F::select_lt(half_mark, first, first - mark, first);
            let second = F::select_lt(half_mark, second, second - mark, second);
            let below = walking & z_in.lt(first.max(second));
            found.open = found.open | (below & foreign);
            active = active & !(below & foreign);
            let below = below & !foreign;
            if below.any() {
                let hit = walk(tile, nodes, &line, along, leave, below);
                found.hidden = found.hidden | hit;
                active = active & !hit;
            }
        }
        active = active & z.lt(lit_above);
        along = leave;
        column = next;
    }
    found
}

/// Which lanes meet the ground between two places, cell by cell.
#[inline(always)]
fn walk<F: F32x16>(
    tile: &Tile,
    nodes: &Nodes,
    line: &Line<F>,
    from: F,
    to: F,
    mut active: F::Mask,
) -> F::Mask {
    let s = F::splat;
    let int = F::Int::splat;
    let (dc, dr) = (nonzero(line.dc), nonzero(line.dr));
    let (inv_c, inv_r) = (s(1.0) / dc, s(1.0) / dr);
    let probe = from + s(NUDGE_CELLS) / dc.abs().max(dr.abs());
    let (mut i, mut j) = (floor(line.c + probe * dc), floor(line.r + probe * dr));
    let (right, down) = (s(0.0).lt(dc), s(0.0).lt(dr));
    let step_c = F::select_int(right, int(1), int(-1));
    let step_r = F::select_int(down, int(1), int(-1));
    let mut next_c = (F::from_int(F::select_int(right, i.add(int(1)), i)) - line.c) * inv_c;
    let mut next_r = (F::from_int(F::select_int(down, j.add(int(1)), j)) - line.r) * inv_r;
    let (per_c, per_r) = (inv_c.abs(), inv_r.abs());
    let mut near = from;
    let mut hidden = F::Mask::from_bits(0);
    while active.any() {
        let far = next_c.min(next_r).min(to);
        let cell = Cell::new(nodes.cell::<F>(tile.base, tile.z_base, i, j), i, j);
        let g_near = line.height(near) - cell.height(line.c + near * dc, line.r + near * dr);
        let g_far = line.height(far) - cell.height(line.c + far * dc, line.r + far * dr);
        // The clearance in a cell is a parabola; where it opens upwards its lowest point may lie inside.
        let span = far - near;
        let bend = line.bend - cell.cross * dc * dr;
        let arch = bend * span * span;
        let slope = g_far - g_near - arch;
        // The lowest point lies slope²/4 arch below the near end; compared without dividing.
        let dips = s(0.0).lt(arch) & slope.lt(s(0.0)) & (s(0.0) - slope).lt(s(2.0) * arch);
        let deep_dip = dips & (s(4.0) * arch * (g_near + s(DEEP_M))).lt(slope * slope);
        let found = active & (g_far.lt(s(-DEEP_M)) | deep_dip);
        hidden = hidden | found;
        active = active & !found & far.lt(to);
        let across_c = next_c.lt(next_r);
        i = F::select_int(across_c, i.add(step_c), i);
        j = F::select_int(across_c, j, j.add(step_r));
        next_c = F::select(across_c, next_c + per_c, next_c);
        next_r = F::select(across_c, next_r, next_r + per_r);
        near = far;
    }
    hidden
}
