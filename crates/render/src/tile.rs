//! The setting up of one tile of the picture for the fast path: a local frame, a box of cells, a range along the rays.

use crate::job::{Job, TILE};
use crate::path::Ray;
use crate::pattern::MAX_SIGMAS;
use crate::trace::{grid_gradient, tangents};
use selenograph_geometry::{Point2, Point3, Vector3, pixel};
use selenograph_terrain::{Layer, Terrain};

/// A box with more nodes than this is not scanned for its slopes: the traversal is cheaper.
const MAX_SCANNED_NODES: usize = 1 << 16;

/// How much steeper than the steepest ground a ray has to come down for its root to count as the only one: rounding of
/// the slopes and the bend of the path are far below.
const STEEPNESS_MARGIN: f64 = 0.05;

/// Rays of a tile in a local frame: `(a, b, w)` are metres along two tangents and the vertical at the reference point.
pub(crate) struct Tile {
    /// The layer that carries everything the tile's rays can meet.
    pub(crate) layer_idx: usize,
    /// First node of the box.
    pub(crate) base: [i32; 2],
    /// Cells of the box.
    pub(crate) cells: [i32; 2],
    /// Reference height, metres: heights in the kernels are measured from it.
    pub(crate) z_base: f32,
    /// Normalised image coordinates of the reference ray.
    pub(crate) reference: [f64; 2],
    /// Direction of the reference ray (unit depth) in the local frame.
    pub(crate) d0: [f32; 3],
    /// Camera axes in the local frame.
    pub(crate) axis_x: [f32; 3],
    pub(crate) axis_y: [f32; 3],
    /// Depth of the reference point on the reference ray.
    pub(crate) t_ref: f64,
    /// Grid coordinates of the reference point, from the box's first node.
    pub(crate) at0: [f32; 2],
    /// Its height above `z_base`.
    pub(crate) z0: f32,
    /// Derivatives of column and row along the tangents, cells per metre.
    pub(crate) jc: [f32; 2],
    pub(crate) jr: [f32; 2],
    /// One over the distance from the body's centre, 1/m.
    pub(crate) inv_r: f32,
    /// Depths, from `t_ref`, between which every ray of the tile meets the ground.
    pub(crate) tau: [f32; 2],
    /// Length of a ray between those, metres.
    pub(crate) length_m: f32,
    /// Whether each ray comes down steeper than any ground in the box: its root is the only one.
    pub(crate) single_root: bool,
    /// Local frame in the body-fixed one.
    pub(crate) axes: [Vector3<f64>; 3],
}

/// Bounds of the terrain's heights near some points, over all layers that carry ground there.
fn bounds_near(terrain: &Terrain, points: &[Point3<f64>]) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for layer in &terrain.layers {
        let bounds = grid_box(layer, points)?;
        let [c0, r0, c1, r1] = bounds;
        let (last_c, last_r) = ((layer.grid.cols - 1) as f64, (layer.grid.rows - 1) as f64);
        if c1 < 0.0 || r1 < 0.0 || c0 > last_c || r0 > last_r {
            continue;
        }
        let (lo, hi) = layer.height_bounds(bounds);
        (low, high) = (low.min(f64::from(lo)), high.max(f64::from(hi)));
        if c0 >= 0.0 && r0 >= 0.0 && c1 <= last_c && r1 <= last_r {
            // Coarser layers carry nothing here.
            break;
        }
    }
    (low.is_finite() && high.is_finite()).then_some((low, high))
}

/// Bounding box of a tile's points on a layer's grid, with room for what bulges between them: a sphere's cap over a length s
/// rises by s²/8R, and so does an edge on any map that is smooth here; four times that, and a tenth of a cell.
fn grid_box(layer: &Layer, points: &[Point3<f64>]) -> Option<[f64; 4]> {
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for point in points {
        let [c, r] = layer.grid.grid_from_point(point)?;
        bounds = [bounds[0].min(c), bounds[1].min(r), bounds[2].max(c), bounds[3].max(r)];
    }
    let [c0, r0, c1, r1] = bounds;
    let cells = (c1 - c0).hypot(r1 - r0);
    let room = 0.5 * cells * cells * layer.cell_m / layer.grid.crs.body.radius_m + 0.1;
    Some([c0 - room, r0 - room, c1 + room, r1 + room])
}

