//! Coarse to fine: both surfaces side by side, each seeing what the other hides.

use super::level::{self, ViewLevel};
use super::options::StereoOptions;
use super::seeds::{self, Anchors, Plane, SeedPoint};
use super::solver::Solver;
use super::term::{self, Term};
use super::warp::{self, Motion};
use crate::View;
use crate::field::filter;
use rayon::prelude::*;
use selenograph_geometry::{CamA, CamB, Rigid3, pixel};
use selenograph_raster::Raster;

/// One view's surface on its way from coarse to fine.
pub(crate) struct Surface {
    pub pyramid: Vec<ViewLevel>,
    pub motion: Motion,
    /// Length that makes inverse depths about 1.
    pub unit: f64,
    plane: Plane,
    seeds: Vec<SeedPoint>,
    /// Bend over the plane, pixels of height of the present level.
    pub bend: Raster<f32>,
    /// Inverse depth at the present level, in `1 / unit`.
    pub rho: Raster<f32>,
    /// 1 where the other view sees the point, else 0.
    pub visible: Raster<f32>,
}

/// Both views.
pub(crate) struct Estimate {
    pub surfaces: [Surface; 2],
}

impl Estimate {
    /// Plane and bend from the seeds, at the coarsest level.
    pub(crate) fn start(
        a: &View,
        b: &View,
        cam_b_from_cam_a: &Rigid3<CamB, CamA>,
        points: &[Vec<SeedPoint>; 2],
        options: &StereoOptions,
    ) -> Option<Self> {
        let side = [a, b].map(|v| v.image.width.min(v.image.height)).into_iter().min()?;
        let mut num_levels = 1;
        while side >> num_levels >= options.coarsest_px {
            num_levels += 1;
        }
        let planes = [Plane::through(&points[0])?, Plane::through(&points[1])?];
        let units = [0, 1].map(|i| {
            let mut rhos: Vec<f64> = points[i].iter().map(|p| p.rho).collect();
            rhos.sort_by(f64::total_cmp);
            1.0 / rhos[rhos.len() / 2]
        });
        let motions = seeds::motions(cam_b_from_cam_a, units);
        let make = |i: usize, view: &View| {
            let pyramid = level::pyramid(view, num_levels, options.presmooth_px);
            let coarsest = &pyramid[num_levels - 1];
            let bend = Anchors::new(&points[i], &planes[i], coarsest, units[i])
                .bend(coarsest, options.seed_smoothness);
            let visible = Raster::filled(coarsest.width, coarsest.height, 1.0f32);
            let mut surface = Surface {
                motion: motions[i],
                unit: units[i],
                plane: planes[i],
                seeds: points[i].clone(),
                rho: bend.clone(),
                bend,
                visible,
                pyramid,
            };
            surface.refresh(num_levels - 1);
            surface
        };
        let (first, second) = rayon::join(|| make(0, a), || make(1, b));
        Some(Self { surfaces: [first, second] })
    }

    /// From the coarsest level to the finest.
    pub(crate) fn run(&mut self, options: &StereoOptions) {
        let num_levels = self.surfaces[0].pyramid.len();
        for level_idx in (0..num_levels).rev() {
            let [a, b] = &mut self.surfaces;
            if level_idx + 1 < num_levels {
                a.refine(level_idx);
                b.refine(level_idx);
                let visible = [visibility(a, b, level_idx, options), visibility(b, a, level_idx, options)];
                [a.visible, b.visible] = visible;
            }
            // The pictures of both are read by both, while each changes its own surface.
            let levels_a = std::mem::take(&mut a.pyramid);
            let levels_b = std::mem::take(&mut b.pyramid);
            rayon::join(
                || a.improve(&levels_a[level_idx], &levels_b[level_idx], level_idx, options),
                || b.improve(&levels_b[level_idx], &levels_a[level_idx], level_idx, options),
            );
            a.pyramid = levels_a;
            b.pyramid = levels_b;
        }
    }
}

impl Surface {
    /// Inverse depth from plane and bend.
    fn refresh(&mut self, level_idx: usize) {
        let level = &self.pyramid[level_idx];
        refresh(&mut self.rho, &self.bend, &self.plane, level, self.unit);
    }

