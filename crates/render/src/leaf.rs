//! A piece of a ray against the surface inside one cell.

use crate::path::{Piece, eval};
use selenograph_terrain::{Layer, Patch};

/// What a piece of a ray meets in a cell.
pub(crate) enum Leaf {
    /// It stays above.
    Clear,
    /// It goes from above (`lo`) to below (`hi`).
    Root { lo: f64, hi: f64 },
    /// It was below before it came in: it passed through a hole.
    Absent,
}

/// Whether the first hit is wanted, or only whether there is one beyond the start.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Query {
    First,
    /// The ray starts on the surface; a hit must go deeper than the rounding of its start.
    Occlusion,
}

/// How a ray comes into a cell.
#[derive(Clone, Copy)]
pub(crate) struct Entry {
    pub(crate) query: Query,
    /// Over the rim of another layer, where the two surfaces meet in the rim's nodes only.
    pub(crate) over_seam: bool,
}

/// A ray that enters a cell further below its surface than rounding came through a hole.
const CRACK_M: f64 = 1e-3;

/// Between the nodes of a rim a coarse surface may bend where the finer one is straight: a wall of a few metres at most
/// (2.8 m between the 40 m and 1600 m maps of the lunar south pole). A ray that enters below it has hit that wall.
const RIM_WALL_M: f64 = 20.0;

/// A shadow ray starts on the surface to this much (rounding of a body-fixed coordinate is 2e-10 m, a polished root 1e-9).
const START_M: f64 = 1e-6;

/// Below this height between samples the true minimum is looked for, metres.
const NEAR_MISS_M: f64 = 1e-2;

/// The bilinear cell `(i, j)`.
pub(crate) fn leaf_bilinear(
    patch: &Patch,
    i: usize,
    j: usize,
    piece: &Piece,
    s0: f64,
    s1: f64,
    entry: Entry,
) -> Leaf {
    let clearance = |s: f64| {
        let (u, v) = (eval(&piece.c, s) - i as f64, eval(&piece.r, s) - j as f64);
        eval(&piece.h, s) - patch.eval(u, v).0
    };
    crossing(&clearance, s0, s1, entry)
}

/// The C¹ surface over a cell: its patches change at half cells, so the piece is looked at in four parts.
pub(crate) fn leaf_smooth(layer: &Layer, piece: &Piece, s0: f64, s1: f64, entry: Entry) -> Leaf {
    const PARTS: usize = 4;
    let height = |s: f64| layer.quadratic_b_spline([eval(&piece.c, s), eval(&piece.r, s)]);
    if height(s0).is_none() || height(s1).is_none() {
        return Leaf::Clear;
    }
    let clearance = |s: f64| height(s).map_or(f64::INFINITY, |(h, ..)| eval(&piece.h, s) - h);
    for part in 0..PARTS {
        let at = |k: usize| s0 + (s1 - s0) * k as f64 / PARTS as f64;
        match crossing(&clearance, at(part), at(part + 1), entry) {
            Leaf::Clear => {}
            found => return found,
        }
    }
    Leaf::Clear
}

/// The first descent of `clearance` through zero in `[s0, s1]`.
fn crossing(clearance: &impl Fn(f64) -> f64, s0: f64, s1: f64, entry: Entry) -> Leaf {
    let tolerance = match entry.query {
        Query::First => 0.0,
        Query::Occlusion => -START_M,
    };
    let (g0, g1) = (clearance(s0), clearance(s1));
    if g0 < tolerance {
        let wall = if entry.over_seam { RIM_WALL_M } else { CRACK_M };
        return if g0 > -wall { Leaf::Root { lo: s0, hi: s0 } } else { Leaf::Absent };
    }
    let middle = f64::midpoint(s0, s1);
    let gm = clearance(middle);
    if gm < tolerance {
        return Leaf::Root { lo: s0, hi: middle };
    }
    if g1 < tolerance {
        // The lowest point may still lie before the middle.
        if let Some(dip) = dip(clearance, s0, middle, tolerance) {
            return Leaf::Root { lo: s0, hi: dip };
        }
        return Leaf::Root { lo: middle, hi: s1 };
    }
    match dip(clearance, s0, s1, tolerance) {
        Some(dip) => Leaf::Root { lo: s0, hi: dip },
        None => Leaf::Clear,
    }
}

/// A point below `tolerance` between two points above it, if the curve bends that low.
fn dip(clearance: &impl Fn(f64) -> f64, s0: f64, s1: f64, tolerance: f64) -> Option<f64> {
    let (mut a, mut b) = (s0, s1);
    for round in 0..6 {
        let middle = f64::midpoint(a, b);
        let (ga, gm, gb) = (clearance(a), clearance(middle), clearance(b));
        let curvature = ga - 2.0 * gm + gb;
        if curvature <= 0.0 {
            return None;
        }
        let lowest = middle + 0.25 * (b - a) * (ga - gb) / curvature;
        if lowest <= a || lowest >= b {
            return None;
        }
        let g = clearance(lowest);
        if g < tolerance {
            return Some(lowest);
        }
        // The curve in a cell is a parabola but for the path's own bend, so the first estimate is nearly exact.
        if g > NEAR_MISS_M && round == 0 {
            return None;
        }
        let half = 0.1 * (b - a);
        (a, b) = ((lowest - half).max(a), (lowest + half).min(b));
    }
    None
}
