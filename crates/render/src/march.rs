//! First hits in lanes where a ray may have several roots: a traversal of the pyramid along short chords.

use crate::job::Job;
use crate::nodes::{Cell, Nodes, clamped_cell};
use crate::rays::{At, Rays, path};
use crate::simd::{F32x16, I32x16, LANES, Mask32x16, floor, nonzero};
use crate::tile::Tile;

/// Chords longer than this would leave the curved path by more than 2 cm (`s²/8R`).
const MAX_CHORD_M: f32 = 500.0;
/// Levels that the traversal climbs to: 32×32 cells, more than a tile's box often has.
const TOP_LEVEL: i32 = 5;
/// Level that it starts at.
const START_LEVEL: i32 = 2;
/// A cell is picked this far beyond a cell's edge, cells.
const NUDGE_CELLS: f32 = 1e-3;

/// The layer's max levels as the lanes address them.
struct Levels {
    base: *const f32,
    offset: [i32; LANES],
    cols: [i32; LANES],
    rows: [i32; LANES],
    top: i32,
}

/// First hits of the lanes in `used` between the tile's depths; lanes of the mask hit nothing.
#[inline(always)]
pub(crate) fn first_hit<F: F32x16>(
    job: &Job<'_>,
    tile: &Tile,
    nodes: &Nodes,
    rays: &Rays<F>,
    used: F::Mask,
) -> (F, F::Mask) {
    let view = &job.tracer.layers[tile.layer_idx];
    let shape = &view.layer.pyramid.shape;
    let entry = |values: &[usize], k: usize| values[k.min(shape.top())] as i32;
    let levels = Levels {
        base: view.max.as_ptr(),
        offset: std::array::from_fn(|k| entry(&shape.max_offset, k)),
        cols: std::array::from_fn(|k| entry(&shape.cols, k)),
        rows: std::array::from_fn(|k| entry(&shape.rows, k)),
        top: TOP_LEVEL.min(shape.top() as i32),
    };
    let num_chords = (tile.length_m / MAX_CHORD_M).ceil().max(1.0);
    let step = (tile.tau[1] - tile.tau[0]) / num_chords;
    let mut tau = F::splat(tile.tau[1]);
    let mut active = used;
    for k in 0..num_chords as usize {
        let near = tile.tau[0] + step * k as f32;
        let (hit, s) = chord(tile, nodes, &levels, rays, near, near + step, active);
        tau = F::select(hit, F::splat(near) + s * F::splat(step), tau);
        active = active & !hit;
        if !active.any() {
            break;
        }
    }
    (tau, active)
}

#[inline(always)]
fn chord<F: F32x16>(
    tile: &Tile,
    nodes: &Nodes,
    levels: &Levels,
    rays: &Rays<F>,
    near: f32,
    far: f32,
    mut active: F::Mask,
) -> (F::Mask, F) {
    let s = F::splat;
    let int = F::Int::splat;
    let (from, to) = (path(tile, rays, s(near)), path(tile, rays, s(far)));
    let (dc, dr, dz) = (nonzero(to.c - from.c), nonzero(to.r - from.r), to.z - from.z);
    let (inv_c, inv_r) = (s(1.0) / dc, s(1.0) / dr);
    let nudge = s(NUDGE_CELLS) / dc.abs().max(dr.abs()).max(s(NUDGE_CELLS));
    let (base_c, base_r) = (int(tile.base[0]), int(tile.base[1]));
    let mut level = int(START_LEVEL.min(levels.top));
    let mut along = s(0.0);
    let mut hit = F::Mask::from_bits(0);
    let mut hit_at = s(1.0);
    while active.any() {
        let probe = (along + nudge).min(s(1.0));
        let i = clamped_cell::<F>(floor(from.c + probe * dc), tile.base[0], nodes.cols).shr(level);
        let j = clamped_cell::<F>(floor(from.r + probe * dr), tile.base[1], nodes.rows).shr(level);
        let size = F::from_int(int(1).shl(level));
        let (low_c, low_r) = (F::from_int(i.shl(level).sub(base_c)), F::from_int(j.shl(level).sub(base_r)));
        let exit_c = (F::select_lt(s(0.0), dc, low_c + size, low_c) - from.c) * inv_c;
        let exit_r = (F::select_lt(s(0.0), dr, low_r + size, low_r) - from.r) * inv_r;
        let exit = exit_c.min(exit_r).max(probe).min(s(1.0));
        let (z_in, z_out) = (from.z + along * dz, from.z + exit * dz);
        let at_leaf = F::int_eq(level, int(0));
        // Blocks first; lanes at a cell read the block above it and ignore what they read.
        let block_level = level.max(int(1));
        let up = block_level.sub(level);
        let (bi, bj) = (i.shr(up), j.shr(up));
        let idx = block_level.lookup(&levels.offset).add(bj.mul(block_level.lookup(&levels.cols))).add(bi);
        debug_assert!(
            bj.store().iter().zip(block_level.store()).all(|(j, l)| *j < levels.rows[l as usize & 15])
        );
        // SAFETY: column and row were clamped to cells of the layer, so the block of any level that holds them exists.
        let highest = unsafe { F::gather(levels.base, idx) } - s(tile.z_base);
        let above = highest.lt(z_in.min(z_out));
        let mut clear = above;
        let leaf = at_leaf & active;
        if leaf.any() {
            let (root, found) = leaf_root(
                tile,
                nodes,
                &from,
                [dc, dr],
                [i.sub(base_c), j.sub(base_r)],
                [along, exit],
                [z_in, z_out],
            );
            let new = leaf & found;
            hit = hit | new;
            hit_at = F::select(new, root, hit_at);
            active = active & !new;
            clear = (at_leaf & !found) | (!at_leaf & above);
        }
        along = F::select(clear, exit, along);
        let climbed = level.add(int(1)).min(int(levels.top));
        level = F::select_int(clear, climbed, level.sub(int(1)).max(int(0)));
        active = active & along.lt(s(1.0));
    }
    (hit, hit_at)
}

/// The root in a cell between two places of a chord.
#[inline(always)]
fn leaf_root<F: F32x16>(
    tile: &Tile,
    nodes: &Nodes,
    from: &At<F>,
    [dc, dr]: [F; 2],
    [i, j]: [F::Int; 2],
    [near, far]: [F; 2],
    [z_near, z_far]: [F; 2],
) -> (F, F::Mask) {
    let s = F::splat;
    let cell = Cell::new(nodes.cell::<F>(tile.base, tile.z_base, i, j), i, j);
    let g_near = z_near - cell.height(from.c + near * dc, from.r + near * dr);
    let g_far = z_far - cell.height(from.c + far * dc, from.r + far * dr);
    // Along a chord the clearance in a cell is a parabola, `g_near + slope x + bend x²` over `x` in [0, 1].
    let span = far - near;
    let bend = s(0.0) - cell.cross * dc * dr * span * span;
    let slope = g_far - g_near - bend;
    let disc = slope * slope - s(4.0) * bend * g_near;
    let dips = s(0.0).lt(disc) & slope.lt(s(0.0)) & (s(0.0) - slope).lt(s(2.0) * bend);
    let found = g_far.lt(s(0.0)) | g_near.lt(s(0.0)) | dips;
    // The first root, in the form that does not cancel.
    let x = s(2.0) * g_near / (disc.max(s(0.0)).sqrt() - slope).max(s(1e-20));
    (near + x.max(s(0.0)).min(s(1.0)) * span, found)
}
