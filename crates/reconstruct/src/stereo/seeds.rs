//! The first surface: a robust plane in inverse depth through the seed matches, and a smooth bend on top.

use super::level::ViewLevel;
use super::solver::Solver;
use super::warp::Motion;
use crate::matching::Match;
use crate::triangulate;
use selenograph_geometry::{CamA, CamB, Camera, Frame, Point2, Rigid3, Vector3, pixel};
use selenograph_raster::Raster;

/// A seed as an inverse z-depth along a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeedPoint {
    /// The ray, `x/z` and `y/z`.
    pub ray: [f64; 2],
    /// Inverse z-depth, in the unit of the motion's translation.
    pub rho: f64,
    /// Pixels that the other view's image moves for a change of `rho` by its own size.
    pub px_per_share: f64,
}

/// Seeds as inverse depths in both views; those that do not meet in front of both cameras are left out.
pub(crate) fn points(
    seeds: &[Match],
    a: &Camera,
    b: &Camera,
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
) -> [Vec<SeedPoint>; 2] {
    let back = cam_b_from_cam_a.inverse();
    let forth = |s: &Match| point(&a.ray_z1(&s.a)?, &b.ray_z1(&s.b)?, cam_b_from_cam_a, b.fx);
    let returned = |s: &Match| point(&b.ray_z1(&s.b)?, &a.ray_z1(&s.a)?, &back, a.fx);
    [seeds.iter().filter_map(forth).collect(), seeds.iter().filter_map(returned).collect()]
}

fn point<To: Frame, From: Frame>(
    ray: &Vector3<f64>,
    seen: &Vector3<f64>,
    to_from: &Rigid3<To, From>,
    focal_px: f64,
) -> Option<SeedPoint> {
    let found = triangulate::along_ray(ray, seen, to_from)?;
    let px_per_share = found.image_per_rho * found.rho * focal_px;
    Some(SeedPoint { ray: [ray.x, ray.y], rho: found.rho, px_per_share })
}

/// `ρ = c0 + c1 x + c2 y` over ray coordinates: a plane in space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane(pub [f64; 3]);

impl Plane {
    /// The inverse z-depth along a ray.
    pub(crate) fn at(&self, ray: [f64; 2]) -> f64 {
        self.0[0] + self.0[1] * ray[0] + self.0[2] * ray[1]
    }

    /// The plane that most seeds lie near: least squares with weights that forget outliers.
    pub(crate) fn through(points: &[SeedPoint]) -> Option<Self> {
        let mut rhos: Vec<f64> = points.iter().map(|p| p.rho).collect();
        rhos.sort_by(f64::total_cmp);
        let median = *rhos.get(rhos.len() / 2)?;
        let mut plane = Self([median, 0.0, 0.0]);
        for step in 0..20 {
            let mut residuals: Vec<f64> = points.iter().map(|p| (p.rho - plane.at(p.ray)).abs()).collect();
            residuals.sort_by(f64::total_cmp);
            let scale = (1.5 * residuals[residuals.len() / 2]).max(1e-6 * median);
            let mut normal = selenograph_geometry::Matrix3::<f64>::identity() * 1e-9;
            let mut right = Vector3::zeros();
            for p in points {
                // The first step starts from a constant and must not take a slope for outliers.
                let share = if step == 0 { 0.0 } else { (p.rho - plane.at(p.ray)) / (2.0 * scale) };
                let weight = 1.0 / (1.0 + share * share).powi(2);
                let basis = Vector3::new(1.0, p.ray[0], p.ray[1]);
                normal += weight * basis * basis.transpose();
                right += weight * basis * p.rho;
            }
            let c = normal.cholesky()?.solve(&right);
            plane = Self([c.x, c.y, c.z]);
        }
        Some(plane)
    }
}

/// Seeds of a view on the pixels of one level.
pub(crate) struct Anchors(Vec<Anchor>);

/// One seed on its pixel.
struct Anchor {
    at: usize,
    /// Bend over the plane, pixels of height of the level.
    value: f32,
    /// Pixels of the full picture that the other view's image moves for a pixel of height of the level.
    gain: f32,
}

/// A seed that misses the surface by this many pixels counts half.
const OUTLIER_PX: f32 = 3.0;