    /// To the next finer level.
    fn refine(&mut self, level_idx: usize) {
        let (width, height) = (self.pyramid[level_idx].width, self.pyramid[level_idx].height);
        self.bend = filter::double(&self.bend, width, height, 2.0);
        self.rho = self.bend.clone();
        self.refresh(level_idx);
    }

    /// Stiffness of the plate at a level: less where the ground is seen at a grazing angle, since a pixel then spans more of it,
    /// and less over creases that the surface already has.
    pub(crate) fn stiffness(&self, level: &ViewLevel, options: &StereoOptions) -> Raster<f32> {
        let mut out = self.even_stiffness(level, options);
        self.soften_creases(&mut out, options);
        out
    }

    /// [`Self::stiffness`] over the plane alone.
    fn even_stiffness(&self, level: &ViewLevel, options: &StereoOptions) -> Raster<f32> {
        let c = self.plane.0.map(|c| (c * self.unit) as f32);
        // The plane's normal in the camera is along (c1, c2, c0): c0 z + c1 x + c2 y = 1.
        let norm = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt();
        let mut out = Raster::filled(level.width, level.height, 0.0f32);
        out.data.par_chunks_mut(level.width).enumerate().for_each(|(y, row)| {
            for (s, ray) in row.iter_mut().zip(&level.rays[y * level.width..]) {
                let length = (1.0 + ray[0] * ray[0] + ray[1] * ray[1]).sqrt();
                let cosine = (c[0] + c[1] * ray[0] + c[2] * ray[1]) / (norm * length);
                let cosine = if cosine.is_nan() { 1.0 } else { cosine.clamp(MIN_COSINE, 1.0) };
                *s = options.smoothness * cosine.powf(options.grazing_power);
            }
        });
        out
    }

    /// Divides by `√(1 + κ² / crease²)`, with `κ` the present curvature in a small window: a plate that costs as a total variation
    /// where it is bent hard.
    fn soften_creases(&self, stiffness: &mut Raster<f32>, options: &StereoOptions) {
        let q = &self.bend;
        let (width, height) = (q.width, q.height);
        let mut bent = Raster::filled(width, height, 0.0f32);
        bent.data.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            if y == 0 || y + 1 == height {
                return;
            }
            let rows = q.row(y - 1).windows(3).zip(q.row(y).windows(3)).zip(q.row(y + 1).windows(3));
            for (out, ((above, here), below)) in out[1..].iter_mut().zip(rows) {
                let xx = here[0] - 2.0 * here[1] + here[2];
                let yy = above[1] - 2.0 * here[1] + below[1];
                let xy = 0.25 * (below[2] - below[0] - above[2] + above[0]);
                *out = xx * xx + yy * yy + 2.0 * xy * xy;
            }
        });
        let limit = 1.0 / (options.crease * options.crease);
        for (s, &k2) in stiffness.data.iter_mut().zip(&filter::gaussian(&bent, CREASE_SIGMA_PX).data) {
            *s /= (1.0 + k2 * limit).sqrt();
        }
    }

    /// Warps and solves at one level.
    fn improve(&mut self, here: &ViewLevel, there: &ViewLevel, level_idx: usize, options: &StereoOptions) {
        let (warps, iterations) = match level_idx {
            0 => (options.warps, options.iterations),
            _ => (options.coarse_warps, options.coarse_iterations),
        };
        // At full size the pictures know better than the matches.
        let seeds: &[SeedPoint] = if level_idx == 0 { &[] } else { &self.seeds };
        let anchors = Anchors::new(seeds, &self.plane, here, self.unit);
        let mut solver = Solver::new(here.width, here.height);
        let even = self.even_stiffness(here, options);
        for _ in 0..warps {
            let warped = warp::warp(here, there, &self.motion, &self.rho);
            let Term { mut weight, mut right } =
                term::normalise(here, there, warped, &self.visible, options).term(options);
            // From the change to the bend itself.
            for ((right, weight), &q) in right.data.iter_mut().zip(&mut weight.data).zip(&self.bend.data) {
                *weight += LEAST_WEIGHT;
                *right += *weight * q;
            }
            anchors.hold(&mut weight.data, &mut right.data, &self.bend);
            let mut stiffness = even.clone();
            self.soften_creases(&mut stiffness, options);
            solver.solve(&mut self.bend, &weight.data, &right.data, &stiffness, iterations, TOLERANCE);
            refresh(&mut self.rho, &self.bend, &self.plane, here, self.unit);
        }
    }
}

