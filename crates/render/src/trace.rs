//! Exact rays: the first point of a ray on the terrain, in f64.
//!
//! The traversal descends the max pyramid along the parabolic pieces of [`crate::path`]; it only picks the cell. The root is
//! then polished on the exact path, `|o + t d| = R + h(grid(o + t d))`, so the result carries no error of the
//! traversal: about 1e-9 m, the rounding of `|p| − R`.

use crate::leaf::{Entry, Leaf, Query, leaf_bilinear, leaf_smooth};
use crate::path::{self, OnMap, Piece, Ray, eval, shell_span};
use selenograph_geometry::{Point3, Projection, UnitVector3, Vector3};
use selenograph_terrain::{Grid, Layer, Terrain};
use serde::{Deserialize, Serialize};

/// The surface between the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Continuous, through the nodes; normals jump at cell edges.
    #[default]
    Bilinear,
    /// C¹ biquadratic B-spline with the nodes as control points: smooth normals, heights smoothed by (1, 6, 1)/8.
    QuadraticBSpline,
}

/// What a ray meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hit {
    /// The terrain.
    Surface(SurfaceHit),
    /// Nothing: it leaves upwards.
    Sky,
    /// A place where the terrain has no height (a hole, or outside every layer).
    Absent,
}

/// A point on the terrain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceHit {
    /// Ray parameter.
    pub t: f64,
    /// Body-fixed point, metres.
    pub point: Point3<f64>,
    /// Layer that carries it.
    pub layer_idx: usize,
    /// Grid coordinates there.
    pub at: [f64; 2],
}

/// The local surface at a hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalSurface {
    /// Outward normal in the body-fixed frame.
    pub normal: UnitVector3<f64>,
    /// Angle between the normal and the local vertical, radians.
    pub slope_rad: f64,
    /// Height above the sphere, metres.
    pub height_m: f64,
    /// Effective cell size, metres.
    pub cell_m: f64,
}

/// A layer with its slices at hand.
pub(crate) struct LayerView<'a> {
    pub(crate) layer: &'a Layer,
    pub(crate) max: &'a [f32],
}

impl LayerView<'_> {
    #[inline]
    fn block_max(&self, level: usize, i: usize, j: usize) -> f64 {
        let shape = &self.layer.pyramid.shape;
        f64::from(self.max[shape.max_offset[level] + j * shape.cols[level] + i])
    }

    /// Max over a block and its neighbours: the C¹ surface reads one node beyond its cell.
    fn block_max_dilated(&self, level: usize, i: usize, j: usize) -> f64 {
        let shape = &self.layer.pyramid.shape;
        let (i0, i1) = (i.saturating_sub(1), (i + 1).min(shape.cols[level] - 1));
        let (j0, j1) = (j.saturating_sub(1), (j + 1).min(shape.rows[level] - 1));
        let mut high = f64::NEG_INFINITY;
        for j in j0..=j1 {
            for i in i0..=i1 {
                high = high.max(self.block_max(level, i, j));
            }
        }
        high
    }
}

/// Casts rays against a terrain.
pub struct Tracer<'a> {
    terrain: &'a Terrain,
    interpolation: Interpolation,
    pub(crate) layers: Vec<LayerView<'a>>,
}

enum PieceHit {
    None,
    At { t: f64, layer_idx: usize },
    Absent,
}

impl<'a> Tracer<'a> {
    /// A tracer over a terrain.
    pub fn new(terrain: &'a Terrain, interpolation: Interpolation) -> Self {
        let layers = terrain
            .layers
            .iter()
            .map(|layer| LayerView { layer, max: (*layer.pyramid.max).as_ref() })
            .collect();
        Self { terrain, interpolation, layers }
    }

