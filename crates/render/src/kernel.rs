//! The fast path: sixteen rays of a pixel at a time.
//!
//! Ground under a tile that no ray of the tile comes down flatter than has one root per ray, and Newton's iteration finds it;
//! elsewhere the pyramid is traversed. Shadow rays walk the blocks of [`crate::horizon`]. What neither decides goes to
//! the exact tracer, ray by ray.

use crate::Shadows;
use crate::brdf::{Angles, Prepared};
use crate::march::{first_hit, path};
use crate::pattern::{Packet, PixelPattern};
use crate::radiance::{Job, TILE};
use crate::shadow::{ShadowRays, occlusion};
use crate::simd::{Float16, Int16, LANES, Mask16, sum};
use crate::tile::Tile;
use nalgebra::Point2;
use selenograph_geometry::pixel;

/// A root is found when the ray is this near the surface, metres: far below the finest ground sampling.
const ROOT_M: f32 = 2e-3;
/// Newton converges quadratically within a cell; more rounds than this mean that a ray jumps between cells.
const MAX_ROUNDS: usize = 8;

/// A layer's nodes as the lanes address them.
#[derive(Clone, Copy)]
pub(crate) struct Nodes {
    pub(crate) base: *const f32,
    pub(crate) cols: i32,
    pub(crate) rows: i32,
}

/// Sixteen rays in the tile's frame: `offset + τ · direction`.
#[derive(Clone, Copy)]
pub(crate) struct Rays<F> {
    pub(crate) offset: [F; 3],
    pub(crate) direction: [F; 3],
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
    pub(crate) fn ground<F: Float16>(&self, base: [i32; 2], z_base: f32, c: F, r: F) -> Ground<F> {
        let (i, j) = (floor(c), floor(r));
        let cell = Cell::new(self.cell::<F>(base, z_base, i, j), i, j);
        let (fu, fv) = (c - cell.i, r - cell.j);
        let hr = cell.e0 + fu * cell.cross;
        Ground { z: cell.h00 + fu * cell.d0 + fv * hr, hc: cell.d0 + fv * cell.cross, hr }
    }