/// Smallest cosine of the emission angle: beyond it a plane says nothing of the ground.
const MIN_COSINE: f32 = 0.1;
/// Window in which curvature is judged, pixels.
const CREASE_SIGMA_PX: f32 = 1.0;
/// Weight that holds a pixel without data to where it is: nothing beside the plate, but it keeps the equations definite.
const LEAST_WEIGHT: f32 = 1e-9;
/// The conjugate gradients stop when their residual has fallen by this.
const TOLERANCE: f64 = 1e-3;

fn refresh(rho: &mut Raster<f32>, bend: &Raster<f32>, plane: &Plane, level: &ViewLevel, unit: f64) {
    let inverse_focal = 1.0 / level.camera.fx;
    let c = plane.0.map(|c| (c * unit) as f32);
    for ((rho, &q), ray) in rho.data.iter_mut().zip(&bend.data).zip(&level.rays) {
        *rho = c[0] + c[1] * ray[0] + c[2] * ray[1] + q * inverse_focal;
    }
}

/// Where the other view's surface agrees with this one: elsewhere it hides the point, or one of the two is wrong.
pub(crate) fn visibility(
    here: &Surface,
    there: &Surface,
    level_idx: usize,
    options: &StereoOptions,
) -> Raster<f32> {
    let difference = disagreement_px(here, there, level_idx);
    if level_idx >= options.hidden_from_level {
        return difference.map(|_| 1.0);
    }
    difference.map(|&d| if d <= options.consistency_px || d.is_nan() { 1.0 } else { 0.0 })
}

/// Difference of the two surfaces where this view's points land in the other, in pixels of the other's parallax: positive
/// where the other sees something nearer. NaN outside.
pub(crate) fn disagreement_px(here: &Surface, there: &Surface, level_idx: usize) -> Raster<f32> {
    let (level, other) = (&here.pyramid[level_idx], &there.pyramid[level_idx]);
    let to_there = (there.unit / here.unit) as f32;
    let mut out = Raster::filled(level.width, level.height, f32::NAN);
    out.data.par_chunks_mut(level.width).enumerate().for_each(|(y, row)| {
        for (x, d) in row.iter_mut().enumerate() {
            let at = y * level.width + x;
            let rho = here.rho.data[at];
            let Some(landing) = here.motion.land(&other.camera, level.rays[at], rho) else { continue };
            let found = bilinear(
                &there.rho,
                landing.x - pixel::HALF_PIXEL as f32,
                landing.y - pixel::HALF_PIXEL as f32,
            );
            let Some(found) = found else { continue };
            let expected = rho * landing.rho_factor * to_there;
            // A change of the other's inverse depth by its own share moves the image as one of ours does.
            *d = (found - expected) / expected * rho * landing.dx.hypot(landing.dy);
        }
    });
    out
}

/// Bilinear value between pixel centres; `None` outside them.
#[inline]
pub(crate) fn bilinear(raster: &Raster<f32>, x: f32, y: f32) -> Option<f32> {
    if !(x >= 0.0 && y >= 0.0 && x <= (raster.width - 1) as f32 && y <= (raster.height - 1) as f32) {
        return None;
    }
    let (ix, iy) = ((x as usize).min(raster.width - 2), (y as usize).min(raster.height - 2));
    let (fx, fy) = (x - ix as f32, y - iy as f32);
    let at = iy * raster.width + ix;
    let (upper, lower) = (&raster.data[at..at + 2], &raster.data[at + raster.width..at + raster.width + 2]);
    let above = upper[0] + fx * (upper[1] - upper[0]);
    let below = lower[0] + fx * (lower[1] - lower[0]);
    Some(above + fy * (below - above))
}
