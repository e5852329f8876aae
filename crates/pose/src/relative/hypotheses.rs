//! Starts of the refinement, and the choice among what they lead to.

use super::options::RelativeOptions;
use crate::cheirality::{in_front, most_in_front};
use crate::consensus::HomographySearch;
use crate::decompose::{Motion, motions_of_essential, motions_of_homography};
use crate::points::Pairs;
use crate::ransac::{Estimator, Local, Score, Search, search};
use crate::refine::{Loss, refine, robust_sigma};
use crate::sampson;
use crate::solvers::homography_4pt::transfer_squared;
use selenograph_geometry::{Matrix3, SymmetricEigen, Vector3};

/// Matches that a start is judged by; all take part in the last refinement.
const MAX_TRIAL: usize = 800;
/// Steps of a trial: from any of the starts the cost has settled by then.
const TRIAL_STEPS: usize = 8;
/// Steps of the last refinement, for each of its rounds.
const FINAL_STEPS: usize = 10;
/// Rounds of the last refinement: the inliers and the scale are chosen anew before each.
const FINAL_ROUNDS: usize = 3;
/// Cauchy's constant for 95 % efficiency on normal noise.
const CAUCHY: f64 = 2.385;
/// Matches that vote on the signs of a motion.
const VOTERS: usize = 200;
/// Two motions are different if their directions are 5° apart, and as good if their costs differ by fewer sigmas than this.
const RIVAL_COSINE: f64 = 0.996_194_698_091_745_5;
const RIVAL_SIGMAS: f64 = 3.0;
/// The dominant plane is looked for among this many inliers, with this many samples.
const PLANE_MATCHES: usize = 600;
const PLANE_ITERATIONS: usize = 60;

/// Scale of the last loss: from the spread of the inliers, not below a hundredth of the threshold nor below what matches are off
/// by at least: of whole pixels many agree exactly with some motion, which would draw it to itself.
pub fn final_scale(pairs: &Pairs, e: &Matrix3<f64>, threshold: f64, least_noise: f64) -> f64 {
    let least = (CAUCHY * least_noise).max(0.01 * threshold).min(threshold);
    (CAUCHY * robust_sigma(pairs, e, threshold)).clamp(least, threshold)
}

/// Refines from one start: first with the threshold as the scale, then with the scale of the inliers' own spread.
pub fn refined(pairs: &Pairs, start: &Matrix3<f64>, threshold: f64, least_noise: f64) -> Motion {
    let limit = threshold * threshold;
    let [motion, ..] = motions_of_essential(start);
    let wide = Loss::Cauchy { scale_squared: limit, cutoff_squared: 9.0 * limit };
    last_rounds(pairs, refine(pairs, &motion, wide, FINAL_STEPS).motion, threshold, least_noise)
}

/// The last refinement, over the matches within the threshold.
pub fn last_rounds(pairs: &Pairs, motion: Motion, threshold: f64, least_noise: f64) -> Motion {
    let mut motion = motion;
    for _ in 0..FINAL_ROUNDS {
        let scale = final_scale(pairs, &motion.essential(), threshold, least_noise);
        let loss = Loss::Cauchy { scale_squared: scale * scale, cutoff_squared: threshold * threshold };
        let next = refine(pairs, &motion, loss, FINAL_STEPS);
        motion = next.motion;
        if next.steps <= 1 {
            break;
        }
    }
    motion
}

