//! Robust estimates of cameras and similarities, covariances by repetition, and frames that do not matter.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use proptest::prelude::*;
use selenograph_geometry::{Enu, Point2, Point3, PredA, Rotation3, Vector3};
use selenograph_pose::absolute::{self, AbsoluteOptions, CannotLocate};
use selenograph_pose::problems::{Clouds, Resection, Scene, SceneKind, angle_of};
use selenograph_pose::relative::{Match, RelativeOptions, estimate};
use selenograph_pose::sampson::tangent_axes;
use selenograph_pose::similarity::{self, CannotAlign, SimilarityOptions, trimmed};

const FOCAL: f64 = 618.0;
/// Predicted and seen spread may differ by this factor: 200 repetitions leave 5 %, linearisation and the choice of inliers the rest.
const SPREAD_FACTOR: f64 = 1.25;

fn rotation_vector(of: &selenograph_geometry::Matrix3<f64>) -> Vector3<f64> {
    Rotation3::from_matrix_unchecked(*of).scaled_axis()
}

#[test]
fn the_covariance_of_a_relative_pose_is_the_spread_of_its_repetitions() {
    for kind in [SceneKind::General, SceneKind::Nadir { relief_parallax: 3.0 / FOCAL }] {
        let (mut seen, mut predicted) = ([0.0; 5], [0.0; 5]);
        let clean = Scene::new(&kind, 400, 3);
        let truth = clean.motion();
        let axes = tangent_axes(&truth.translation);
        for seed in 0..200 {
            let mut random = selenograph_pose::random::Random::new(1000 + seed);
            let mut noisy = |p: Point2<f64>| {
                Point2::new(p.x + 0.3 / FOCAL * random.normal(), p.y + 0.3 / FOCAL * random.normal())
            };
            let matches: Vec<Match> =
                clean.matches.iter().map(|m| Match { a: noisy(m.a), b: noisy(m.b), score: 1.0 }).collect();
            let options = RelativeOptions { threshold: 1.5 / FOCAL, seed, ..RelativeOptions::default() };
            let found = estimate(&matches, &options).unwrap();
            let turn = rotation_vector(&(found.cam_b_from_cam_a.rotation() * truth.rotation.transpose()));
            let t = found.cam_b_from_cam_a.origin().coords;
            let error = [turn.x, turn.y, turn.z, axes[0].dot(&t), axes[1].dot(&t)];
            for k in 0..5 {
                seen[k] += error[k] * error[k] / 200.0;
                predicted[k] += found.covariance[(k, k)] / 200.0;
            }
        }
        for k in 0..5 {
            let ratio = (seen[k] / predicted[k]).sqrt();
            assert!(ratio < SPREAD_FACTOR && ratio > 1.0 / SPREAD_FACTOR, "{kind:?} {k}: {ratio}");
        }
    }
}

#[test]
fn cameras_are_found_among_outliers() {
    for seed in 0..20 {
        let problem = Resection::new(500, 0.5 / FOCAL, 0.5, seed);
        let options = AbsoluteOptions { seed, ..AbsoluteOptions::default() };
        let found = absolute::estimate::<Enu>(&problem.sightings, &options).unwrap();
        let turn = angle_of(&(found.cam_from_world.rotation() * problem.truth.rotation().transpose()));
        assert!(
            turn < 1e-3 && (found.cam_from_world.origin() - problem.truth.origin()).norm() < 5e-3,
            "{seed}: {turn}"
        );
        assert!(found.inliers[..250].iter().filter(|i| **i).count() < 10);
    }
    let noise = Resection::new(300, 0.0, 1.0, 1);
    let found = absolute::estimate::<Enu>(
        &noise.sightings,
        &AbsoluteOptions { max_iterations: 2000, ..Default::default() },
    );
    assert!(matches!(found, Err(CannotLocate::NoConsensus { .. })));
    let found = absolute::estimate::<Enu>(&noise.sightings[..4], &AbsoluteOptions::default());
    assert!(matches!(found, Err(CannotLocate::TooFewPoints { found: 4, .. })));
}

#[test]
fn the_covariance_of_a_camera_is_the_spread_of_its_repetitions() {
    let clean = Resection::new(100, 0.0, 0.0, 5);
    let (mut seen, mut predicted) = ([0.0; 6], [0.0; 6]);
    for seed in 0..200 {
        let mut random = selenograph_pose::random::Random::new(seed);
        let mut sightings = clean.sightings.clone();
        for s in &mut sightings {
            s.image.x += 0.5 / FOCAL * random.normal();
            s.image.y += 0.5 / FOCAL * random.normal();
        }
        let found = absolute::estimate::<Enu>(&sightings, &AbsoluteOptions::default()).unwrap();
        let turn = rotation_vector(&(found.cam_from_world.rotation() * clean.truth.rotation().transpose()));
        let shift = found.cam_from_world.origin() - clean.truth.origin();
        for k in 0..3 {
            seen[k] += turn[k] * turn[k] / 200.0;
            seen[3 + k] += shift[k] * shift[k] / 200.0;
        }
        for (k, p) in predicted.iter_mut().enumerate() {
            *p += found.covariance[(k, k)] / 200.0;
        }
    }
    for k in 0..6 {
        let ratio = (seen[k] / predicted[k]).sqrt();
        assert!(ratio < SPREAD_FACTOR && ratio > 1.0 / SPREAD_FACTOR, "{k}: {ratio}");
    }
}