impl Tile {
    /// Sets up the tile whose first pixel is `(x0, y0)`; `None` where the fast path does not apply: rays that may miss the
    /// ground, holes, more than one layer.
    pub(crate) fn new(job: &Job<'_>, x0: usize, y0: usize) -> Option<Self> {
        let terrain = job.tracer.terrain();
        let pad = MAX_SIGMAS * job.settings.psf_sigma_px + 0.5;
        let edge = |k: usize, n: usize, limit: usize| {
            [pixel::center_of(k) - pad, pixel::center_of((k + n).min(limit) - 1) + pad]
        };
        let (us, vs) = (edge(x0, TILE, job.truth.width), edge(y0, TILE, job.truth.height));
        let camera = &job.view.camera;
        let middle = camera.ray_z1(&Point2::new(f64::midpoint(us[0], us[1]), f64::midpoint(vs[0], vs[1])))?;
        let mut rays = Vec::with_capacity(4);
        for v in vs {
            for u in us {
                let direction = job.view.world_from_cam.vector(&camera.ray_z1(&Point2::new(u, v))?);
                rays.push(Ray { origin: job.view.origin(), direction });
            }
        }
        let (corners, span) = narrow(terrain, &rays)?;
        let (layer_idx, bounds) = single_layer(terrain, &corners)?;
        Self::in_layer(job, layer_idx, bounds, middle, span, &rays)
    }

    fn in_layer(
        job: &Job<'_>,
        layer_idx: usize,
        [c0, r0, c1, r1]: [f64; 4],
        middle: Vector3<f64>,
        span: [f64; 4],
        rays: &[Ray],
    ) -> Option<Self> {
        let [t_near, t_far, low, high] = span;
        let terrain = job.tracer.terrain();
        let layer = &terrain.layers[layer_idx];
        let direction = job.view.world_from_cam.vector(&middle);
        let reference_ray = Ray { origin: job.view.origin(), direction };
        let (t_ref, _) = reference_ray.sphere(terrain.body.radius_m + f64::midpoint(low, high))?;
        let p0 = reference_ray.at(t_ref);
        let up = p0.coords.normalize();
        let (e1, e2) = tangents(&up);
        let [jc, jr] = grid_gradient(&layer.grid, &p0, &e1, &e2)?;
        let [c, r] = layer.grid.grid_from_point(&p0)?;
        let base = [c0.floor() as i32, r0.floor() as i32];
        let cells = [c1.ceil() as i32 - base[0], r1.ceil() as i32 - base[1]];
        let local = |d: &Vector3<f64>| [d.dot(&e1), d.dot(&e2), d.dot(&up)];
        let axis = |d: Vector3<f64>| local(&job.view.world_from_cam.vector(&d)).map(|v| v as f32);
        let z_base = f64::midpoint(low, high).round();
        let single_root = steepest(layer, base, cells).is_some_and(|[gc, gr]| {
            rays.iter().all(|ray| {
                let [a, b, w] = local(&ray.direction);
                let (dc, dr) = (jc[0] * a + jc[1] * b, jr[0] * a + jr[1] * b);
                let against = (-gc[0] * dc).max(-gc[1] * dc) + (-gr[0] * dr).max(-gr[1] * dr);
                w + against < STEEPNESS_MARGIN * w
            })
        });
        Some(Self {
            layer_idx,
            base,
            cells,
            z_base: z_base as f32,
            reference: [middle.x, middle.y],
            d0: local(&direction).map(|v| v as f32),
            axis_x: axis(Vector3::x()),
            axis_y: axis(Vector3::y()),
            t_ref,
            at0: [(c - f64::from(base[0])) as f32, (r - f64::from(base[1])) as f32],
            z0: (terrain.body.height_m(&p0) - z_base) as f32,
            jc: jc.map(|v| v as f32),
            jr: jr.map(|v| v as f32),
            inv_r: (1.0 / p0.coords.norm()) as f32,
            tau: [(t_near - t_ref) as f32, (t_far - t_ref) as f32],
            length_m: ((t_far - t_near) * direction.norm()) as f32,
            single_root,
            axes: [e1, e2, up],
        })
    }

