//! Scale and place by a coarse elevation model: the predicted surface is laid onto it.
//!
//! What is minimised is the height of the predicted points over the model, `r = height(p) − model(map(p))`, with Tukey's
//! weights against blunders and against relief that the model does not hold. Seven numbers may change (shift, turn and scale
//! about the scene's middle), but a level plain says nothing about a horizontal shift, and gentle relief little about the
//! scale. What is known beforehand is where camera A stands and looks: the change moves and turns it only as far as the
//! surface demands against the accuracies given. Seen from a known place, the model's level tells the scale. The result says
//! which numbers the surface has decided ([`DemAlignment::observed`]).
//!
//! The equations are those of least squares with the model's heights as instruments: the predicted heights have errors (and
//! relief finer than the model), which would pull the scale down if they stood on both sides.
//!
//! # Source
//! Point-to-surface registration after Chen & Medioni 1992, "Object modelling by registration of multiple range images", with
//! the weights of Beaton & Tukey 1974.

mod patch;

pub use patch::DemPatch;

use super::{Placement, ScaleSource};
use crate::Error;
use crate::grid::frame::sampled_points;
use crate::prediction::Prediction;
use selenograph_geometry::{
    BodyFixed, CamA, Enu, Point3, PredA, Rigid3, Rotation3, SMatrix, SVector, Sim3, Vector3,
    robust::MAD_TO_SIGMA,
};
use selenograph_raster::statistics::median;
use serde::{Deserialize, Serialize};

/// How well the given pose is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DemOptions {
    /// Standard deviation of the position of camera A along each axis, metres.
    pub position_sigma_m: f64,
    /// Standard deviation of its attitude about each axis, degrees.
    pub attitude_sigma_deg: f64,
    /// Standard deviation of a scale that was given, as a fraction of it; a scale that was not given is free.
    pub scale_sigma: f64,
    /// Rounds of the minimisation.
    pub rounds: usize,
}

impl Default for DemOptions {
    fn default() -> Self {
        Self { position_sigma_m: 500.0, attitude_sigma_deg: 1.0, scale_sigma: 0.05, rounds: 30 }
    }
}

/// A surface laid onto an elevation model.
#[derive(Debug, Clone)]
pub struct DemAlignment {
    /// From the prediction to the body.
    pub body_from_pred: Sim3<BodyFixed, PredA>,
    /// Root mean square height over the model at the given pose (its own scale fitted), metres.
    pub residual_before_m: f64,
    /// The same in the end, over the same points, blunders left out.
    pub residual_after_m: f64,
    /// By how much the scene's middle moved: east, north, up, metres.
    pub shift_m: [f64; 3],
    /// By how much the scene turned about its middle: about east, north, up, radians.
    pub turn_rad: [f64; 3],
    /// By which factor it was scaled, against the given scale or the one that fits the given pose.
    pub scale_change: f64,
    /// Standard deviations after the fit: shift (metres), turn (radians), scale (a fraction).
    pub sigma: [f64; 7],
    /// Whether the surface has decided the number: its sigma is less than half of what was known before.
    pub observed: [bool; 7],
    /// Points used.
    pub num_points: usize,
    /// Share of them that are no blunders.
    pub inlier_share: f64,
}

impl DemAlignment {
    /// The placement that follows.
    ///
    /// # Errors
    /// [`Error::Geometry`] for a scale that is none.
    pub fn placement(&self, dem: &DemPatch) -> Result<Placement, Error> {
        Placement::from_body(dem.body().clone(), &self.body_from_pred, Some(self.sigma[6]), ScaleSource::Dem)
    }
}

/// A scale that nobody gave is known to within nothing: this many natural units.
const FREE_SCALE_SIGMA: f64 = 10.0;
/// Tukey's constant: 95 % efficient where there are no blunders.
const TUKEY: f64 = 4.685;
/// The search for the first shift tries at most so many places along each axis.
const MAX_SEARCH_STEPS: i32 = 12;
/// Fewer points than this over the model are no surface.
const MIN_POINTS: usize = 100;

