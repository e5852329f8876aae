//! Relative pose of two views from matches, or the reason why none can be given.
//!
//! ```
//! use selenograph_pose::problems::{Scene, SceneKind};
//! use selenograph_pose::relative::{RelativeOptions, estimate};
//! let scene = Scene::new(&SceneKind::General, 500, 7).with_outliers(0.3).with_noise(0.3 / 600.0);
//! let options = RelativeOptions { threshold: 1.0 / 600.0, ..RelativeOptions::default() };
//! let found = estimate(&scene.matches, &options)?;
//! assert!(scene.direction_error_rad(&found.cam_b_from_cam_a) < 0.02);
//! # Ok::<(), selenograph_pose::relative::CannotSay>(())
//! ```

mod hypotheses;
mod options;
mod support;

pub use options::{Order, Refinement, RelativeOptions};

use crate::consensus::{Counting, EssentialSearch, RotationSearch, fit_rotation};
use crate::decompose::{Motion, motions_of_essential};
use crate::degenerate::{above_chance, chance_share, without_parallax};
use crate::points::Pairs;
use crate::random::Random;
use crate::ransac::{Found, Local, Search, search};
use crate::refine::uncertainty;
use crate::solvers::homography_4pt::transfer_squared;
use selenograph_geometry::{CamA, CamB, Matrix3, Point2, Point3, Rigid3, Rotation3, UnitQuaternion};
use support::Support;

/// One match, on the plane `z = 1` of each camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// In camera A.
    pub a: Point2<f64>,
    /// In camera B.
    pub b: Point2<f64>,
    /// Higher is better; only the order is used.
    pub score: f64,
}

/// A relative pose with what supports it.
#[derive(Debug, Clone)]
pub struct RelativePose {
    /// The motion, with a translation of length 1: an essential matrix gives a direction, not metres.
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
    /// Which matches agree with it.
    pub inliers: Vec<bool>,
    /// Root mean square Sampson distance of the inliers, on the plane `z = 1`.
    pub residual_rms: f64,
    /// Covariance of rotation (three components of a rotation vector applied in B, radians) and of the translation's direction
    /// (two components in its tangent plane, radians; its axes: [`crate::sampson::tangent_axes`]).
    pub covariance: selenograph_geometry::SMatrix<f64, 5, 5>,
    /// Share of the inliers that one homography explains as well: near 1, the scene is nearly a plane.
    pub plane_share: f64,
    /// Another motion, more than 5° away, that the matches allow as well within noise: a plane without relief has two. Looked for with
    /// [`Refinement::Full`] only.
    pub rival: Option<Rigid3<CamB, CamA>>,
    /// Samples drawn.
    pub iterations: usize,
}

/// Why no relative pose can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CannotSay {
    /// Not enough matches for any estimate.
    #[error("{found} matches, at least {needed} are needed")]
    TooFewMatches {
        /// Matches that came in.
        found: usize,
        /// Matches that are needed.
        needed: usize,
    },
    /// No motion is shared by more matches than chance gives.
    #[error("only {inliers} of {matches} matches agree on a motion, as few as by chance")]
    NoConsensus {
        /// Matches that agree with the best motion.
        inliers: usize,
        /// Matches that came in.
        matches: usize,
    },
    /// The views differ by a rotation only (or not at all): there is no parallax, so no direction and no depth.
    #[error(
        "no parallax: the views differ by a rotation of {rotation_deg:.3}° only (residual {residual:.2e} on the plane z = 1)"
    )]
    NoParallax {
        /// The rotation between the views, degrees.
        rotation_deg: f64,
        /// The rotation: `x_b ∝ R x_a`.
        cam_b_from_cam_a: UnitQuaternion<f64>,
        /// What a pure rotation leaves unexplained in a coordinate, on the plane `z = 1`.
        residual: f64,
    },
}

impl CannotSay {
    /// What the user can do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::TooFewMatches { .. } => {
                "take views that overlap more, or pictures with more texture and light"
            }
            Self::NoConsensus { .. } => {
                "check that the pictures show the same ground and that the cameras' focal lengths are right"
            }
            Self::NoParallax { .. } => "take the second view from another place: depth needs a baseline",
        }
    }
}

/// Fewer matches cannot be told from chance: five fix a motion, three must confirm it.
const MIN_MATCHES: usize = 8;
/// Samples that are always drawn unless plain RANSAC is asked for: they cost little beside the refinement.
const MIN_ITERATIONS: usize = 20;
/// The rotation needs few samples; views without it are most, and must not pay.
const ROTATION_ITERATIONS: usize = 40;
/// How often the supporting matches are chosen anew before the last refinement.
const FINAL_SELECTIONS: usize = 2;