/// Refines from the search's model, from the motions of the dominant plane and from the best rotation; the best by its cost over all
/// matches comes first. [`last_rounds`] is still to come.
pub fn candidates(
    pairs: &Pairs,
    found: &Matrix3<f64>,
    rotation: Option<&Matrix3<f64>>,
    plane: Option<&Matrix3<f64>>,
    threshold: f64,
) -> Vec<Motion> {
    let limit = threshold * threshold;
    let mut starts = vec![motions_of_essential(found)[0]];
    if let Some(plane) = plane {
        starts.extend(motions_of_homography(plane).into_iter().flatten().map(|m| m.motion));
    }
    starts.extend(rotation.and_then(|rotation| with_best_direction(pairs, rotation, found, threshold)));
    let trial = Pairs::new((0..pairs.len().min(MAX_TRIAL)).map(|i| pairs.at(i)));
    let loss = Loss::Cauchy { scale_squared: limit, cutoff_squared: f64::INFINITY };
    let mut judged: Vec<(f64, Motion)> = starts
        .iter()
        .filter(|start| start.translation.norm() > 0.0)
        .map(|start| facing(pairs, &refine(&trial, start, loss, TRIAL_STEPS).motion, threshold))
        .map(|motion| (cost_in_front(pairs, &motion, limit), motion))
        .collect();
    judged.sort_by(|p, q| p.0.total_cmp(&q.0));
    judged.into_iter().map(|(_, motion)| motion).collect()
}

/// The one of the four motions of an essential matrix that has its inliers in front.
pub fn facing(pairs: &Pairs, motion: &Motion, threshold: f64) -> Motion {
    let e = motion.essential();
    let voters = (0..pairs.len())
        .map(|i| (pairs.a(i), pairs.b(i)))
        .filter(|(a, b)| sampson::distance(&e, a, b).abs() < threshold)
        .take(VOTERS);
    most_in_front(&motions_of_essential(&e), voters).0
}

/// `Σ min(r², limit)`, where a match behind a camera counts as an outlier.
fn cost_in_front(pairs: &Pairs, motion: &Motion, limit: f64) -> f64 {
    costs_in_front(pairs, motion, limit).sum()
}

fn costs_in_front(pairs: &Pairs, motion: &Motion, limit: f64) -> impl Iterator<Item = f64> {
    let e = motion.essential();
    (0..pairs.len()).map(move |i| {
        let (a, b) = (pairs.a(i), pairs.b(i));
        let squared = sampson::distance(&e, &a, &b).powi(2);
        if squared < limit && in_front_or_far(motion, &a, &b, limit) { squared } else { limit }
    })
}

/// True where a match is in front, or so near infinity that noise alone may put it behind.
pub fn in_front_or_far(motion: &Motion, a: &Vector3<f64>, b: &Vector3<f64>, limit: f64) -> bool {
    in_front(motion, a, b) || transfer_squared(&motion.rotation, &[a.x, a.y, b.x, b.y]) < 2.0 * limit
}

/// Another motion that explains the matches as well as the chosen one: a plane allows two.
///
/// The two look at different components of the same noise, so that their costs differ by chance even where both are true; the sum of the
/// paired differences is compared with its own spread.
/// # Source
/// Vuong 1989, "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 57(2).
pub fn rival(pairs: &Pairs, chosen: &Motion, others: &[Motion], options: &RelativeOptions) -> Option<Motion> {
    let RelativeOptions { threshold, least_noise, per_evidence, .. } = *options;
    let limit = threshold * threshold;
    let differs = |motion: &Motion| motion.translation.normalize().dot(&chosen.translation) < RIVAL_COSINE;
    let equals = |motion: &Motion, sigmas: f64| {
        let pairwise = costs_in_front(pairs, motion, limit).zip(costs_in_front(pairs, chosen, limit));
        let (sum, squares) = pairwise.fold((0.0, 0.0), |(s, q), (p, c)| (s + (p - c), q + (p - c) * (p - c)));
        sum < sigmas * f64::sqrt(squares * per_evidence.max(1.0))
    };
    // Most are out of the question before they are refined.
    let possible = |motion: &&Motion| differs(motion) && equals(motion, 3.0 * RIVAL_SIGMAS);
    others.iter().filter(possible).find_map(|motion| {
        let refined = facing(pairs, &last_rounds(pairs, *motion, threshold, least_noise), threshold);
        (differs(&refined) && equals(&refined, RIVAL_SIGMAS)).then_some(refined)
    })
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
