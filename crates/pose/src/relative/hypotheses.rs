//! Starts of the refinement, and the choice among what they lead to.

use crate::consensus::HomographySearch;
use crate::decompose::{Motion, motions_of_essential, motions_of_homography};
use crate::points::Pairs;
use crate::ransac::{Estimator, Local, Score, Search, search};
use crate::refine::{Loss, refine, robust_sigma};
use crate::sampson;
use nalgebra::{Matrix3, SymmetricEigen};

/// Matches that a start is judged by; all take part in the last refinement.
const MAX_TRIAL: usize = 1000;
/// Steps of a trial: from any of the starts the cost has settled by then.
const TRIAL_STEPS: usize = 8;
/// Steps of the last refinement, for each of its rounds.
const FINAL_STEPS: usize = 10;
/// Rounds of the last refinement: the inliers and the scale are chosen anew before each.
const FINAL_ROUNDS: usize = 3;
/// Cauchy's constant for 95 % efficiency on normal noise.
const CAUCHY: f64 = 2.385;
/// The dominant plane is looked for among this many inliers, with this many samples.
const PLANE_MATCHES: usize = 600;
const PLANE_ITERATIONS: usize = 60;

/// Scale of the last loss: from the spread of the inliers, not below a hundredth of the threshold.
pub fn final_scale(pairs: &Pairs, e: &Matrix3<f64>, threshold: f64) -> f64 {
    (CAUCHY * robust_sigma(pairs, e, threshold)).clamp(0.01 * threshold, threshold)
}

/// Refines from one start: first with the threshold as the scale, then with the scale of the inliers' own spread.
pub fn refined(pairs: &Pairs, start: &Matrix3<f64>, threshold: f64) -> Motion {
    let limit = threshold * threshold;
    let [motion, ..] = motions_of_essential(start);
    let wide = Loss::Cauchy { scale_squared: limit, cutoff_squared: 9.0 * limit };
    last_rounds(pairs, refine(pairs, &motion, wide, FINAL_STEPS).motion, threshold)
}

/// The last refinement, over the matches within the threshold.
pub fn last_rounds(pairs: &Pairs, motion: Motion, threshold: f64) -> Motion {
    let mut motion = motion;
    for _ in 0..FINAL_ROUNDS {
        let scale = final_scale(pairs, &motion.essential(), threshold);
        let loss = Loss::Cauchy { scale_squared: scale * scale, cutoff_squared: threshold * threshold };
        let next = refine(pairs, &motion, loss, FINAL_STEPS);
        motion = next.motion;
        if next.steps <= 1 {
            break;
        }
    }
    motion
}

/// Refines from the search's model, from the motions of the dominant plane and from the best rotation, and keeps the best by the truncated cost
/// over all matches. [`last_rounds`] is still to come.
pub fn best(
    pairs: &Pairs,
    found: &Matrix3<f64>,
    rotation: Option<&Matrix3<f64>>,
    plane: Option<&Matrix3<f64>>,
    threshold: f64,
) -> Motion {
    let limit = threshold * threshold;
    let mut starts = vec![motions_of_essential(found)[0]];
    if let Some(plane) = plane {
        starts.extend(motions_of_homography(plane).into_iter().flatten().map(|m| m.motion));
    }
    starts.extend(rotation.and_then(|rotation| with_best_direction(pairs, rotation, found, threshold)));
    let trial = Pairs::new((0..pairs.len().min(MAX_TRIAL)).map(|i| pairs.at(i)));
    let loss = Loss::Cauchy { scale_squared: limit, cutoff_squared: f64::INFINITY };
    let mut best = (f64::INFINITY, starts[0]);
    for start in &starts {
        if start.translation.norm() <= 0.0 {
            continue;
        }
        let motion = refine(&trial, start, loss, TRIAL_STEPS).motion;
        let cost = truncated_cost(pairs, &motion.essential(), limit);
        if cost < best.0 {
            best = (cost, motion);
        }
    }
    best.1
}

/// `Σ min(r², limit)` in f64.
pub fn truncated_cost(pairs: &Pairs, e: &Matrix3<f64>, limit: f64) -> f64 {
    (0..pairs.len()).map(|i| sampson::distance(e, &pairs.a(i), &pairs.b(i)).powi(2).min(limit)).sum()
}

/// The direction that suits a rotation: perpendicular to every `b × R a`, which lie in the epipolar planes' normals.
fn with_best_direction(
    pairs: &Pairs,
    rotation: &Matrix3<f64>,
    found: &Matrix3<f64>,
    threshold: f64,
) -> Option<Motion> {
    let mut sum = Matrix3::zeros();
    for i in 0..pairs.len() {
        let (a, b) = (pairs.a(i), pairs.b(i));
        if sampson::distance(found, &a, &b).abs() < threshold {
            let normal = b.cross(&(rotation * a));
            sum += normal * normal.transpose();
        }
    }
    let eigen = SymmetricEigen::try_new(sum, f64::EPSILON, 100)?;
    let translation = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    Some(Motion { rotation: *rotation, translation })
}

fn inliers(pairs: &Pairs, e: &Matrix3<f64>, threshold: f64) -> Pairs {
    let near = |i: &usize| sampson::distance(e, &pairs.a(*i), &pairs.b(*i)).abs() < threshold;
    Pairs::new((0..pairs.len()).filter(near).take(PLANE_MATCHES).map(|i| pairs.at(i)))
}

/// The homography that explains most of the inliers of an essential matrix.
pub fn dominant_plane(pairs: &Pairs, e: &Matrix3<f64>, threshold: f64, seed: u64) -> Option<Matrix3<f64>> {
    homography_of(&inliers(pairs, e, threshold), threshold, seed)
}

fn homography_of(near: &Pairs, threshold: f64, seed: u64) -> Option<Matrix3<f64>> {
    let mut estimator = HomographySearch::new(near, std::f64::consts::SQRT_2 * threshold);
    let settings = Search {
        seed,
        confidence: 0.99,
        min_iterations: 10,
        max_iterations: PLANE_ITERATIONS,
        local: Local::Improve,
        order: None,
    };
    let found = search(&mut estimator, &settings)?;
    let fitted = estimator.fit(&found.model, usize::MAX)?;
    let better = estimator.score(&fitted, &Score::WORST)?.cost < found.score.cost;
    Some(if better { fitted } else { found.model })
}