/// Estimates the relative pose of two views.
///
/// # Shapes and units
/// Coordinates on the plane `z = 1`, undistorted. Matches with coordinates that are not numbers are never inliers.
/// # Errors
/// [`CannotSay`], with the reason: a pose is never invented.
/// # Source
/// LO-MSAC with the five-point solver, plane and parallax hypotheses, robust Sampson refinement; see the modules.
pub fn estimate(matches: &[Match], options: &RelativeOptions) -> Result<RelativePose, CannotSay> {
    let problem = Problem::new(matches, options)?;
    let rotation = problem.rotation();
    let essential = problem.essential();
    let plane = essential.as_ref().and_then(|found| {
        hypotheses::dominant_plane(&problem.pairs, &found.model, options.threshold, options.seed)
    });
    let (motion, rival) = match &essential {
        Some(found) => {
            let (motion, rival) = problem.refined(&found.model, rotation.as_ref(), plane.as_ref());
            (Some(motion), rival)
        }
        None => (None, None),
    };
    let support =
        motion.as_ref().map(|motion| Support::new(&problem.pairs, motion, plane.as_ref(), options.threshold));
    let inliers = support.as_ref().map(|support| support.agreeing(&problem.pairs));
    let num_inliers = inliers.as_ref().map_or(0, Pairs::len);
    let chance = support.as_ref().map_or(1.0, |support| support.chance);
    let supported = problem.above_chance(num_inliers, 5, 10.0, chance);
    if let Some(rotation) = rotation {
        let motion = motion.as_ref().filter(|_| supported);
        problem.refuse_without_parallax(motion, &rotation, chance)?;
    }
    match (motion, support, inliers) {
        (Some(motion), Some(support), Some(inliers)) if supported => {
            let iterations = essential.map_or(0, |found| found.iterations);
            Ok(problem.answer(&motion, rival, &support, &inliers, iterations))
        }
        _ => Err(CannotSay::NoConsensus { inliers: num_inliers, matches: matches.len() }),
    }
}

/// The matches in random order, and what is asked of them.
struct Problem<'a> {
    matches: &'a [Match],
    options: &'a RelativeOptions,
    pairs: Pairs,
    /// From the most to the least promising, as positions in `pairs`.
    order: Option<Vec<usize>>,
}

impl<'a> Problem<'a> {
    fn new(matches: &'a [Match], options: &'a RelativeOptions) -> Result<Self, CannotSay> {
        let usable: Vec<usize> = (0..matches.len())
            .filter(|&i| [matches[i].a, matches[i].b].iter().all(|p| p.x.is_finite() && p.y.is_finite()))
            .collect();
        if usable.len() < MIN_MATCHES {
            return Err(CannotSay::TooFewMatches { found: usable.len(), needed: MIN_MATCHES });
        }
        let source: Vec<usize> =
            Random::new(options.seed).permutation(usable.len()).into_iter().map(|i| usable[i]).collect();
        let pairs = Pairs::new(source.iter().map(|&i| {
            let m = &matches[i];
            [m.a.x, m.a.y, m.b.x, m.b.y]
        }));
        let score = |i: usize| matches[source[i]].score;
        let differ = (1..source.len()).any(|i| score(i) != score(0));
        let order = (options.order == Order::Prosac && differ).then(|| {
            let mut order: Vec<usize> = (0..source.len()).collect();
            let key = |i: usize| if score(i).is_nan() { f64::NEG_INFINITY } else { score(i) };
            order.sort_by(|&i, &j| key(j).total_cmp(&key(i)));
            order
        });
        Ok(Self { matches, options, pairs, order })
    }

    /// Whether so many of all matches agree as hardly would by chance.
    fn above_chance(&self, inliers: usize, sample: usize, models_per_sample: f64, chance: f64) -> bool {
        let evidence = |count: usize| (count as f64 / self.options.per_evidence.max(1.0)) as usize;
        above_chance(evidence(inliers), evidence(self.pairs.len()), sample, models_per_sample, chance)
    }