#[test]
fn clouds_are_aligned_among_outliers() {
    for (num, outliers) in [(200, 0.3), (5000, 0.45), (100_000, 0.45)] {
        let clouds = Clouds::new(num, 0.01, outliers, num as u64);
        let found =
            similarity::estimate::<Enu, PredA>(&clouds.from, &clouds.to, &SimilarityOptions::default())
                .unwrap();
        // The noise averages out over the inliers; five sigma on coordinates of unit size.
        let bound = 5.0 * 0.01 * 3.5 / (num as f64 * (1.0 - outliers)).sqrt();
        assert!((found.to_from.scale() - clouds.truth.scale()).abs() < bound, "{num}");
        assert!(angle_of(&(found.to_from.rotation() * clouds.truth.rotation().transpose())) < bound);
        assert!((found.inlier_share - (1.0 - outliers)).abs() < 0.06, "{num}: {}", found.inlier_share);
        let given = SimilarityOptions { threshold: Some(0.04), ..SimilarityOptions::default() };
        let found = similarity::estimate::<Enu, PredA>(&clouds.from, &clouds.to, &given).unwrap();
        assert!((found.to_from.scale() - clouds.truth.scale()).abs() < bound, "{num}");
    }
}

#[test]
fn trimming_bears_few_outliers_and_says_what_it_kept() {
    let clouds = Clouds::new(20_000, 0.01, 0.05, 1);
    let found = trimmed::<Enu, PredA>(&clouds.from, &clouds.to, 2).unwrap();
    assert!((found.to_from.scale() / clouds.truth.scale() - 1.0).abs() < 2e-3);
    assert!(found.inlier_share > 0.9 && found.num_pairs == 20_000);
    let exact = Clouds::new(100, 0.0, 0.0, 2);
    let found = trimmed::<Enu, PredA>(&exact.from, &exact.to, 2).unwrap();
    assert!(found.residual_rms < 1e-9 && found.inlier_share > 0.1);
    let few = trimmed::<Enu, PredA>(&exact.from[..2], &exact.to[..2], 2);
    assert!(matches!(few, Err(CannotAlign::TooFewPairs { found: 2 })));
    let line: Vec<_> = (0..9).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect();
    assert!(matches!(trimmed::<Enu, PredA>(&line, &line, 2), Err(CannotAlign::Degenerate)));
    let holes = [vec![Point3::new(f64::NAN, 0.0, 0.0)], exact.from.clone()].concat();
    let to = [vec![Point3::origin()], exact.to.clone()].concat();
    assert_eq!(
        similarity::estimate::<Enu, PredA>(&holes, &to, &SimilarityOptions::default()).unwrap().num_pairs,
        100
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Rolling a camera about its axis turns the answer with it and leaves the errors as they were.
    #[test]
    fn turning_a_camera_turns_the_answer(seed in 0_u64..1000, roll in -3.1_f64..3.1) {
        let scene = Scene::new(&SceneKind::General, 200, seed).with_noise(0.3 / FOCAL).with_outliers(0.2);
        let turn = Rotation3::new(Vector3::z() * roll);
        let turned: Vec<Match> = scene.matches.iter().map(|m| {
            let b = turn * Vector3::new(m.b.x, m.b.y, 1.0);
            Match { b: Point2::new(b.x, b.y), ..*m }
        }).collect();
        let options = RelativeOptions { threshold: 1.0 / FOCAL, ..RelativeOptions::default() };
        let plain = estimate(&scene.matches, &options).unwrap();
        let rolled = estimate(&turned, &options).unwrap();
        let back = turn.inverse().matrix() * rolled.cam_b_from_cam_a.rotation();
        // Rounding may change which samples win, but not the optimum that the refinement reaches.
        prop_assert!(angle_of(&(back * plain.cam_b_from_cam_a.rotation().transpose())) < 1e-4);
        let t = turn.inverse() * rolled.cam_b_from_cam_a.origin().coords;
        prop_assert!((t - plain.cam_b_from_cam_a.origin().coords).norm() < 1e-3);
    }

    /// Exchanging the views inverts the answer.
    #[test]
    fn exchanging_the_views_inverts_the_answer(seed in 0_u64..1000) {
        let scene = Scene::new(&SceneKind::General, 200, seed).with_noise(0.3 / FOCAL);
        let swapped: Vec<Match> = scene.matches.iter().map(|m| Match { a: m.b, b: m.a, score: m.score }).collect();
        let options = RelativeOptions { threshold: 1.5 / FOCAL, ..RelativeOptions::default() };
        let plain = estimate(&scene.matches, &options).unwrap();
        let back = estimate(&swapped, &options).unwrap().cam_b_from_cam_a.inverse();
        prop_assert!(angle_of(&(back.rotation() * plain.cam_b_from_cam_a.rotation().transpose())) < 1e-4);
        prop_assert!((back.origin().coords - plain.cam_b_from_cam_a.origin().coords).norm() < 1e-3);
    }
}
