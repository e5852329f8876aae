//! What the metrics of a pair must keep: perfect scores for the truth, scale-free numbers, and nulls with reasons.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use proptest::prelude::*;
use selenograph_evaluate::pair_metrics::{
    PairMetrics, PreparedTruth, Promise, Region, RegionMetrics, Settings, measure,
};
use selenograph_evaluate::truth::{Precision, TruthPair, TruthView};
use selenograph_geometry::{BodyFixed, Cam, Camera, Point3, Rigid3, Rotation3, Vector3};
use selenograph_pose::relative::CannotSay;
use selenograph_raster::Raster;
use selenograph_reconstruct::{Fill, PredictedView, Prediction};

const WIDTH: usize = 64;
const HEIGHT: usize = 60;

/// f32 points of 10 km, in their own unit: a few parts in 10⁷.
const F32_REL: f64 = 1e-6;
/// The same in metres, with room for the arithmetic of a cross product.
const F32_M: f64 = 0.01;

/// Height over the sphere's tangent at the south pole.
fn height_m(x: f64, y: f64) -> f64 {
    260.0 * (x / 700.0).sin() * (y / 900.0).cos() + 60.0 * (x / 250.0 + 1.0).sin() * (y / 210.0).sin()
}

fn view(position: [f64; 2], turn: [f64; 3]) -> TruthView {
    let camera = Camera::from_fov(WIDTH, HEIGHT, 0.8).unwrap();
    let position = Point3::new(position[0], position[1], -1_747_400.0);
    // Camera Z along the world's: outside the south pole that is straight down.
    let world_from_cam: Rigid3<BodyFixed, Cam> =
        Rigid3::new(Rotation3::from_euler_angles(turn[0], turn[1], turn[2]), position);
    let mut view = TruthView {
        camera,
        world_from_cam,
        depth_z: Raster::filled(WIDTH, HEIGHT, 10_000.0),
        precision: Precision::Float,
    };
    let rays = view.rays_z1();
    view.depth_z.data = rays
        .data
        .iter()
        .map(|ray| {
            let ray = world_from_cam.vector(ray);
            let mut depth_z = 10_000.0;
            for _ in 0..100 {
                let p = position + ray * depth_z;
                depth_z += 0.8 * (-1_737_400.0 - height_m(p.x, p.y) - p.z) / ray.z;
            }
            depth_z as f32
        })
        .collect();
    view
}

fn pair() -> TruthPair {
    TruthPair { views: [view([0.0, 0.0], [0.02, 0.01, 0.3]), view([900.0, 300.0], [0.0, -0.08, 0.9])] }
}

/// The truth as a prediction: in camera A's frame, turned and scaled, with errors along A's axis that `wave_m` sets.
fn prediction(truth: &TruthPair, unit_per_m: f64, turn: [f64; 3], wave_m: f64) -> Prediction {
    let cam_a_from_cam_b = truth.cam_b_from_cam_a().inverse();
    let turn = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
    let views = [0, 1].map(|idx| {
        let points = truth.views[idx].points_in_cam();
        let mut n = 0.0;
        let points = points.map(|p| {
            let p = if idx == 0 { *p } else { cam_a_from_cam_b.point(p) };
            n += 1.0;
            let p = p + Vector3::z() * (wave_m * (0.37f64 * n).sin() * (0.011 * n).cos());
            let p = turn * p.coords * unit_per_m;
            [p.x as f32, p.y as f32, p.z as f32]
        });
        PredictedView {
            confidence: points.map(|p| if p[2].is_finite() { 0.9 } else { 0.0 }),
            sigma: Some(points.map(|_| (wave_m.max(1.0) * unit_per_m) as f32)),
            fill: points.map(|p| if p[2].is_finite() { Fill::Measured } else { Fill::Absent }),
            points,
        }
    });
    let pose = truth.cam_b_from_cam_a();
    let origin = Point3::from(pose.origin().coords * unit_per_m);
    let [w, x, y, z] = pose.quaternion_wxyz();
    Prediction { cam_b_from_cam_a: Ok(Rigid3::from_quaternion(w, x, y, z, origin)), views: Some(views) }
}

fn reasons_are_complete(metrics: &PairMetrics) {
    for region in [&metrics.overlap, &metrics.full] {
        for (key, value) in region.numbers.iter() {
            assert_eq!(value.is_none(), region.missing.contains_key(key), "{key}");
        }
    }
    for (key, value) in metrics.numbers.iter() {
        assert_eq!(value.is_none(), metrics.missing.contains_key(key), "{key}");
    }
}

