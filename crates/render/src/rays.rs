//! Sixteen rays of a tile, and where they are on the map.

use crate::simd::F32x16;
use crate::tile::Tile;

/// Sixteen rays in the tile's frame: `offset + τ · direction`.
#[derive(Clone, Copy)]
pub(crate) struct Rays<F> {
    pub(crate) offset: [F; 3],
    pub(crate) direction: [F; 3],
}

#[inline(always)]
pub(crate) fn scale3<F: F32x16>(v: [F; 3], by: F) -> [F; 3] {
    [v[0] * by, v[1] * by, v[2] * by]
}

#[inline(always)]
pub(crate) fn add3<F: F32x16>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Points of sixteen rays.
#[derive(Clone, Copy)]
pub(crate) struct At<F> {
    /// Metres along the tile's tangents.
    pub(crate) a: F,
    pub(crate) b: F,
    /// Grid coordinates from the tile's first node.
    pub(crate) c: F,
    pub(crate) r: F,
    /// Height above the tile's reference height.
    pub(crate) z: F,
}

/// Where rays are on the map at depth `t_ref + tau`: second order in the distance from the reference point.
#[inline(always)]
pub(crate) fn path<F: F32x16>(tile: &Tile, rays: &Rays<F>, tau: F) -> At<F> {
    let s = F::splat;
    let [a, b, w] = add3(rays.offset, scale3(rays.direction, tau));
    let inv_r = s(tile.inv_r);
    // Higher points of a radius share its map coordinates.
    let shrink = s(1.0) - w * inv_r;
    let (sa, sb) = (a * shrink, b * shrink);
    At {
        a,
        b,
        c: s(tile.at0[0]) + s(tile.jc[0]) * sa + s(tile.jc[1]) * sb,
        r: s(tile.at0[1]) + s(tile.jr[0]) * sa + s(tile.jr[1]) * sb,
        z: s(tile.z0) + w + s(0.5) * inv_r * (a * a + b * b),
    }
}
