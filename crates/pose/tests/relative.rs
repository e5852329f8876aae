//! The front of the two-view estimate, on scenes whose truth is known.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_pose::problems::{Scene, SceneKind};
use selenograph_pose::relative::{CannotSay, Match, Order, Refinement, RelativeOptions, estimate};

const FOCAL: f64 = 618.0;

fn options(seed: u64) -> RelativeOptions {
    RelativeOptions { threshold: 1.0 / FOCAL, seed, ..RelativeOptions::default() }
}

fn errors_deg(scene: &Scene, options: &RelativeOptions) -> (f64, f64) {
    let found = estimate(&scene.matches, options).unwrap();
    let rotation = scene.rotation_error_rad(&found.cam_b_from_cam_a).to_degrees();
    (rotation, scene.direction_error_rad(&found.cam_b_from_cam_a).to_degrees())
}

#[test]
fn without_noise_the_truth_comes_back() {
    for kind in [SceneKind::General, SceneKind::Nadir { relief_parallax: 5.0 / FOCAL }] {
        for seed in 0..10 {
            let scene = Scene::new(&kind, 300, seed);
            let (rotation, direction) = errors_deg(&scene, &options(seed));
            // The loss has a floor at a hundredth of the threshold; without noise the minimum is exact all the same.
            assert!(rotation < 1e-5 && direction < 1e-4, "{kind:?} {seed}: {rotation} {direction}");
        }
    }
}

#[test]
fn noise_and_outliers_are_borne() {
    for seed in 0..20 {
        let scene = Scene::new(&SceneKind::General, 1000, seed).with_noise(0.3 / FOCAL).with_outliers(0.5);
        let (rotation, direction) = errors_deg(&scene, &options(seed));
        assert!(rotation < 0.1 && direction < 0.6, "{seed}: {rotation} {direction}");
    }
}

/// The mechanism behind weak nadir poses: relief parallax of 0.9 px, whole-pixel matches.
#[test]
fn nearly_planar_ground_needs_all_inliers() {
    let mut poor = 0;
    for seed in 0..12 {
        let scene = Scene::new(&SceneKind::Nadir { relief_parallax: 0.9 / FOCAL }, 2000, seed)
            .with_rounding(1.0 / FOCAL);
        let (_, full) = errors_deg(&scene, &options(seed));
        assert!(full < 2.0, "{seed}: {full}");
        let plain = RelativeOptions { refinement: Refinement::None, order: Order::Random, ..options(seed) };
        poor += usize::from(errors_deg(&scene, &plain).1 > 2.0);
    }
    assert!(poor >= 6, "plain RANSAC was off by more than 2° in {poor} of 12");
}

#[test]
fn views_without_parallax_give_their_rotation() {
    for seed in 0..10 {
        for outliers in [0.0, 0.4] {
            let scene = Scene::new(&SceneKind::PureRotation, 400, seed)
                .with_noise(0.3 / FOCAL)
                .with_outliers(outliers);
            let found = estimate(&scene.matches, &options(seed));
            let Err(CannotSay::NoParallax { rotation_deg, .. }) = found else {
                panic!("{seed} {outliers}: {found:?}")
            };
            assert!((rotation_deg - scene.truth.rotation_angle_rad().to_degrees()).abs() < 0.1);
        }
        let same = Scene::new(&SceneKind::Identical, 400, seed);
        let found = estimate(&same.matches, &options(seed));
        assert!(
            matches!(found, Err(CannotSay::NoParallax { rotation_deg, .. }) if rotation_deg < 1e-3),
            "{found:?}"
        );
        let noisy = same.with_noise(0.3 / FOCAL).with_outliers(0.2);
        let found = estimate(&noisy.matches, &options(seed));
        assert!(matches!(found, Err(CannotSay::NoParallax { .. })), "{found:?}");
    }
}

#[test]
fn unrelated_matches_are_no_pose() {
    for seed in 0..10 {
        for num in [12, 60, 500, 2000] {
            let scene = Scene::new(&SceneKind::General, num, seed).with_outliers(1.0);
            let found = estimate(&scene.matches, &RelativeOptions { max_iterations: 2000, ..options(seed) });
            assert!(matches!(found, Err(CannotSay::NoConsensus { .. })), "{seed} {num}: {found:?}");
        }
    }
    let few = Scene::new(&SceneKind::General, 7, 1);
    assert!(matches!(estimate(&few.matches, &options(0)), Err(CannotSay::TooFewMatches { found: 7, .. })));
}

#[test]
fn matches_that_are_not_numbers_do_no_harm() {
    let mut scene = Scene::new(&SceneKind::General, 200, 3).with_noise(0.2 / FOCAL);
    for m in scene.matches.iter_mut().step_by(4) {
        *m = Match { a: m.a, b: selenograph_geometry::Point2::new(f64::NAN, 0.0), score: f64::NAN };
    }
    let found = estimate(&scene.matches, &options(0)).unwrap();
    assert!(!found.inliers[0] && found.inliers.iter().filter(|i| **i).count() > 140);
    assert!(scene.direction_error_rad(&found.cam_b_from_cam_a) < 0.02);
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let scene = Scene::new(&SceneKind::General, 800, 5).with_noise(0.3 / FOCAL).with_outliers(0.3);
    let first = estimate(&scene.matches, &options(9)).unwrap();
    let second = estimate(&scene.matches, &options(9)).unwrap();
    assert_eq!(first.cam_b_from_cam_a, second.cam_b_from_cam_a);
    assert_eq!(first.inliers, second.inliers);
}

/// A plane without relief has two motions: where both have it in front, the other one is named.
#[test]
fn the_second_motion_of_a_plane_is_named() {
    let mut named = 0;
    for seed in 0..20 {
        let scene = Scene::new(&SceneKind::Planar, 600, seed).with_noise(0.3 / FOCAL).with_outliers(0.2);
        let found = estimate(&scene.matches, &options(seed)).unwrap();
        assert!(found.plane_share > 0.95, "{seed}: {}", found.plane_share);
        let error = scene.direction_error_rad(&found.cam_b_from_cam_a).to_degrees();
        let other = found.rival.map(|rival| scene.direction_error_rad(&rival).to_degrees());
        named += usize::from(other.is_some());
        assert!(error.min(other.unwrap_or(error)) < 3.0, "{seed}: {error} {other:?}");
    }
    assert!(named > 0 && named < 20, "{named}");
    let relief =
        Scene::new(&SceneKind::Nadir { relief_parallax: 2.0 / FOCAL }, 1000, 1).with_noise(0.3 / FOCAL);
    assert!(estimate(&relief.matches, &options(0)).unwrap().rival.is_none());
}