#[test]
fn the_truth_scores_perfectly_or_its_floor() {
    let truth = pair();
    let metrics =
        measure(&truth, &prediction(&truth, 1.0, [0.0; 3], 0.0), Promise::MetricPoints, &Settings::default())
            .unwrap();
    reasons_are_complete(&metrics);
    assert!(metrics.numbers.rra_deg.unwrap() < 1e-6 && metrics.numbers.rta_deg.unwrap() < 1e-6);
    assert!(metrics.numbers.covisible_share_a.unwrap() > 0.6, "{:?}", metrics.numbers);
    assert!(!metrics.pose_failed && metrics.pose_error_deg() < 1e-6);
    for region in [Region::Overlap, Region::Full] {
        let numbers = &metrics.region(region).numbers;
        let get = |key: &str| numbers.get(key).unwrap_or_else(|| panic!("{key}"));
        for key in ["coverage", "coverage_b", "coverage_measured", "align_inlier_share"] {
            assert_eq!(get(key), 1.0, "{key}");
        }
        for key in
            ["align_scale", "slope_corr_code", "slope_corr_gsd", "slope_corr_normals", "slope_corr_true"]
        {
            assert!((get(key) - 1.0).abs() < 1e-5, "{key} {}", get(key));
        }
        for key in ["ssim_world_z", "ssim_depth_z", "profile_world_z_corr", "profiles_depth_z_corr"] {
            assert!((get(key) - 1.0).abs() < 1e-6, "{key} {}", get(key));
        }
        for key in ["point_error_m", "point_error_unaligned_m", "chamfer_m", "profile_world_z_mae_m"] {
            assert!(get(key) < F32_M, "{key} {}", get(key));
        }
        for key in ["point_error_rel", "point_error_ransac_rel", "depth_z_abs_rel", "depth_z_silog"] {
            assert!(get(key) < F32_REL, "{key} {}", get(key));
        }
        for limit in ["5deg", "10deg", "15deg", "20deg"] {
            assert!(get(&format!("hazard_agree_{limit}")) > 0.999);
        }
        assert_eq!((get("depth_z_delta_1_001"), get("chamfer_floor_m")), (1.0, 0.0));
        // Thinned clouds meet the floor, which is not 0.
        for unit in ["m", "pct_bbox", "pct_depth_z"] {
            let (found, floor) =
                (get(&format!("chamfer_10k_{unit}")), get(&format!("chamfer_10k_floor_{unit}")));
            assert!(floor == 0.0 || (found / floor - 1.0).abs() < 1e-3, "{unit} {found} {floor}");
        }
        assert!(get("point_error_plane_rel") > 1e-3);
    }
    assert!(metrics.full.numbers.ssim_world_z_paper.is_some());
    assert!(metrics.overlap.numbers.ssim_world_z_paper.is_none());
}

#[test]
fn a_thinned_cloud_of_the_truth_scores_its_floor() {
    let truth = pair();
    let settings = Settings { num_sampled: 800, ..Settings::default() };
    let found =
        measure(&truth, &prediction(&truth, 0.001, [0.0; 3], 0.0), Promise::Points, &settings).unwrap().full;
    let (chamfer, floor) = (found.numbers.chamfer_10k_m.unwrap(), found.numbers.chamfer_10k_floor_m.unwrap());
    assert!(floor > 50.0 && (chamfer / floor - 1.0).abs() < 1e-3, "{chamfer} {floor}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn scale_and_turn_of_a_prediction_change_nothing(
        unit_per_m in 1e-5..10.0f64,
        turn in prop::array::uniform3(-3.0..3.0f64),
    ) {
        let truth = pair();
        let prepared = PreparedTruth::new(&truth, &Settings::default()).unwrap();
        let of = |unit_per_m: f64, turn| {
            prepared.measure(&prediction(&truth, unit_per_m, turn, 8.0), Promise::Points).unwrap()
        };
        let (base, moved) = (of(1.0, [0.0; 3]), of(unit_per_m, turn));
        for region in [Region::Overlap, Region::Full] {
            for (key, value) in base.region(region).numbers.iter() {
                // The scale itself is what was changed, and the order of normals' neighbours hangs on the last bits.
                if key.ends_with("_scale") || key.contains("normals") || key.contains("hazard") {
                    continue;
                }
                let other = moved.region(region).numbers.get(key);
                prop_assert_eq!(value.is_some(), other.is_some(), "{}", key);
                if let (Some(value), Some(other)) = (value, other) {
                    prop_assert!((value - other).abs() < 2e-3 * value.abs().max(0.01), "{} {} {}", key, value, other);
                }
            }
        }
    }
}

