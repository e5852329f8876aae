//! A straight ray as it looks on the map: short pieces, each a parabola in grid coordinates and height.
//!
//! A straight line in space is curved over a sphere and on any map of it. Over a piece of a few kilometres the curve is a
//! parabola to well under a millimetre, which is enough to find the cell; the root itself is polished on the exact path.

use selenograph_geometry::{Point3, Projection, Vector3};
use selenograph_terrain::{Grid, Terrain};

/// A ray in the body-fixed frame: `origin + t · direction`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    /// Start, metres.
    pub origin: Point3<f64>,
    /// Direction of any length; `t` counts in that length.
    pub direction: Vector3<f64>,
}

impl Ray {
    /// The point at `t`.
    #[inline]
    pub fn at(&self, t: f64) -> Point3<f64> {
        self.origin + self.direction * t
    }

    /// Where the ray is inside the sphere of radius `radius_m`: `(enter, leave)`.
    pub fn sphere(&self, radius_m: f64) -> Option<(f64, f64)> {
        let a = self.direction.norm_squared();
        let half_b = self.origin.coords.dot(&self.direction);
        // The closest approach first: |o|² − r² directly would lose a millimetre to cancellation.
        let t_closest = -half_b / a;
        let closest = self.at(t_closest).coords.norm();
        if closest > radius_m {
            return None;
        }
        let half = ((radius_m - closest) * (radius_m + closest) / a).sqrt();
        Some((t_closest - half, t_closest + half))
    }
}

/// A piece of a ray between `t0` and `t1` as parabolas in `s ∈ [0, 1]`: column, row and height are
/// `k[0] + k[1] s + k[2] s²`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// Ray parameter at `s = 0`.
    pub t0: f64,
    /// Ray parameter at `s = 1`.
    pub t1: f64,
    /// Column.
    pub c: [f64; 3],
    /// Row.
    pub r: [f64; 3],
    /// Height above the sphere, metres.
    pub h: [f64; 3],
}

/// Evaluates a parabola.
#[inline]
pub fn eval(k: &[f64; 3], s: f64) -> f64 {
    k[0] + s * (k[1] + s * k[2])
}

/// The parabola through values at `s = 0, ½, 1`.
fn parabola(start: f64, middle: f64, end: f64) -> [f64; 3] {
    let second = 2.0 * (start - 2.0 * middle + end);
    [start, end - start - second, second]
}

/// Three places of a ray on one map: at both ends and in the middle of a piece.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnMap {
    map: [[f64; 2]; 3],
    height_m: [f64; 3],
    t0: f64,
    t1: f64,
}

impl OnMap {
    /// Between two ray parameters; `None` where the projection does not reach.
    pub fn new(projection: &Projection, radius_m: f64, ray: &Ray, t0: f64, t1: f64) -> Option<Self> {
        let (mut map, mut height_m) = ([[0.0; 2]; 3], [0.0; 3]);
        for (k, t) in [t0, f64::midpoint(t0, t1), t1].into_iter().enumerate() {
            let p = ray.at(t);
            map[k] = projection.map_from_point(&p)?;
            height_m[k] = p.coords.norm() - radius_m;
        }
        Some(Self { map, height_m, t0, t1 })
    }

    /// The parabolic piece on a grid of this map.
    pub fn piece(&self, grid: &Grid) -> Piece {
        let [a, m, b] = self.map.map(|[x, y]| grid.grid_from_map().apply(x, y));
        let [ha, hm, hb] = self.height_m;
        Piece {
            t0: self.t0,
            t1: self.t1,
            c: parabola(a[0], m[0], b[0]),
            r: parabola(a[1], m[1], b[1]),
            h: parabola(ha, hm, hb),
        }
    }
}

/// Longest piece when the hit is wanted: its parabola is off by less than 0.1 mm (third order, `s³/R²`).
pub(crate) const MAX_PIECE_M: f64 = 3000.0;

/// Longest piece when only a shadow is wanted: off by less than 5 mm.
pub(crate) const MAX_SHADOW_PIECE_M: f64 = 12_000.0;

/// How far a parabola may be off the true path before the piece is cut in half, cells.
const PIECE_TOLERANCE_CELLS: f64 = 1e-3;