    /// The terrain.
    pub fn terrain(&self) -> &'a Terrain {
        self.terrain
    }

    /// The surface between the nodes.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// The first point of `origin + t · direction` on the terrain with `t_min ≤ t ≤ t_max`.
    pub fn first_hit(&self, origin: Point3<f64>, direction: Vector3<f64>, t_min: f64, t_max: f64) -> Hit {
        let ray = Ray { origin, direction };
        let Some(span) = shell_span(self.terrain, &ray, t_min, t_max) else { return Hit::Sky };
        match self.along(&ray, span.t0, span.t1, Query::First) {
            PieceHit::At { t, layer_idx } => self.surface_hit(&ray, t, layer_idx),
            PieceHit::Absent => Hit::Absent,
            PieceHit::None if span.reaches_bottom => Hit::Absent,
            PieceHit::None => Hit::Sky,
        }
    }

    /// Whether the terrain hides `direction` from a point on the surface.
    pub fn occluded(&self, point_on_surface: Point3<f64>, direction: Vector3<f64>) -> bool {
        self.occluded_between(point_on_surface, direction, 0.0, f64::INFINITY)
    }

    /// Whether the terrain stands in the way between `t_min` and `t_max` along a direction from a point on the surface.
    pub(crate) fn occluded_between(
        &self,
        point_on_surface: Point3<f64>,
        direction: Vector3<f64>,
        t_min: f64,
        t_max: f64,
    ) -> bool {
        let ray = Ray { origin: point_on_surface, direction };
        let Some(span) = shell_span(self.terrain, &ray, t_min, t_max) else { return false };
        span.reaches_bottom || !matches!(self.along(&ray, span.t0, span.t1, Query::Occlusion), PieceHit::None)
    }

    fn surface_hit(&self, ray: &Ray, t: f64, layer_idx: usize) -> Hit {
        let point = ray.at(t);
        match self.layers[layer_idx].layer.grid.grid_from_point(&point) {
            Some(at) => Hit::Surface(SurfaceHit { t, point, layer_idx, at }),
            None => Hit::Absent,
        }
    }

    /// Normal, slope, height and cell size at a hit. `None` where the surface is absent (cannot happen for a hit that
    /// this tracer returned).
    pub fn local_surface(&self, hit: &SurfaceHit) -> Option<LocalSurface> {
        let layer = self.layers[hit.layer_idx].layer;
        let (height_m, hc, hr) = height_on(layer, self.interpolation, hit.at)?;
        let up = hit.point.coords.normalize();
        let (e1, e2) = tangents(&up);
        let [dc, dr] = grid_gradient(&layer.grid, &hit.point, &e1, &e2)?;
        // grad(r − h) = up − (∂h/∂c ∇c + ∂h/∂r ∇r): the tilt of the local vertical and the map's scale are in it.
        let g1 = hc * dc[0] + hr * dr[0];
        let g2 = hc * dc[1] + hr * dr[1];
        let normal = UnitVector3::new_normalize(up - e1 * g1 - e2 * g2);
        let cell_m = layer.effective_cell_m(hit.at);
        Some(LocalSurface { normal, slope_rad: g1.hypot(g2).atan(), height_m, cell_m })
    }

    fn along(&self, ray: &Ray, t0: f64, t1: f64, query: Query) -> PieceHit {
        /// Shortest piece, metres: a map that is not smooth at this length has a seam there.
        const MIN_PIECE_M: f64 = 1.0;
        let speed = ray.direction.norm();
        let longest = match query {
            Query::First => path::MAX_PIECE_M,
            Query::Occlusion => path::MAX_SHADOW_PIECE_M,
        };
        let mut length = longest / speed;
        let mut from = t0;
        while from < t1 {
            let to = if from + 1.5 * length > t1 { t1 } else { from + length };
            let candidates = self.candidates(ray, from, to);
            let rough = candidates
                .iter()
                .any(|(idx, piece)| !path::is_faithful(&self.layers[*idx].layer.grid, ray, piece));
            if rough && (to - from) * speed > MIN_PIECE_M {
                length = (to - from) / 2.0;
                continue;
            }
            match self.through(ray, &candidates, query) {
                PieceHit::None => from = to,
                hit => return hit,
            }
        }
        PieceHit::None
    }

    /// The layers that a piece touches, finest first, ending with the first one that holds all of it.
    fn candidates(&self, ray: &Ray, t0: f64, t1: f64) -> Vec<(usize, Piece)> {
        let mut found = Vec::with_capacity(self.layers.len());
        // Nested layers mostly share one map: the ray is projected once for all of them.
        let mut last: Option<(&Projection, Option<OnMap>)> = None;
        for (idx, view) in self.layers.iter().enumerate() {
            let grid = &view.layer.grid;
            let projection = &grid.crs.projection;
            let on_map = match last {
                Some((known, on_map)) if known == projection => on_map,
                _ => OnMap::new(projection, self.terrain.body.radius_m, ray, t0, t1),
            };
            last = Some((projection, on_map));
            let Some(piece) = on_map.map(|on_map| on_map.piece(grid)) else { continue };
            if piece.outside(grid) {
                continue;
            }
            found.push((idx, piece));
            if piece.inside(grid) {
                break;
            }
        }
        found
    }

    /// Traces one piece through the layers that own its parts.
    fn through(&self, ray: &Ray, candidates: &[(usize, Piece)], query: Query) -> PieceHit {
        if let [(idx, piece)] = candidates
            && piece.inside(&self.layers[*idx].layer.grid)
        {
            return self.span(ray, *idx, piece, 0.0, 1.0, query, None);
        }
        let mut cuts = vec![0.0, 1.0];
        for (idx, piece) in candidates {
            piece.border_crossings(&self.layers[*idx].layer.grid, &mut cuts);
        }
        cuts.sort_by(f64::total_cmp);
        let mut seam = None;
        for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
            let middle = f64::midpoint(pair[0], pair[1]);
            let owner = candidates.iter().find(|(idx, piece)| {
                let at = [eval(&piece.c, middle), eval(&piece.r, middle)];
                self.layers[*idx].layer.grid.contains(at)
            });
            let Some((idx, piece)) = owner else {
                seam = None;
                continue;
            };
            match self.span(ray, *idx, piece, pair[0], pair[1], query, seam) {
                PieceHit::None => seam = Some(pair[1]),
                hit => return hit,
            }
        }
        PieceHit::None
    }

    /// Traces `[s0, s1]` of a piece in one layer, cut where column or row turn back. `seam`: the place, if any, where the
    /// ray comes in over the rim of another layer.
    fn span(
        &self,
        ray: &Ray,
        idx: usize,
        piece: &Piece,
        s0: f64,
        s1: f64,
        query: Query,
        seam: Option<f64>,
    ) -> PieceHit {
        let view = &self.layers[idx];
        let walk = Walk { view, piece, interpolation: self.interpolation, query, seam };
        let mut from = s0;
        let mut turns = [path::turning_point(&piece.c), path::turning_point(&piece.r)];
        turns.sort_by(|a, b| a.unwrap_or(2.0).total_cmp(&b.unwrap_or(2.0)));
        for turn in turns.into_iter().flatten().chain([s1]) {
            if turn <= from || turn > s1 {
                continue;
            }
            match walk.root_node(from, turn) {
                Leaf::Clear => from = turn,
                Leaf::Absent => return PieceHit::Absent,
                Leaf::Root { lo, hi } => {
                    let t = match query {
                        Query::Occlusion => piece.t(lo),
                        Query::First => self.polish(ray, idx, piece, lo, hi),
                    };
                    return PieceHit::At { t, layer_idx: idx };
                }
            }
        }
        PieceHit::None
    }

    /// Height of a point on a ray above the surface of one layer, metres; borders are extended.
    fn clearance(&self, ray: &Ray, idx: usize, t: f64) -> Option<f64> {
        let layer = self.layers[idx].layer;
        let point = ray.at(t);
        let [c, r] = layer.grid.grid_from_point(&point)?;
        let at = [c.clamp(0.0, (layer.grid.cols - 1) as f64), r.clamp(0.0, (layer.grid.rows - 1) as f64)];
        Some(point.coords.norm() - self.terrain.body.radius_m - height_on(layer, self.interpolation, at)?.0)
    }

    /// The root of the exact path between `lo` (above) and `hi` (below) of a piece.
    fn polish(&self, ray: &Ray, idx: usize, piece: &Piece, lo: f64, hi: f64) -> f64 {
        /// Rounding of `|p| − R` at a planet's radius, metres: nothing smaller means anything.
        const ROUNDING_M: f64 = 1e-9;
        let (mut above, mut below) = (piece.t(lo), piece.t(hi));
        let (Some(mut f_above), Some(mut f_below)) =
            (self.clearance(ray, idx, above), self.clearance(ray, idx, below))
        else {
            return below;
        };
        // A root within rounding of the bracket's end may have the wrong sign there.
        if f_above <= 0.0 {
            return above;
        }
        if f_below >= 0.0 {
            return below;
        }
        // Regula falsi, Illinois form: superlinear and never leaves the bracket.
        let mut kept = 0;
        for _ in 0..100 {
            let t = (above * f_below - below * f_above) / (f_below - f_above);
            let Some(f) = self.clearance(ray, idx, t) else { return below };
            if f.abs() < ROUNDING_M {
                return t;
            }
            if f > 0.0 {
                (above, f_above) = (t, f);
                if kept == 1 {
                    f_below *= 0.5;
                }
                kept = 1;
            } else {
                (below, f_below) = (t, f);
                if kept == -1 {
                    f_above *= 0.5;
                }
                kept = -1;
            }
        }
        below
    }
}