#[test]
fn no_answers_count_and_the_rest_is_null() {
    let truth = pair();
    let prepared = PreparedTruth::new(&truth, &Settings::default()).unwrap();
    let silent = Prediction {
        cam_b_from_cam_a: Err(CannotSay::TooFewMatches { found: 3, needed: 5 }.into()),
        views: None,
    };
    let metrics = prepared.measure(&silent, Promise::Points).unwrap();
    reasons_are_complete(&metrics);
    assert!(metrics.pose_failed && metrics.pose_error_deg() == f64::INFINITY);
    let numbers = &metrics.overlap.numbers;
    assert_eq!((metrics.numbers.rra_deg, numbers.coverage), (None, Some(0.0)));
    assert_eq!(numbers.point_error_rel, numbers.point_error_plane_rel);
    assert!(numbers.point_error_rel.unwrap() > 0.0 && numbers.slope_corr_gsd.is_none());
    assert!(metrics.overlap.missing["slope_corr_gsd"].contains("3 matches"));
    // A method that promises a pose only is not charged for points.
    let pose_only = prepared.measure(&silent, Promise::Pose).unwrap();
    assert_eq!((pose_only.full.numbers.coverage, pose_only.full.numbers.point_error_rel), (None, None));
    reasons_are_complete(&pose_only);
    // Answers that are all absent, and ten of them.
    let mut sparse = prediction(&truth, 1.0, [0.0; 3], 0.0);
    for (idx, fill) in sparse.views.as_mut().unwrap().iter_mut().flat_map(|v| &mut v.fill.data).enumerate() {
        if idx >= 10 {
            *fill = Fill::Absent;
        }
    }
    let metrics = prepared.measure(&sparse, Promise::Points).unwrap();
    assert_eq!(metrics.full.numbers.point_error_rel, metrics.full.numbers.point_error_plane_rel);
    assert!((metrics.full.numbers.coverage.unwrap() - 10.0 / (WIDTH * HEIGHT) as f64).abs() < 1e-12);
    reasons_are_complete(&metrics);
}

#[test]
fn views_that_do_not_meet_and_truth_that_is_absent() {
    let mut truth = pair();
    truth.views[1] = view([60_000.0, 0.0], [0.0; 3]);
    let prediction_ = prediction(&truth, 1.0, [0.0; 3], 3.0);
    let metrics = measure(&truth, &prediction_, Promise::Points, &Settings::default()).unwrap();
    assert_eq!(metrics.overlap.numbers.num_pixels, Some(0.0));
    assert_eq!(metrics.overlap.numbers.point_error_rel, None);
    assert_eq!(metrics.overlap.missing["point_error_rel"], "no pixel in the region");
    assert!(metrics.full.numbers.point_error_rel.unwrap() < 1e-3);
    reasons_are_complete(&metrics);
    for view in &mut truth.views {
        view.depth_z.data.fill(f32::NAN);
    }
    let metrics = measure(&truth, &prediction_, Promise::Points, &Settings::default()).unwrap();
    assert_eq!((metrics.numbers.bbox_diagonal_m, metrics.full.numbers.num_pixels), (None, Some(0.0)));
    reasons_are_complete(&metrics);
}

#[test]
fn the_papers_rows_are_the_central_ones_of_truth_and_prediction() {
    let truth = pair();
    let prediction_ = prediction(&truth, 0.01, [0.0; 3], 5.0);
    let settings = Settings { central_rows: Some(40), ..Settings::default() };
    let cropped = measure(&truth, &prediction_, Promise::Points, &settings).unwrap();
    assert_eq!(cropped.full.numbers.num_pixels, Some((2 * 40 * WIDTH) as f64));
    // A method that saw the central rows only gives as many.
    let small = truth.central_rows(40).unwrap();
    let mut views = prediction_.views.clone().unwrap();
    for view in &mut views {
        let rows = |r: &Raster<f32>| selenograph_evaluate::truth::crop_rows(r, 10, 40);
        view.points = selenograph_evaluate::truth::crop_rows(&view.points, 10, 40);
        view.fill = selenograph_evaluate::truth::crop_rows(&view.fill, 10, 40);
        (view.confidence, view.sigma) = (rows(&view.confidence), view.sigma.as_ref().map(rows));
    }
    let from_rows = Prediction { views: Some(views), ..prediction_.clone() };
    assert_eq!(measure(&truth, &from_rows, Promise::Points, &settings).unwrap(), cropped);
    assert_eq!(measure(&small, &from_rows, Promise::Points, &Settings::default()).unwrap(), cropped);
    // Fewer rows than the truth are no prediction of it.
    assert!(measure(&truth, &from_rows, Promise::Points, &Settings::default()).is_err());
}

#[test]
fn records_survive_json() {
    let truth = pair();
    let metrics =
        measure(&truth, &prediction(&truth, 0.5, [0.1; 3], 5.0), Promise::Points, &Settings::default())
            .unwrap();
    let text = serde_json::to_string(&metrics).unwrap();
    assert_eq!(serde_json::from_str::<PairMetrics>(&text).unwrap(), metrics);
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(value["rra_deg"].is_number() && value["overlap"]["slope_corr_gsd"].is_number());
    assert!(value["full"]["point_error_unaligned_m"].is_null());
    assert_eq!(serde_json::from_str::<RegionMetrics>("{}").unwrap(), RegionMetrics::default());
}
