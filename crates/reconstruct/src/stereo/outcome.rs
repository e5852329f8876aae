//! What dense stereo answers: depth, sigma, confidence and where each pixel's point is in the other view.

use super::estimate::{self, Estimate, Surface};
use super::options::{Completion, StereoOptions};
use super::{term, warp};
use crate::field::filter;
use crate::{Fill, PredictedView, View};
use rayon::prelude::*;
use selenograph_geometry::{CamA, CamB, Point2, Point3, Rigid3, pixel};
use selenograph_raster::Raster;

/// One view's answer.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseView {
    /// z-depth, in the unit of the motion's translation; NaN where absent.
    pub depth_z: Raster<f32>,
    /// Standard deviation of `depth_z`; NaN where absent.
    pub sigma_z: Raster<f32>,
    /// In `[0, 1]`; 0 where absent.
    pub confidence: Raster<f32>,
    /// Where each value comes from.
    pub fill: Raster<Fill>,
    /// Pixel coordinates of the point in the other view (which may lie outside it); NaN where absent.
    pub in_other: Raster<[f32; 2]>,
}

/// The answer for both views.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// A and B.
    pub views: [DenseView; 2],
    /// The motion that the depths belong to.
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
}

impl Dense {
    /// Points of both views in the frame of camera A (`PredA`), in the unit of the motion's translation. `a` and `b` are the
    /// views that the answer was made from.
    pub fn to_points(&self, a: &View, b: &View) -> [PredictedView; 2] {
        let cam_a_from_cam_b = self.cam_b_from_cam_a.inverse();
        let [of_a, of_b] = &self.views;
        [predicted(of_a, a, |point| point), predicted(of_b, b, |point| cam_a_from_cam_b.point(&point))]
    }
}

fn predicted(
    dense: &DenseView,
    view: &View,
    into_a: impl Fn(Point3<f64>) -> Point3<f64> + Sync,
) -> PredictedView {
    let (width, height) = (dense.depth_z.width, dense.depth_z.height);
    let mut points = Raster::filled(width, height, [f32::NAN; 3]);
    let mut sigma = Raster::filled(width, height, f32::NAN);
    points.data.par_chunks_mut(width).zip(sigma.data.par_chunks_mut(width)).enumerate().for_each(
        |(y, (points, sigma))| {
            for x in 0..width {
                let z = f64::from(dense.depth_z[(x, y)]);
                let Some(ray) = view.camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y)))
                else {
                    continue;
                };
                if z.is_finite() {
                    let point = into_a(Point3::from(ray * z));
                    points[x] = [point.x as f32, point.y as f32, point.z as f32];
                    sigma[x] = (f64::from(dense.sigma_z[(x, y)]) * ray.norm()) as f32;
                }
            }
        },
    );
    PredictedView {
        points,
        confidence: dense.confidence.clone(),
        sigma: Some(sigma),
        fill: dense.fill.clone(),
    }
}

pub(crate) fn assemble(
    estimate: &Estimate,
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
    options: &StereoOptions,
) -> Dense {
    let [a, b] = &estimate.surfaces;
    let (of_a, of_b) = rayon::join(|| one(a, b, options), || one(b, a, options));
    Dense { views: [of_a, of_b], cam_b_from_cam_a: *cam_b_from_cam_a }
}

/// Window in which correlation and information are judged, pixels.
const SUPPORT_SIGMA_PX: f32 = 4.0;
/// Share of measured pixels below which the two views share nothing that could be believed.
const MIN_MEASURED_SHARE: f64 = 0.003;
/// Completion reaches as far from measured pixels as a window of this size still holds some of them, in pixels reduced by
/// [`REACH_HALVINGS`].
const REACH_SIGMA_PX: f32 = 4.0;
/// How often the map of measured pixels is halved for that.
const REACH_HALVINGS: usize = 3;
/// Share of measured pixels in that window below which nothing is completed.
const MIN_REACH: f32 = 0.02;