    fn search(&self, local: Local, min_iterations: usize, max_iterations: usize) -> Search<'_> {
        Search {
            seed: self.options.seed.wrapping_add(1),
            confidence: self.options.confidence,
            min_iterations,
            max_iterations,
            local,
            order: self.order.as_deref(),
        }
    }

    fn essential(&self) -> Option<Found<Matrix3<f64>>> {
        let (counting, local, least) = match self.options.refinement {
            Refinement::None => (Counting::Inliers, Local::Keep, 0),
            _ => (Counting::Squares, Local::Improve, MIN_ITERATIONS),
        };
        let mut estimator = EssentialSearch::new(&self.pairs, self.options.threshold, counting);
        search(&mut estimator, &self.search(local, least, self.options.max_iterations))
    }

    fn rotation(&self) -> Option<Matrix3<f64>> {
        let threshold = self.transfer_threshold();
        let mut estimator = RotationSearch::new(&self.pairs, threshold);
        let found = search(&mut estimator, &self.search(Local::Improve, 0, ROTATION_ITERATIONS))?;
        let again = fit_rotation(&self.pairs, &found.model, threshold * threshold);
        Some(again.unwrap_or(found.model))
    }

    /// The transfer error in B holds the noise of both points.
    fn transfer_threshold(&self) -> f64 {
        std::f64::consts::SQRT_2 * self.options.threshold
    }

    /// The motion of the search's model, polished as far as the options ask, and its rival.
    fn refined(
        &self,
        found: &Matrix3<f64>,
        rotation: Option<&Matrix3<f64>>,
        plane: Option<&Matrix3<f64>>,
    ) -> (Motion, Option<Motion>) {
        let pairs = &self.pairs;
        let RelativeOptions { threshold, least_noise, .. } = *self.options;
        let start = match self.options.refinement {
            Refinement::None => motions_of_essential(found)[0],
            Refinement::Local => hypotheses::refined(pairs, found, threshold, least_noise),
            Refinement::Full => {
                let first = hypotheses::facing(pairs, &motions_of_essential(found)[0], threshold);
                // Strays on the plane's epipolar lines must not choose among the candidates either.
                let judges = Support::new(pairs, &first, plane, threshold).near_plane(pairs);
                let mut all = hypotheses::candidates(&judges, found, rotation, plane, threshold);
                let mut motion = all.remove(0);
                for _ in 0..FINAL_SELECTIONS {
                    let inliers = Support::new(pairs, &motion, plane, threshold).agreeing(pairs);
                    if inliers.len() < MIN_MATCHES {
                        break;
                    }
                    motion = hypotheses::last_rounds(&inliers, motion, threshold, least_noise);
                }
                let motion = hypotheses::facing(pairs, &motion, threshold);
                let rival = hypotheses::rival(&judges, &motion, &all, self.options);
                return (motion, rival);
            }
        };
        (hypotheses::facing(pairs, &start, threshold), None)
    }

    /// Refuses where a rotation explains the matches as well as the motion (or where only a rotation is above chance).
    fn refuse_without_parallax(
        &self,
        motion: Option<&Motion>,
        rotation: &Matrix3<f64>,
        chance: f64,
    ) -> Result<(), CannotSay> {
        let n = self.pairs.len();
        let limit = 2.0 * self.options.threshold * self.options.threshold;
        let residual = match motion {
            Some(motion) => {
                let RelativeOptions { threshold, least_noise, .. } = *self.options;
                without_parallax(&self.pairs, motion, rotation, threshold, least_noise, chance)
            }
            None => {
                let turned =
                    (0..n).filter(|&i| transfer_squared(rotation, &self.pairs.at(i)) < limit).count();
                let by_chance = chance_share(&self.pairs, |pair| transfer_squared(rotation, pair) < limit);
                self.above_chance(turned, 2, 1.0, by_chance).then(|| self.rotation_residual(rotation, limit))
            }
        };
        let Some(residual) = residual else { return Ok(()) };
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
        Err(CannotSay::NoParallax {
            rotation_deg: turn.angle().to_degrees(),
            cam_b_from_cam_a: turn,
            residual,
        })
    }

    fn rotation_residual(&self, rotation: &Matrix3<f64>, limit: f64) -> f64 {
        let near = (0..self.pairs.len())
            .map(|i| transfer_squared(rotation, &self.pairs.at(i)))
            .filter(|s| *s < limit);
        let (sum, count) = near.fold((0.0, 0.0), |(s, c), v| (s + v, c + 1.0));
        (0.25 * sum / f64::max(count, 1.0)).sqrt()
    }

    fn answer(
        &self,
        motion: &Motion,
        rival: Option<Motion>,
        support: &Support<'_>,
        inliers: &Pairs,
        iterations: usize,
    ) -> RelativePose {
        let RelativeOptions { threshold, least_noise, .. } = *self.options;
        let rotation = Rotation3::from_matrix_unchecked(motion.rotation);
        let scale = hypotheses::final_scale(inliers, &motion.essential(), threshold, least_noise);
        let spread = uncertainty(inliers, motion, scale * scale, threshold * threshold);
        RelativePose {
            cam_b_from_cam_a: Rigid3::new(rotation, Point3::from(motion.translation.normalize())),
            rival: rival.map(|other| {
                let rotation = Rotation3::from_matrix_unchecked(other.rotation);
                Rigid3::new(rotation, Point3::from(other.translation.normalize()))
            }),
            inliers: self.matches.iter().map(|m| support.agrees(&[m.a.x, m.a.y, m.b.x, m.b.y])).collect(),
            residual_rms: spread.rms,
            covariance: spread.covariance * self.options.per_evidence.max(1.0),
            plane_share: support.plane_share,
            iterations,
        }
    }
}