/// Lays the predicted surface onto an elevation model, from an approximate pose of camera A and a scale if one is known.
///
/// # Errors
/// [`Error::TooFewPoints`] if hardly any point lies over the model; [`Error::Undetermined`] if no scale brings the surface
/// to the model's height; [`Error::Value`] for a sigma that is not positive.
pub fn align(
    prediction: &Prediction,
    body_from_cam_a: &Rigid3<BodyFixed, CamA>,
    scale: Option<f64>,
    dem: &DemPatch,
    options: &DemOptions,
) -> Result<DemAlignment, Error> {
    for (key, value) in
        [("position_sigma_m", options.position_sigma_m), ("attitude_sigma_deg", options.attitude_sigma_deg)]
    {
        if !(value > 0.0 && value.is_finite()) {
            return Err(Error::Value { key, expected: "a number > 0", found: value.to_string() });
        }
    }
    let points: Vec<Point3<f64>> = sampled_points(prediction).into_iter().map(Point3::from).collect();
    let start_scale = match scale {
        Some(scale) => scale,
        None => scale_at_pose(&points, body_from_cam_a, dem)?,
    };
    let start: Sim3<BodyFixed, PredA> = Sim3::new(start_scale, body_from_cam_a.relabel())?;
    let problem = Problem::new(&points, &start, dem);
    let range = (problem.middle - start.origin()).norm();
    let turn_sigma = options.attitude_sigma_deg.to_radians();
    // A turned camera moves the whole scene.
    let shift_sigma = options.position_sigma_m.hypot(turn_sigma * range);
    let scale_sigma = if scale.is_some() { options.scale_sigma } else { FREE_SCALE_SIGMA };
    let prior = Prior { position: options.position_sigma_m, turn: turn_sigma, scale: scale_sigma };
    let known = prior.of_the_scene(shift_sigma);
    let before = problem.residuals(&Change::default());
    let num_points = before.len();
    if num_points < MIN_POINTS {
        return Err(Error::TooFewPoints {
            what: "an alignment with an elevation model",
            needed: MIN_POINTS,
            found: num_points,
        });
    }
    let mut change = problem.search(shift_sigma);
    let mut information = SMatrix::<f64, 7, 7>::identity();
    for _ in 0..options.rounds {
        let (step, fitted) = problem.step(&change, &prior);
        information = fitted;
        change.values += step;
        if problem.is_small(&step) {
            break;
        }
    }
    problem.finish(&start, &change, &information, &known, &before)
}

/// The scale at which the surface lies at the model's height, in the median, seen from a fixed pose.
fn scale_at_pose(
    points: &[Point3<f64>],
    body_from_cam_a: &Rigid3<BodyFixed, CamA>,
    dem: &DemPatch,
) -> Result<f64, Error> {
    let wrong =
        |why: &str| Error::Undetermined { what: "scale from an elevation model", why: why.to_owned() };
    let origin = body_from_cam_a.origin();
    let up = origin.coords.normalize();
    let drop = |p: &Point3<f64>| -up.dot(&body_from_cam_a.vector(&p.coords));
    let typical_drop = median(points.iter().map(drop)).filter(|d| *d > 0.0);
    let typical_drop = typical_drop.ok_or_else(|| wrong("the surface is not below the given pose"))?;
    let above = dem.height_over(&origin).unwrap_or_else(|| dem.body().height_m(&origin));
    if above <= 0.0 {
        return Err(wrong("the given position lies below the model"));
    }
    let mut scale = above / typical_drop;
    // Each round moves the median point onto the model below it; relief makes a few rounds necessary.
    for _ in 0..50 {
        let placed = points.iter().map(|p| origin + body_from_cam_a.vector(&p.coords) * scale);
        let over = median(placed.filter_map(|p| dem.height_over(&p)));
        let step = over.ok_or_else(|| wrong("no point lies over the model"))? / typical_drop;
        scale = (scale + step).max(0.1 * scale);
        if step.abs() < 1e-9 * scale {
            break;
        }
    }
    Ok(scale)
}

/// What is known of camera A and of the scale, as standard deviations: metres, radians, a fraction.
#[derive(Debug, Clone, Copy)]
struct Prior {
    position: f64,
    turn: f64,
    scale: f64,
}

impl Prior {
    /// The same for the seven numbers of the scene, about its middle.
    fn of_the_scene(&self, shift: f64) -> SVector<f64, 7> {
        SVector::from([shift, shift, shift, self.turn, self.turn, self.turn, self.scale])
    }
}

/// What is changed: shift in metres, turn in radians, logarithm of the scale.
#[derive(Debug, Clone, Copy, Default)]
struct Change {
    values: SVector<f64, 7>,
}

impl Change {
    fn shift(&self) -> Vector3<f64> {
        self.values.fixed_rows::<3>(0).into_owned()
    }
    fn turn(&self) -> Rotation3<f64> {
        Rotation3::new(self.values.fixed_rows::<3>(3).into_owned())
    }
    fn factor(&self) -> f64 {
        self.values[6].exp()
    }
}