    /// Corner heights of the cells `(i, j)` counted from node `base`.
    #[inline(always)]
    pub(crate) fn cell<F: Float16>(&self, base: [i32; 2], z_base: f32, i: F::Int, j: F::Int) -> [F; 4] {
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

impl<F: Float16> Cell<F> {
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
pub(crate) fn clamped_cell<F: Float16>(v: F::Int, first: i32, n: i32) -> F::Int {
    v.add(F::Int::splat(first)).max(F::Int::splat(0)).min(F::Int::splat(n - 2))
}

/// A divisor that is not zero.
#[inline(always)]
pub(crate) fn nonzero<F: Float16>(v: F) -> F {
    let least = F::splat(1e-12);
    F::select(v.abs().lt(least), least, v)
}

/// Rounds down; values must fit an `i32`.
#[inline(always)]
pub(crate) fn floor<F: Float16>(v: F) -> F::Int {
    let i = v.truncate();
    F::select_int(v.lt(F::from_int(i)), i.sub(F::Int::splat(1)), i)
}

/// A pixel in the tile's frame.
struct PixelRays<'a> {
    pattern: PixelPattern<'a>,
    /// Normalised image coordinates of the centre, from the tile's reference.
    at: [f32; 2],
    /// Their derivatives with respect to pixel coordinates, times the point spread's sigma.
    per_sigma: [[f32; 2]; 2],
    /// Where the centre's ray meets the ground, from the reference depth: where the search starts.
    tau: f32,
}

/// The radiance of a tile under each Sun into `out` (`suns × TILE × TILE`).
#[inline(always)]
pub(crate) fn radiance_tile<F: Float16>(
    job: &Job<'_>,
    tile: &Tile,
    brdf: &Prepared,
    [x0, y0]: [usize; 2],
    out: &mut [f32],
) {
    let layer = &job.tracer.terrain().layers[tile.layer_idx];
    let nodes =
        Nodes { base: layer.nodes().as_ptr(), cols: layer.grid.cols as i32, rows: layer.grid.rows as i32 };
    for y in y0..(y0 + TILE).min(job.truth.height) {
        for x in x0..(x0 + TILE).min(job.truth.width) {
            let Some(rays) = pixel_rays(job, tile, x, y) else { continue };
            let mut sums = Sums { lanes: [0.0; MAX_SUNS], exact: [0.0; MAX_SUNS] };
            for packet in rays.pattern.packets {
                radiance_packet::<F>(job, tile, &nodes, brdf, &rays, packet, [x, y], &mut sums);
            }
            let albedo = job.pixel_albedo(x, y) as f32;
            for s in 0..job.suns.len() {
                let total = sums.lanes[s] + sums.exact[s] as f32;
                out[(s * TILE + y - y0) * TILE + x - x0] = albedo * total;
            }
        }
    }
}

/// Most Suns of one call: the sums of a pixel live on the stack.
pub(crate) const MAX_SUNS: usize = 8;

struct Sums {
    lanes: [f32; MAX_SUNS],
    exact: [f64; MAX_SUNS],
}

fn pixel_rays<'a>(job: &'a Job<'_>, tile: &Tile, x: usize, y: usize) -> Option<PixelRays<'a>> {
    let camera = &job.view.camera;
    let centre = Point2::new(pixel::center_of(x), pixel::center_of(y));
    let at = camera.ray_z1(&centre)?;
    let sigma = job.settings.psf_sigma_px;
    let per_sigma = if camera.distortion.is_none() {
        [[(sigma / camera.fx) as f32, 0.0], [0.0, (sigma / camera.fy) as f32]]
    } else {
        // Over the few pixels of the point spread the lens is linear to a thousandth of a pixel.
        let step = |dx: f64, dy: f64| camera.ray_z1(&Point2::new(centre.x + dx, centre.y + dy));
        let (along_x, along_y) = (step(0.5, 0.0)? - step(-0.5, 0.0)?, step(0.0, 0.5)? - step(0.0, -0.5)?);
        [
            [(sigma * along_x.x) as f32, (sigma * along_y.x) as f32],
            [(sigma * along_x.y) as f32, (sigma * along_y.y) as f32],
        ]
    };
    let n = y * job.truth.width + x;
    let depth_z = job.truth.depth_z[n];
    let tau = if depth_z.is_finite() { (depth_z - tile.t_ref) as f32 } else { 0.0 };
    Some(PixelRays {
        pattern: job.patterns.of_pixel(n),
        at: [(at.x - tile.reference[0]) as f32, (at.y - tile.reference[1]) as f32],
        per_sigma,
        tau,
    })
}

#[inline(always)]
fn turned<F: Float16>([cos, sin]: [f32; 2], x: &[f32; LANES], y: &[f32; LANES]) -> [F; 2] {
    let (x, y, cos, sin) = (F::load(x), F::load(y), F::splat(cos), F::splat(sin));
    [cos * x - sin * y, sin * x + cos * y]
}

#[inline(always)]
fn splat3<F: Float16>(v: [f32; 3]) -> [F; 3] {
    [F::splat(v[0]), F::splat(v[1]), F::splat(v[2])]
}

#[inline(always)]
pub(crate) fn scale3<F: Float16>(v: [F; 3], by: F) -> [F; 3] {
    [v[0] * by, v[1] * by, v[2] * by]
}

#[inline(always)]
pub(crate) fn add3<F: Float16>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn packet_rays<F: Float16>(tile: &Tile, pixel: &PixelRays<'_>, packet: &Packet) -> Rays<F> {
    let s = F::splat;
    let [ex, ey] = turned::<F>(pixel.pattern.psf_turn, &packet.psf_x, &packet.psf_y);
    let [[xx, xy], [yx, yy]] = pixel.per_sigma;
    let nx = s(pixel.at[0]) + s(xx) * ex + s(xy) * ey;
    let ny = s(pixel.at[1]) + s(yx) * ex + s(yy) * ey;
    let t_ref = s(tile.t_ref as f32);
    let across: [F; 3] = std::array::from_fn(|k| nx * s(tile.axis_x[k]) + ny * s(tile.axis_y[k]));
    Rays { offset: across.map(|v| t_ref * v), direction: std::array::from_fn(|k| s(tile.d0[k]) + across[k]) }
}

/// Newton's iteration from `tau`; lanes of the mask have not converged.
#[inline(always)]
fn newton<F: Float16>(
    tile: &Tile,
    nodes: &Nodes,
    rays: &Rays<F>,
    start: f32,
) -> (F, Ground<F>, [F; 2], F::Mask) {
    let s = F::splat;
    let [d1, d2, dw] = rays.direction;
    let dc = s(tile.jc[0]) * d1 + s(tile.jc[1]) * d2;
    let dr = s(tile.jr[0]) * d1 + s(tile.jr[1]) * d2;
    let mut tau = s(start);
    let mut at = path(tile, rays, tau);
    let mut ground = nodes.ground::<F>(tile.base, tile.z_base, at.c, at.r);
    for _ in 0..MAX_ROUNDS {
        let above = at.z - ground.z;
        if !(s(ROOT_M).lt(above.abs())).any() {
            break;
        }
        let fall = dw + s(tile.inv_r) * (at.a * d1 + at.b * d2) - (ground.hc * dc + ground.hr * dr);
        tau = tau - above / fall;
        at = path(tile, rays, tau);
        ground = nodes.ground::<F>(tile.base, tile.z_base, at.c, at.r);
    }
    let off = s(ROOT_M).lt((at.z - ground.z).abs());
    (tau, ground, [at.c, at.r], off)
}

#[inline(always)]
fn radiance_packet<F: Float16>(
    job: &Job<'_>,
    tile: &Tile,
    nodes: &Nodes,
    brdf: &Prepared,
    pixel: &PixelRays<'_>,
    packet: &Packet,
    xy: [usize; 2],
    sums: &mut Sums,
) {
    let s = F::splat;
    let rays = packet_rays::<F>(tile, pixel, packet);
    let weight = F::load(&packet.weight);
    let used = s(0.0).lt(weight);
    let (tau, ground, [c, r], lost) = if tile.single_root {
        newton(tile, nodes, &rays, pixel.tau)
    } else {
        let (tau, missed) = first_hit(job, tile, nodes, &rays, used);
        let at = path(tile, &rays, tau);
        (tau, nodes.ground::<F>(tile.base, tile.z_base, at.c, at.r), [at.c, at.r], missed)
    };
    let lost = lost & used;
    let found = used & !lost;
    let at = path(tile, &rays, tau);
    // grad(r − h): the vertical leans with the distance from the reference point.
    let n1 = at.a * s(tile.inv_r) - (ground.hc * s(tile.jc[0]) + ground.hr * s(tile.jr[0]));
    let n2 = at.b * s(tile.inv_r) - (ground.hc * s(tile.jc[1]) + ground.hr * s(tile.jr[1]));
    let inv_normal = s(1.0) / (n1 * n1 + n2 * n2 + s(1.0)).sqrt();
    let [d1, d2, dw] = rays.direction;
    let inv_length = s(-1.0) / (d1 * d1 + d2 * d2 + dw * dw).sqrt();
    let eye = [d1 * inv_length, d2 * inv_length, dw * inv_length];
    let mu = (n1 * eye[0] + n2 * eye[1] + eye[2]) * inv_normal;
    let [sun_x, sun_y] = turned::<F>(pixel.pattern.sun_turn, &packet.sun_x, &packet.sun_y);
    for (k, disc) in job.suns.iter().enumerate() {
        let radius = disc.sun.angular_radius_rad;
        let (centre, e1, e2) = (
            tile.local(&disc.sun.direction),
            tile.local(&(disc.e1 * radius)),
            tile.local(&(disc.e2 * radius)),
        );
        let sun = add3(splat3(centre), add3(scale3(splat3(e1), sun_x), scale3(splat3(e2), sun_y)));
        let mu0 = (n1 * sun[0] + n2 * sun[1] + sun[2]) * inv_normal;
        let apart = add3(sun, scale3(eye, s(-1.0)));
        let sin_sq_half_phase = s(0.25) * (apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2]);
        let factor = brdf.radiance_factor(Angles { mu0, mu, sin_sq_half_phase });
        let mut lit = found & s(0.0).lt(factor);
        if job.settings.shadows == Shadows::Cast && lit.any() {
            let start = ShadowRays { c, r, z: ground.z, a: at.a, b: at.b, sun };
            let shade = occlusion(tile, nodes, job.horizons[k][tile.layer_idx].as_ref(), &start, lit);
            lit = lit & !shade.hidden;
            if shade.open.any() {
                let open =
                    Open { lanes: shade.open.bits(), tau: tau.store(), clear_m: shade.clear_m.store() };
                lit = lit & !F::Mask::from_bits(exact_shadows(job, tile, pixel, packet, xy, k, &open));
            }
        }
        sums.lanes[k] += sum(F::select(lit, weight * factor, s(0.0)));
    }
    if lost.any() {
        exact_rays(job, pixel, packet, xy, lost.bits(), sums);
    }
}

/// Where a lane's ray goes through the image, and where on the Sun's disc it looks.
fn lane_ray(
    job: &Job<'_>,
    pixel: &PixelRays<'_>,
    packet: &Packet,
    [x, y]: [usize; 2],
    lane: usize,
) -> (Point2<f64>, [f32; 2]) {
    let sigma = job.settings.psf_sigma_px as f32;
    let [dx, dy] = crate::pattern::turned(
        pixel.pattern.psf_turn,
        sigma * packet.psf_x[lane],
        sigma * packet.psf_y[lane],
    );
    let disc = crate::pattern::turned(pixel.pattern.sun_turn, packet.sun_x[lane], packet.sun_y[lane]);
    (Point2::new(pixel::center_of(x) + f64::from(dx), pixel::center_of(y) + f64::from(dy)), disc)
}

/// Shadow rays that the lanes left undecided.
struct Open {
    lanes: u16,
    /// Depth of each lane's point on the ground, from the tile's reference.
    tau: [f32; LANES],
    /// How far each lane's ray is clear, metres.
    clear_m: [f32; LANES],
}

/// Undecided lanes that are hidden from Sun `k`, by the exact tracer.
#[inline(never)]
fn exact_shadows(
    job: &Job<'_>,
    tile: &Tile,
    pixel: &PixelRays<'_>,
    packet: &Packet,
    xy: [usize; 2],
    k: usize,
    open: &Open,
) -> u16 {
    let mut hidden = 0;
    for lane in (0..LANES).filter(|lane| open.lanes >> lane & 1 == 1) {
        let (at, disc) = lane_ray(job, pixel, packet, xy, lane);
        let t = tile.t_ref + f64::from(open.tau[lane]);
        if job.exact_shadow(&at, t, f64::from(open.clear_m[lane]), &job.suns[k], disc) {
            hidden |= 1 << lane;
        }
    }
    hidden
}

/// Adds lanes whose root the fast path did not find.
#[inline(never)]
fn exact_rays(
    job: &Job<'_>,
    pixel: &PixelRays<'_>,
    packet: &Packet,
    xy: [usize; 2],
    lost: u16,
    sums: &mut Sums,
) {
    for lane in (0..LANES).filter(|lane| lost >> lane & 1 == 1) {
        let (at, disc) = lane_ray(job, pixel, packet, xy, lane);
        job.exact_ray(&at, disc, f64::from(packet.weight[lane]), &mut sums.exact[..job.suns.len()]);
    }
}
