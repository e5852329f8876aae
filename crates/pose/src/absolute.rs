//! Pose of one camera from points and their images, or the reason why none can be given.

mod reprojection;

use crate::degenerate::above_chance;
use crate::random::Random;
use crate::ransac::{Estimator, Local, Score, Search, Tally, search};
use crate::solvers::p3p::{CameraPose, p3p};
pub use reprojection::{linearised, refine};
use selenograph_geometry::{Cam, Frame, Point2, Point3, Rigid3, Rotation3, SMatrix, Vector3};

/// A point and where it is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// In the world.
    pub world: Point3<f64>,
    /// On the plane `z = 1` of the camera.
    pub image: Point2<f64>,
}

/// How to estimate a camera's pose.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AbsoluteOptions {
    /// Largest reprojection error of an inlier, on the plane `z = 1` (pixels divided by the focal length).
    pub threshold: f64,
    /// Seed of the samples.
    pub seed: u64,
    /// Probability with which no better sample was missed.
    pub confidence: f64,
    /// Samples after which the search ends.
    pub max_iterations: usize,
}

impl Default for AbsoluteOptions {
    fn default() -> Self {
        Self { threshold: 2.0 / 618.0, seed: 0, confidence: 0.9999, max_iterations: 10_000 }
    }
}

/// A camera's pose with what supports it.
#[derive(Debug, Clone)]
pub struct AbsolutePose<World: Frame> {
    /// The pose.
    pub cam_from_world: Rigid3<Cam, World>,
    /// Which sightings agree with it.
    pub inliers: Vec<bool>,
    /// Root mean square of the inliers' reprojection errors (both coordinates), on the plane `z = 1`.
    pub residual_rms: f64,
    /// Covariance of the rotation (three components of a rotation vector applied in the camera, radians) and of the translation
    /// (three, in units of the world).
    pub covariance: SMatrix<f64, 6, 6>,
    /// Samples drawn.
    pub iterations: usize,
}

/// Why no pose can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CannotLocate {
    /// Not enough points for any estimate.
    #[error("{found} points, at least {needed} are needed")]
    TooFewPoints {
        /// Points that came in.
        found: usize,
        /// Points that are needed.
        needed: usize,
    },
    /// No pose is shared by more points than chance gives.
    #[error("only {inliers} of {points} points agree on a pose, as few as by chance")]
    NoConsensus {
        /// Points that agree with the best pose.
        inliers: usize,
        /// Points that came in.
        points: usize,
    },
}

/// Three points fix a pose (up to four), one chooses, one confirms.
const MIN_POINTS: usize = 5;
/// Steps of a local optimisation and of the last refinement.
const LOCAL_STEPS: usize = 4;
const FINAL_STEPS: usize = 20;
/// Local optimisation looks at this many inliers at most.
const MAX_LOCAL: usize = 200;

/// Estimates the pose of a camera: P3P in LO-MSAC, then Levenberg-Marquardt on the reprojection errors of all inliers.
///
/// # Shapes and units
/// Image points on the plane `z = 1`, undistorted. Sightings that are not finite are never inliers.
/// # Errors
/// [`CannotLocate`], with the reason.
pub fn estimate<World: Frame>(
    sightings: &[Sighting],
    options: &AbsoluteOptions,
) -> Result<AbsolutePose<World>, CannotLocate> {
    let is_finite = |s: &Sighting| s.world.iter().chain(s.image.iter()).all(|v| v.is_finite());
    let usable: Vec<usize> = (0..sightings.len()).filter(|&i| is_finite(&sightings[i])).collect();
    if usable.len() < MIN_POINTS {
        return Err(CannotLocate::TooFewPoints { found: usable.len(), needed: MIN_POINTS });
    }
    // About their mean, world coordinates of thousands of kilometres lose no digits.
    let mean = usable.iter().map(|&i| sightings[i].world.coords).sum::<Vector3<f64>>() / usable.len() as f64;
    let shuffled: Vec<Sighting> = Random::new(options.seed)
        .permutation(usable.len())
        .into_iter()
        .map(|k| sightings[usable[k]])
        .map(|s| Sighting { world: s.world - mean, ..s })
        .collect();
    let limit = options.threshold * options.threshold;
    let mut estimator = PoseSearch { sightings: &shuffled, limit, near: Vec::with_capacity(MAX_LOCAL) };
    let settings = Search {
        seed: options.seed.wrapping_add(1),
        confidence: options.confidence,
        min_iterations: 10,
        max_iterations: options.max_iterations,
        local: Local::Improve,
        order: None,
    };
    let found = search(&mut estimator, &settings);
    let Some(found) = found else {
        return Err(CannotLocate::NoConsensus { inliers: 0, points: sightings.len() });
    };
    let pose = refine(&shuffled, &found.model, limit, FINAL_STEPS);
    let num_inliers = shuffled.iter().filter(|s| squared_error(&pose, s) < limit).count();
    let chance = chance_share(&shuffled, &pose, limit);
    if !above_chance(num_inliers, shuffled.len(), 3, 4.0, chance) {
        return Err(CannotLocate::NoConsensus { inliers: num_inliers, points: sightings.len() });
    }
    let (information, squares) = linearised(&shuffled, &pose, limit);
    let free = (2 * num_inliers) as f64 - 6.0;
    let inverse = information.try_inverse().unwrap_or_else(|| SMatrix::from_diagonal_element(f64::INFINITY));
    let covariance = about_world(&(inverse * (squares / free)), &pose, &mean);
    let inliers = sightings
        .iter()
        .map(|s| squared_error(&pose, &Sighting { world: s.world - mean, ..*s }) < limit)
        .collect();
    let origin = pose.translation - pose.rotation * mean;
    Ok(AbsolutePose {
        cam_from_world: Rigid3::new(Rotation3::from_matrix_unchecked(pose.rotation), Point3::from(origin)),
        inliers,
        residual_rms: (squares / (2 * num_inliers) as f64).sqrt(),
        covariance,
        iterations: found.iterations,
    })
}