/// The surface in east, north and up about its middle.
struct Problem<'a> {
    dem: &'a DemPatch,
    middle: Point3<f64>,
    body_from_enu: Rigid3<BodyFixed, Enu>,
    points: Vec<Vector3<f64>>,
    /// Camera A as it was given, in the same axes.
    cam_a: Vector3<f64>,
    /// Root mean square distance from the middle, metres.
    extent: f64,
}

impl<'a> Problem<'a> {
    fn new(points: &[Point3<f64>], start: &Sim3<BodyFixed, PredA>, dem: &'a DemPatch) -> Self {
        let placed: Vec<Point3<f64>> = points.iter().map(|p| start.point(p)).collect();
        let count = placed.len().max(1) as f64;
        let middle = Point3::from(placed.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count);
        let place = dem.body().place(&middle);
        let axes = dem.body().body_from_enu(&place);
        let [w, x, y, z] = axes.quaternion_wxyz();
        let body_from_enu = Rigid3::from_quaternion(w, x, y, z, middle);
        let enu_from_body = body_from_enu.inverse();
        let points: Vec<Vector3<f64>> = placed.iter().map(|p| enu_from_body.point(p).coords).collect();
        let extent = (points.iter().map(Vector3::norm_squared).sum::<f64>() / count).sqrt();
        let cam_a = enu_from_body.point(&start.origin()).coords;
        Self { dem, middle, body_from_enu, points, cam_a, extent }
    }