impl Anchors {
    /// Seeds inside the frame. `unit` is the length that makes inverse depths ones.
    pub(crate) fn new(points: &[SeedPoint], plane: &Plane, level: &ViewLevel, unit: f64) -> Self {
        let focal = f64::from(level.camera.fx);
        let camera = &level.camera;
        let anchor = |p: &SeedPoint| {
            let lens = |lens: selenograph_geometry::Distortion| lens.distort(p.ray[0], p.ray[1]);
            let (xd, yd) = camera.lens.map_or((p.ray[0], p.ray[1]), lens);
            let x =
                usize::try_from(pixel::index_of(f64::from(camera.fx) * xd + f64::from(camera.cx))).ok()?;
            let y =
                usize::try_from(pixel::index_of(f64::from(camera.fy) * yd + f64::from(camera.cy))).ok()?;
            let value = ((p.rho - plane.at(p.ray)) * unit * focal) as f32;
            let gain = (p.px_per_share / (p.rho * unit * focal)) as f32;
            (x < level.width && y < level.height).then_some(Anchor { at: y * level.width + x, value, gain })
        };
        Self(points.iter().filter_map(anchor).collect())
    }

    /// Adds the seeds to an equation for the bend `q`, less those that miss it.
    pub(crate) fn add_to(&self, weight: &mut [f32], right: &mut [f32], q: &Raster<f32>, outlier_px: f32) {
        for &Anchor { at, value, gain } in &self.0 {
            let miss = (value - q.data[at]) * gain / outlier_px;
            let w = gain * gain / (1.0 + miss * miss);
            weight[at] += w;
            right[at] += w * value;
        }
    }

    /// [`Self::add_to`] with the usual tolerance.
    pub(crate) fn hold(&self, weight: &mut [f32], right: &mut [f32], q: &Raster<f32>) {
        self.add_to(weight, right, q, OUTLIER_PX);
    }

    /// The bend that the seeds alone make at a level: a thin plate with robust point weights.
    pub(crate) fn bend(&self, level: &ViewLevel, smoothness: f32) -> Raster<f32> {
        const ROUNDS: usize = 6;
        let (width, height) = (level.width, level.height);
        let mut q = Raster::filled(width, height, 0.0f32);
        let mut solver = Solver::new(width, height);
        let stiffness = Raster::filled(width, height, smoothness);
        for round in 0..ROUNDS {
            let mut weight = vec![1e-9f32; width * height];
            let mut right = vec![0.0f32; width * height];
            // The flat start must not take relief for outliers.
            let outlier_px = if round == 0 { f32::INFINITY } else { OUTLIER_PX };
            self.add_to(&mut weight, &mut right, &q, outlier_px);
            solver.solve(&mut q, &weight, &right, &stiffness, 60, 1e-3);
        }
        q
    }
}

/// Seeds from a coarse z-depth of view A (an elevation model seen from there, a plane, an earlier answer), one every `step`
/// pixels: what dense stereo starts from where there are no matches.
///
/// `depth_z` has the size of A's picture, in the unit of the motion's translation; absent samples are NaN.
pub fn seeds_from_depth_z(
    depth_z: &Raster<f32>,
    a: &Camera,
    b: &Camera,
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
    step: usize,
) -> Vec<Match> {
    let step = step.max(1);
    let mut out = Vec::new();
    for y in (step / 2..depth_z.height).step_by(step) {
        for x in (step / 2..depth_z.width).step_by(step) {
            let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let z = f64::from(depth_z[(x, y)]);
            let point = if z > 0.0 && z.is_finite() { a.unproject(&at, z) } else { None };
            if let Some(seen) = point.and_then(|point| b.project(&cam_b_from_cam_a.point(&point))) {
                out.push(Match { a: at, b: seen, score: 1.0 });
            }
        }
    }
    out
}

/// The motion in each direction, each in the unit of the view that it starts from.
pub(crate) fn motions(cam_b_from_cam_a: &Rigid3<CamB, CamA>, units: [f64; 2]) -> [Motion; 2] {
    [Motion::new(cam_b_from_cam_a, units[0]), Motion::new(&cam_b_from_cam_a.inverse(), units[1])]
}