/// Height and derivatives per cell of a layer's surface.
#[inline]
pub(crate) fn height_on(
    layer: &Layer,
    interpolation: Interpolation,
    at: [f64; 2],
) -> Option<(f64, f64, f64)> {
    match interpolation {
        Interpolation::Bilinear => layer.bilinear(at),
        Interpolation::QuadraticBSpline => layer.quadratic_b_spline(at),
    }
}

/// Two unit vectors that make a right-handed triple with `up`.
pub(crate) fn tangents(up: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = if up.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let e1 = helper.cross(up).normalize();
    (e1, up.cross(&e1))
}

/// Derivatives of column and row along two tangents, cells per metre: `[[∂c/∂e1, ∂c/∂e2], [∂r/∂e1, ∂r/∂e2]]`.
pub(crate) fn grid_gradient(
    grid: &Grid,
    point: &Point3<f64>,
    e1: &Vector3<f64>,
    e2: &Vector3<f64>,
) -> Option<[[f64; 2]; 2]> {
    /// Long enough that rounding (1e-9 m) does not show, short enough that curvature (s²/R²) does not either.
    const STEP_M: f64 = 1.0;
    let along = |e: &Vector3<f64>| {
        let a = grid.grid_from_point(&(point + e * STEP_M))?;
        let b = grid.grid_from_point(&(point - e * STEP_M))?;
        Some([(a[0] - b[0]) / (2.0 * STEP_M), (a[1] - b[1]) / (2.0 * STEP_M)])
    };
    let (d1, d2) = (along(e1)?, along(e2)?);
    Some([[d1[0], d2[0]], [d1[1], d2[1]]])
}