    fn moved<'c>(&'c self, change: &Change) -> impl Fn(&Vector3<f64>) -> Vector3<f64> + use<'c, 'a> {
        let (matrix, shift) = (change.turn().matrix() * change.factor(), change.shift());
        move |p| matrix * p + shift
    }

    fn height_over(&self, p: &Vector3<f64>) -> Option<f64> {
        self.dem.height_over(&self.body_from_enu.point(&Point3::from(*p)))
    }

    fn residuals(&self, change: &Change) -> Vec<f64> {
        let moved = self.moved(change);
        self.points.iter().filter_map(|p| self.height_over(&moved(p))).collect()
    }

    /// The best horizontal shift on a coarse grid within two sigmas, heights compared about their median.
    fn search(&self, shift_sigma: f64) -> Change {
        let step =
            self.dem.cell_m().max(2.0 * shift_sigma / f64::from(MAX_SEARCH_STEPS)).max(0.02 * self.extent);
        let reach = ((2.0 * shift_sigma / step).floor() as i32).min(MAX_SEARCH_STEPS);
        let thinned: Vec<&Vector3<f64>> =
            self.points.iter().step_by((self.points.len() / 600).max(1)).collect();
        let mut best = (f64::INFINITY, Vector3::zeros());
        for north in -reach..=reach {
            for east in -reach..=reach {
                let shift = Vector3::new(f64::from(east) * step, f64::from(north) * step, 0.0);
                let over: Vec<f64> = thinned.iter().filter_map(|p| self.height_over(&(*p + shift))).collect();
                if over.len() * 2 < thinned.len() {
                    continue;
                }
                let level = median(over.iter().copied()).unwrap_or(0.0);
                let spread = median(over.iter().map(|r| (r - level).abs())).unwrap_or(f64::INFINITY);
                // A shift far from the given place needs a better reason than one nearby.
                let cost = MAD_TO_SIGMA * spread * (1.0 + 0.05 * shift.norm_squared() / shift_sigma.powi(2));
                if cost < best.0 {
                    best = (cost, shift - Vector3::z() * level);
                }
            }
        }
        let mut values = SVector::<f64, 7>::zeros();
        values.fixed_rows_mut::<3>(0).copy_from(&best.1);
        Change { values }
    }

    /// One Gauss-Newton step and the information behind it.
    fn step(&self, change: &Change, prior: &Prior) -> (SVector<f64, 7>, SMatrix<f64, 7, 7>) {
        let moved = self.moved(change);
        let half = 0.5 * self.dem.cell_m();
        let rows: Vec<(f64, SVector<f64, 7>)> = self
            .points
            .iter()
            .filter_map(|p| {
                let x = moved(p);
                let residual = self.height_over(&x)?;
                let along = |axis: Vector3<f64>| {
                    Some(
                        (self.height_over(&(x + axis * half))? - self.height_over(&(x - axis * half))?)
                            / (2.0 * half),
                    )
                };
                let gradient = Vector3::new(along(Vector3::x())?, along(Vector3::y())?, 1.0);
                // The point of the model below: relief that the model does not hold would otherwise be made smaller by
                // making everything smaller, and the scale would come out too small.
                let arm = x - Vector3::z() * residual - change.shift();
                let turn = arm.cross(&gradient);
                let row = [gradient.x, gradient.y, gradient.z, turn.x, turn.y, turn.z, gradient.dot(&arm)];
                Some((residual, SVector::from(row)))
            })
            .collect();
        let spread = spread_of(rows.iter().map(|(r, _)| *r));
        let variance = spread * spread * self.correlation(rows.len());
        let mut information = SMatrix::<f64, 7, 7>::zeros();
        let mut right = SVector::<f64, 7>::zeros();
        for (residual, row) in &rows {
            let weight = tukey(residual / spread) / variance;
            information += row * row.transpose() * weight;
            right -= row * (residual * weight);
        }
        self.add_prior(change, prior, &mut information, &mut right);
        let step = information.cholesky().map_or_else(SVector::zeros, |c| c.solve(&right));
        (step, information)
    }

    /// Camera A stands and looks as it was given, to within what is known; a scene that is scaled or turned moves it too.
    fn add_prior(
        &self,
        change: &Change,
        prior: &Prior,
        information: &mut SMatrix<f64, 7, 7>,
        right: &mut SVector<f64, 7>,
    ) {
        let cam_a = self.moved(change)(&self.cam_a);
        let arm = cam_a - change.shift();
        let mut jacobian = SMatrix::<f64, 3, 7>::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm.cross_matrix());
        jacobian.fixed_view_mut::<3, 1>(0, 6).copy_from(&arm);
        let weight = prior.position.powi(-2);
        *information += jacobian.transpose() * jacobian * weight;
        *right -= jacobian.transpose() * (cam_a - self.cam_a) * weight;
        for (i, sigma) in [(3, prior.turn), (4, prior.turn), (5, prior.turn), (6, prior.scale)] {
            let weight = sigma.powi(-2);
            information[(i, i)] += weight;
            right[i] -= weight * change.values[i];
        }
    }

    /// How many points share one independent error: those over one cell of the model.
    fn correlation(&self, num_points: usize) -> f64 {
        let cells = (2.0 * self.extent / self.dem.cell_m()).powi(2).max(1.0);
        (num_points as f64 / cells).max(1.0)
    }

    fn is_small(&self, step: &SVector<f64, 7>) -> bool {
        // A ten-thousandth of a cell anywhere in the scene.
        let largest = step.fixed_rows::<3>(0).norm() + step.fixed_rows::<4>(3).norm() * self.extent;
        largest < 1e-4 * self.dem.cell_m()
    }

    fn finish(
        &self,
        start: &Sim3<BodyFixed, PredA>,
        change: &Change,
        information: &SMatrix<f64, 7, 7>,
        prior: &SVector<f64, 7>,
        before: &[f64],
    ) -> Result<DemAlignment, Error> {
        let covariance = information.try_inverse().ok_or_else(|| Error::Undetermined {
            what: "scale from an elevation model",
            why: "the surface and the given accuracies leave it open".to_owned(),
        })?;
        let enu_from_enu: Sim3<Enu, Enu> =
            Sim3::new(change.factor(), Rigid3::new(change.turn(), Point3::from(change.shift())))?;
        let body_from_enu = Sim3::from_rigid(self.body_from_enu);
        let enu_from_pred = &body_from_enu.inverse() * start;
        let body_from_pred = &body_from_enu * &(&enu_from_enu * &enu_from_pred);
        let after = self.residuals(change);
        let spread = spread_of(after.iter().copied());
        let kept: Vec<f64> = after.iter().copied().filter(|r| tukey(r / spread) > 0.0).collect();
        let rms =
            |values: &[f64]| (values.iter().map(|r| r * r).sum::<f64>() / values.len().max(1) as f64).sqrt();
        let sigma: [f64; 7] = std::array::from_fn(|i| covariance[(i, i)].max(0.0).sqrt());
        let v = &change.values;
        Ok(DemAlignment {
            body_from_pred,
            residual_before_m: rms(before),
            residual_after_m: rms(&kept),
            shift_m: [v[0], v[1], v[2]],
            turn_rad: [v[3], v[4], v[5]],
            scale_change: change.factor(),
            sigma,
            observed: std::array::from_fn(|i| sigma[i] < 0.5 * prior[i]),
            num_points: after.len(),
            inlier_share: kept.len() as f64 / after.len().max(1) as f64,
        })
    }
}

/// Robust standard deviation about zero, never quite zero.
fn spread_of(residuals: impl Iterator<Item = f64>) -> f64 {
    (MAD_TO_SIGMA * median(residuals.map(f64::abs)).unwrap_or(0.0)).max(1e-6)
}

fn tukey(t: f64) -> f64 {
    let u = (t / TUKEY).powi(2);
    if u < 1.0 { (1.0 - u) * (1.0 - u) } else { 0.0 }
}

#[cfg(test)]
mod tests;