/// Whether a piece follows the exact path a quarter of the way in. Only cylindrical maps next to a pole and orthographic ones
/// next to their limb need asking: a polar map is smooth wherever it is used.
pub(crate) fn is_faithful(grid: &Grid, ray: &Ray, piece: &Piece) -> bool {
    if matches!(grid.crs.projection, Projection::PolarStereographic { .. }) {
        return true;
    }
    let t = piece.t0 + 0.25 * (piece.t1 - piece.t0);
    grid.grid_from_point(&ray.at(t)).is_some_and(|[c, r]| {
        (c - eval(&piece.c, 0.25)).abs() + (r - eval(&piece.r, 0.25)).abs() < PIECE_TOLERANCE_CELLS
    })
}

impl Piece {
    /// Ray parameter at `s`.
    #[inline]
    pub fn t(&self, s: f64) -> f64 {
        self.t0 + s * (self.t1 - self.t0)
    }

    /// Whether the whole piece lies on the node rectangle, one cell from its border at least.
    pub fn inside(&self, grid: &Grid) -> bool {
        let ok = |k: &[f64; 3], n: usize| {
            let (lo, hi) = range(k);
            lo > 1.0 && hi < (n - 2) as f64
        };
        ok(&self.c, grid.cols) && ok(&self.r, grid.rows)
    }

    /// Whether no part of the piece touches the node rectangle.
    pub fn outside(&self, grid: &Grid) -> bool {
        let out = |k: &[f64; 3], n: usize| {
            let (lo, hi) = range(k);
            hi < 0.0 || lo > (n - 1) as f64
        };
        out(&self.c, grid.cols) || out(&self.r, grid.rows)
    }

    /// Where the piece crosses the border lines of the node rectangle.
    pub(crate) fn border_crossings(&self, grid: &Grid, out: &mut Vec<f64>) {
        for (k, n) in [(&self.c, grid.cols), (&self.r, grid.rows)] {
            for line in [0.0, (n - 1) as f64] {
                out.extend(crossings(k, line).into_iter().flatten().filter(|s| (0.0..1.0).contains(s)));
            }
        }
    }
}

/// Smallest and largest value of a parabola over `[0, 1]`.
pub fn range(k: &[f64; 3]) -> (f64, f64) {
    let (a, b) = (k[0], k[0] + k[1] + k[2]);
    let (mut lo, mut hi) = (a.min(b), a.max(b));
    if let Some(turn) = turning_point(k) {
        let v = eval(k, turn);
        (lo, hi) = (lo.min(v), hi.max(v));
    }
    (lo, hi)
}

/// Where a parabola turns inside (0, 1).
pub(crate) fn turning_point(k: &[f64; 3]) -> Option<f64> {
    let turn = -k[1] / (2.0 * k[2]);
    (turn > 0.0 && turn < 1.0).then_some(turn)
}

/// Both solutions of `k(s) = value`, the numerically stable way.
pub(crate) fn crossings(k: &[f64; 3], value: f64) -> [Option<f64>; 2] {
    let c = k[0] - value;
    let disc = k[1] * k[1] - 4.0 * k[2] * c;
    if disc < 0.0 {
        return [None, None];
    }
    let q = -0.5 * (k[1] + disc.sqrt().copysign(k[1]));
    let near = if q == 0.0 { None } else { Some(c / q) };
    let far = if k[2] == 0.0 { None } else { Some(q / k[2]) };
    [near, far]
}

/// The shell between the lowest and highest terrain that a ray has to be followed through: from entering the outer sphere
/// to reaching the inner one or leaving the outer one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ShellSpan {
    /// First ray parameter.
    pub t0: f64,
    /// Last ray parameter.
    pub t1: f64,
    /// Whether the span ends below the lowest terrain.
    pub reaches_bottom: bool,
}

/// Clips a ray to the terrain's shell, starting no earlier than `t_min` and ending no later than `t_max`.
pub(crate) fn shell_span(terrain: &Terrain, ray: &Ray, t_min: f64, t_max: f64) -> Option<ShellSpan> {
    /// Keeps rounding from cutting off a summit.
    const MARGIN_M: f64 = 0.01;
    let (lowest, highest) = terrain.height_range();
    let (enter, leave) = ray.sphere(terrain.body.radius_m + highest + MARGIN_M)?;
    let t0 = enter.max(t_min);
    let (mut t1, mut reaches_bottom) = (leave.min(t_max), false);
    if let Some((bottom, _)) = ray.sphere(terrain.body.radius_m + lowest - MARGIN_M)
        && (t0..=t1).contains(&bottom)
    {
        (t1, reaches_bottom) = (bottom, true);
    }
    (t0 < t1).then_some(ShellSpan { t0, t1, reaches_bottom })
}