fn one(surface: &Surface, other: &Surface, options: &StereoOptions) -> DenseView {
    let (level, there) = (&surface.pyramid[0], &other.pyramid[0]);
    let (width, height) = (level.width, level.height);
    let sigma_v = sigma_of_unknown(surface, other, options);
    let disagreement = estimate::disagreement_px(surface, other, 0);
    let mut view = DenseView {
        depth_z: Raster::filled(width, height, f32::NAN),
        sigma_z: Raster::filled(width, height, f32::NAN),
        confidence: Raster::filled(width, height, 0.0),
        fill: Raster::filled(width, height, Fill::Absent),
        in_other: Raster::filled(width, height, [f32::NAN; 2]),
    };
    let mut measured = Raster::filled(width, height, 0.0f32);
    for at in 0..width * height {
        let hidden = disagreement.data[at] > options.consistency_px;
        // NaN: the point is outside the other view.
        if sigma_v.data[at] <= options.measured_sigma && !hidden {
            measured.data[at] = 1.0;
        }
    }
    if measured.data.iter().map(|&m| f64::from(m)).sum::<f64>() < MIN_MEASURED_SHARE * (width * height) as f64
    {
        return view;
    }
    let reach = reach(&measured);
    for at in 0..width * height {
        let rho = surface.rho.data[at];
        let Some(landing) = surface.motion.land(&there.camera, level.rays[at], rho) else { continue };
        let inside = landing.x >= 0.0
            && landing.y >= 0.0
            && landing.x <= there.width as f32
            && landing.y <= there.height as f32
            && level.mask.data[at] > 0.0;
        let fill = match options.completion {
            _ if measured.data[at] > 0.0 => Fill::Measured,
            Completion::None => continue,
            Completion::Holes if !inside || reach_at(&reach, at % width, at / width) < MIN_REACH => continue,
            Completion::Holes | Completion::Everywhere => Fill::Completed,
        };
        let z = surface.unit / f64::from(rho);
        // v = focal length · unit / z.
        let dz_dv = z * z / (surface.unit * f64::from(level.camera.fx));
        let ratio = sigma_v.data[at] / options.measured_sigma;
        view.depth_z.data[at] = z as f32;
        view.sigma_z.data[at] = (f64::from(sigma_v.data[at]) * dz_dv) as f32;
        let confidence = 1.0 / (1.0 + ratio * ratio);
        view.confidence.data[at] = if fill == Fill::Measured { confidence } else { 0.5 * confidence };
        view.fill.data[at] = fill;
        view.in_other.data[at] = [landing.x, landing.y];
    }
    view
}

/// Share of measured pixels in a wide window, on a reduced grid.
fn reach(measured: &Raster<f32>) -> Raster<f32> {
    let mut share = measured.clone();
    for _ in 0..REACH_HALVINGS {
        if share.width.min(share.height) < 4 {
            break;
        }
        let ones = Raster::filled(share.width, share.height, 1.0f32);
        share = filter::halve(&share, &ones).0;
    }
    filter::gaussian(&share, REACH_SIGMA_PX)
}

fn reach_at(reach: &Raster<f32>, x: usize, y: usize) -> f32 {
    let reduced = |i: usize, count: usize| (i >> REACH_HALVINGS).min(count - 1);
    reach[(reduced(x, reach.width), reduced(y, reach.height))]
}

/// Standard deviation of the unknown (pixels of height): that of a thin plate of stiffness `s` over data of information `D` and
/// noise `σ²` is `σ² ∫ d²k / (2π)² / (D + s k⁴) = σ² / (8 √(D s))`.
fn sigma_of_unknown(surface: &Surface, other: &Surface, options: &StereoOptions) -> Raster<f32> {
    let (level, there) = (&surface.pyramid[0], &other.pyramid[0]);
    let warped = warp::warp(level, there, &surface.motion, &surface.rho);
    let normalised = term::normalise(level, there, warped, &surface.visible, options);
    let agreement = normalised.agreement(SUPPORT_SIGMA_PX);
    let information = filter::gaussian(&normalised.term(options).weight, SUPPORT_SIGMA_PX);
    let mut sigma = surface.stiffness(level, options);
    for (at, s) in sigma.data.iter_mut().enumerate() {
        // Noise has gradients too: only what both pictures show alike is information.
        let share = agreement.correlation.data[at].max(0.0);
        let information = information.data[at] * share * share;
        let noise2 = agreement.residual2.data[at] + NOISE_FLOOR2;
        let variance = noise2 / (8.0 * (information * *s).sqrt().max(1e-12));
        *s = options.sigma_scale * variance.sqrt();
    }
    sigma
}

/// Least variance of the normalised grey levels: what interpolation and rounding leave.
const NOISE_FLOOR2: f32 = 1e-3;
