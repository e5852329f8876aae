//! The fast path: sixteen rays of a pixel at a time.
//!
//! Ground under a tile that no ray of the tile comes down flatter than has one root per ray, and Newton's iteration finds it;
//! elsewhere the pyramid is traversed. Shadow rays walk the blocks of [`crate::horizon`]. What neither decides goes to
//! the exact tracer, ray by ray.

use crate::Shadows;
use crate::brdf::{Angles, Prepared};
use crate::job::{Job, TILE};
use crate::march::first_hit;
use crate::nodes::{Ground, Nodes};
use crate::pattern::{Packet, PixelPattern};
use crate::rays::{Rays, add3, path, scale3};
use crate::shadow::{ShadowRays, occlusion};
use crate::simd::{F32x16, LANES, Mask32x16, sum};
use crate::tile::Tile;
use selenograph_geometry::{Point2, pixel};

/// A root is found when the ray is this near the surface, metres: far below the finest ground sampling.
const ROOT_M: f32 = 2e-3;
/// Newton converges quadratically within a cell; more rounds than this mean that a ray jumps between cells.
const MAX_ROUNDS: usize = 8;

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
pub(crate) fn radiance_tile<F: F32x16>(
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
fn turned<F: F32x16>([cos, sin]: [f32; 2], x: &[f32; LANES], y: &[f32; LANES]) -> [F; 2] {
    let (x, y, cos, sin) = (F::load(x), F::load(y), F::splat(cos), F::splat(sin));
    [cos * x - sin * y, sin * x + cos * y]
}

#[inline(always)]
fn splat3<F: F32x16>(v: [f32; 3]) -> [F; 3] {
    [F::splat(v[0]), F::splat(v[1]), F::splat(v[2])]
}

#[inline(always)]
fn packet_rays<F: F32x16>(tile: &Tile, pixel: &PixelRays<'_>, packet: &Packet) -> Rays<F> {
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
fn newton<F: F32x16>(
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
fn radiance_packet<F: F32x16>(
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