/// The descent of one piece through one layer's pyramid.
struct Walk<'a> {
    view: &'a LayerView<'a>,
    piece: &'a Piece,
    interpolation: Interpolation,
    query: Query,
    seam: Option<f64>,
}

impl Walk<'_> {
    /// Starts at the smallest block that holds both ends.
    fn root_node(&self, s0: f64, s1: f64) -> Leaf {
        let layer = self.view.layer;
        let at = |s: f64| layer.cell_of([eval(&self.piece.c, s), eval(&self.piece.r, s)]);
        let ((i0, j0), (i1, j1)) = (at(s0), at(s1));
        let differ = (i0 ^ i1) | (j0 ^ j1);
        let level = (usize::BITS - differ.leading_zeros()) as usize;
        self.node(level, i0 >> level, j0 >> level, s0, s1)
    }

    fn node(&self, level: usize, i: usize, j: usize, s0: f64, s1: f64) -> Leaf {
        if level == 0 {
            return self.leaf(i, j, s0, s1);
        }
        let h = &self.piece.h;
        // A parabola stays within k₂ Δs²/4 of its chord.
        let lowest = eval(h, s0).min(eval(h, s1)) - 0.25 * h[2].abs() * (s1 - s0) * (s1 - s0);
        let highest = match self.interpolation {
            Interpolation::Bilinear => self.view.block_max(level, i, j),
            Interpolation::QuadraticBSpline => self.view.block_max_dilated(level, i, j),
        };
        if lowest > highest {
            return Leaf::Clear;
        }
        let child = level - 1;
        let shape = &self.view.layer.pyramid.shape;
        let middle_c = ((2 * i + 1) << child) as f64;
        let middle_r = ((2 * j + 1) << child) as f64;
        let cut = |k: &[f64; 3], line: f64| {
            path::crossings(k, line).into_iter().flatten().find(|s| *s > s0 && *s < s1).unwrap_or(s1)
        };
        let (a, b) = (cut(&self.piece.c, middle_c), cut(&self.piece.r, middle_r));
        let mut from = s0;
        for to in [a.min(b), a.max(b), s1] {
            if to <= from {
                continue;
            }
            let s = f64::midpoint(from, to);
            let ci = (2 * i + usize::from(eval(&self.piece.c, s) >= middle_c)).min(shape.cols[child] - 1);
            let cj = (2 * j + usize::from(eval(&self.piece.r, s) >= middle_r)).min(shape.rows[child] - 1);
            match self.node(child, ci, cj, from, to) {
                Leaf::Clear => from = to,
                found => return found,
            }
        }
        Leaf::Clear
    }

    fn leaf(&self, i: usize, j: usize, s0: f64, s1: f64) -> Leaf {
        let entry = Entry { query: self.query, over_seam: self.seam == Some(s0) };
        match self.interpolation {
            Interpolation::Bilinear => {
                let patch = self.view.layer.patch(i, j);
                patch.map_or(Leaf::Clear, |p| leaf_bilinear(&p, i, j, self.piece, s0, s1, entry))
            }
            Interpolation::QuadraticBSpline => leaf_smooth(self.view.layer, self.piece, s0, s1, entry),
        }
    }
}