/// The covariance for the world's own origin: `t_world = t_mean − exp(ω) R mean`, so that `ω` moves it too.
fn about_world(
    covariance: &SMatrix<f64, 6, 6>,
    pose: &CameraPose,
    mean: &Vector3<f64>,
) -> SMatrix<f64, 6, 6> {
    let mut change = SMatrix::<f64, 6, 6>::identity();
    change.fixed_view_mut::<3, 3>(3, 0).copy_from(&(pose.rotation * mean).cross_matrix());
    change * covariance * change.transpose()
}

/// Squared reprojection error on the plane `z = 1`; infinite behind the camera.
pub fn squared_error(pose: &CameraPose, sighting: &Sighting) -> f64 {
    let p = pose.rotation * sighting.world.coords + pose.translation;
    if p.z.is_nan() || p.z <= 0.0 {
        return f64::INFINITY;
    }
    let (dx, dy) = (p.x / p.z - sighting.image.x, p.y / p.z - sighting.image.y);
    dx * dx + dy * dy
}

/// How often a point agrees with the image of another.
fn chance_share(sightings: &[Sighting], pose: &CameraPose, limit: f64) -> f64 {
    let n = sightings.len();
    let shifts = (6000 / n).clamp(1, n - 1);
    let mut count = 0_usize;
    for k in 1..=shifts {
        let shift = (k * n / (shifts + 1)).max(1);
        for i in 0..n {
            let mixed = Sighting { world: sightings[i].world, image: sightings[(i + shift) % n].image };
            count += usize::from(squared_error(pose, &mixed) < limit);
        }
    }
    (count as f64 + 0.5) / ((shifts * n) as f64 + 1.0)
}

struct PoseSearch<'a> {
    sightings: &'a [Sighting],
    limit: f64,
    near: Vec<Sighting>,
}

impl Estimator for PoseSearch<'_> {
    type Model = CameraPose;
    const SAMPLE: usize = 3;

    fn num_data(&self) -> usize {
        self.sightings.len()
    }

    fn solve(&mut self, sample: &[usize], models: &mut Vec<Self::Model>) {
        let world = std::array::from_fn(|k| self.sightings[sample[k]].world.coords);
        let directions = std::array::from_fn(|k| {
            let image = self.sightings[sample[k]].image;
            Vector3::new(image.x, image.y, 1.0).normalize()
        });
        p3p(&world, &directions, models);
    }

    fn score(&self, model: &Self::Model, best: &Score) -> Option<Score> {
        let mut tally = Tally::new(self.limit, self.sightings.len(), best);
        for block in self.sightings.chunks(64) {
            let (mut cost, mut inliers) = (0.0, 0);
            for sighting in block {
                let squared = squared_error(model, sighting);
                let close = squared < self.limit;
                cost += if close { squared } else { self.limit };
                inliers += usize::from(close);
            }
            if !tally.add(block.len(), cost, inliers) {
                return None;
            }
        }
        Some(tally.score())
    }

    fn improve(&mut self, model: &Self::Model) -> Option<Self::Model> {
        let limit = 4.0 * self.limit;
        let near = self.sightings.iter().filter(|s| squared_error(model, s) < limit).take(MAX_LOCAL);
        self.near.clear();
        self.near.extend(near);
        (self.near.len() > 3).then(|| refine(&self.near, model, limit, LOCAL_STEPS))
    }
}