    /// Components of a body-fixed direction in the local frame.
    pub(crate) fn local(&self, direction: &Vector3<f64>) -> [f32; 3] {
        self.axes.map(|axis| direction.dot(&axis) as f32)
    }
}

/// Where the corner rays cross the spheres between which the ground under the tile lies, found by asking the pyramid again
/// and again over an ever smaller area. Returns the crossing points and `[t_near, t_far, low, high]`.
fn narrow(terrain: &Terrain, rays: &[Ray]) -> Option<(Vec<Point3<f64>>, [f64; 4])> {
    /// A few metres of room for what lies between the corners.
    const ROOM_M: f64 = 2.0;
    const ROUNDS: usize = 6;
    let (mut low, mut high) = terrain.height_range();
    let mut points = Vec::with_capacity(2 * rays.len());
    let mut span = [0.0; 4];
    for round in 0..=ROUNDS {
        points.clear();
        let (mut near, mut far) = (f64::INFINITY, f64::NEG_INFINITY);
        for ray in rays {
            let (enter, _) = ray.sphere(terrain.body.radius_m + high + ROOM_M)?;
            let (leave, _) = ray.sphere(terrain.body.radius_m + low - ROOM_M)?;
            // Somewhere on the terrain there may be ground above the camera.
            let enter = enter.max(0.0);
            points.extend([ray.at(enter), ray.at(leave)]);
            (near, far) = (near.min(enter), far.max(leave));
        }
        span = [near, far, low, high];
        if round < ROUNDS {
            let (lo, hi) = bounds_near(terrain, &points)?;
            (low, high) = (lo.max(low), hi.min(high));
        }
    }
    Some((points, span))
}

/// The one layer that owns all cells near the points, and their box in it.
fn single_layer(terrain: &Terrain, points: &[Point3<f64>]) -> Option<(usize, [f64; 4])> {
    for (idx, layer) in terrain.layers.iter().enumerate() {
        let bounds = grid_box(layer, points)?;
        let [c0, r0, c1, r1] = bounds;
        let (last_c, last_r) = ((layer.grid.cols - 1) as f64, (layer.grid.rows - 1) as f64);
        if c0 >= 0.0 && r0 >= 0.0 && c1 <= last_c && r1 <= last_r {
            // A hole shows as a lower bound of minus infinity.
            return layer.pyramid.bounds(c0, r0, c1, r1).0.is_finite().then_some((idx, bounds));
        }
        if !(c1 < 0.0 || r1 < 0.0 || c0 > last_c || r0 > last_r) {
            return None;
        }
    }
    None
}

/// Smallest and largest step of height along columns and rows in a box, metres per cell.
fn steepest(layer: &Layer, base: [i32; 2], cells: [i32; 2]) -> Option<[[f64; 2]; 2]> {
    let (cols, rows) = (cells[0] as usize + 1, cells[1] as usize + 1);
    if cols * rows > MAX_SCANNED_NODES {
        return None;
    }
    let nodes = layer.nodes();
    let stride = layer.grid.cols;
    let row_at = |j: usize| {
        let start = (base[1] as usize + j) * stride + base[0] as usize;
        &nodes[start..start + cols]
    };
    let (mut along_c, mut along_r) = ([0.0f32; 2], [0.0f32; 2]);
    let widen = |range: &mut [f32; 2], step: f32| *range = [range[0].min(step), range[1].max(step)];
    for j in 0..rows {
        let row = row_at(j);
        for (a, b) in row.iter().zip(&row[1..]) {
            widen(&mut along_c, b - a);
        }
        if j + 1 < rows {
            for (a, b) in row.iter().zip(row_at(j + 1)) {
                widen(&mut along_r, b - a);
            }
        }
    }
    Some([along_c.map(f64::from), along_r.map(f64::from)])
}
