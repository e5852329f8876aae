//! Ceilings and floors of the sample pairs, against those measured by other programs.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_dataset::stored::{self, ReadOptions};
use selenograph_evaluate::pair_metrics::{PreparedTruth, Promise, Settings};
use selenograph_evaluate::truth::{Precision, TruthPair};
use selenograph_raster::Raster;
use selenograph_reconstruct::{Fill, PredictedView, Prediction};
use std::path::{Path, PathBuf};

fn shared() -> PathBuf {
    std::env::var_os("SELENOGRAPH_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"), PathBuf::from)
}

/// The stored truth as a prediction.
fn truth_itself(truth: &TruthPair) -> Prediction {
    let cam_a_from_cam_b = truth.cam_b_from_cam_a().inverse();
    let views = [0, 1].map(|idx| {
        let points = truth.views[idx].points_in_cam().map(|p| {
            let p = if idx == 0 { *p } else { cam_a_from_cam_b.point(p) };
            [p.x as f32, p.y as f32, p.z as f32]
        });
        PredictedView {
            confidence: Raster::filled(points.width, points.height, 1.0),
            sigma: Some(Raster::filled(points.width, points.height, 10.0)),
            fill: points.map(|p| if p[2].is_finite() { Fill::Measured } else { Fill::Absent }),
            points,
        }
    });
    Prediction { cam_b_from_cam_a: Ok(truth.cam_b_from_cam_a()), views: Some(views) }
}

#[test]
fn shared_sample_pairs_have_their_ceilings_and_floors() {
    let root = shared().join("data/stereolunar");
    let mut num_compared = 0;
    for stored in stored::find(&root, ReadOptions::default()).unwrap_or_default() {
        let pair = stored.open().unwrap().stereo().unwrap();
        let truth = TruthPair::from_stereo_pair(&pair);
        assert!(truth.views.iter().all(|view| view.precision == Precision::Half));
        let prepared = PreparedTruth::new(&truth, &Settings::paper()).unwrap();
        let metrics = prepared.measure(&truth_itself(&truth), Promise::MetricPoints).unwrap();
        let full = &metrics.full.numbers;
        // `protocol.md` §d.6 over 18 views: 0.46-0.70, 0.85-0.98 and (3 views) 0.987-0.995.
        let ceilings =
            [full.slope_corr_code_ceiling, full.slope_corr_gsd_ceiling, full.slope_corr_normals_ceiling];
        let ceilings = ceilings.map(Option::unwrap);
        for (found, (low, high)) in ceilings.into_iter().zip([(0.42, 0.74), (0.83, 0.99), (0.97, 0.999)]) {
            assert!(found > low && found < high, "{} {ceilings:?}", stored.name);
        }
        // The floor of 10 000 points: 118 m on a nadir pair to 195 m on a dynamic one, 0.36-0.47 % of the distance.
        let floor = full.chamfer_10k_floor_pct_depth_z.unwrap();
        assert!(floor > 0.3 && floor < 0.6, "{} {floor}", stored.name);
        assert!((full.chamfer_10k_m.unwrap() / full.chamfer_10k_floor_m.unwrap() - 1.0).abs() < 1e-3);
        assert!(full.point_error_unaligned_m.unwrap() < 0.05 && full.chamfer_m.unwrap() < 0.05);
        println!(
            "{}: covisible {:.3} {:.3}, ceilings {ceilings:?} true {:?}, floor {:?} m, plane {:?}",
            stored.name,
            metrics.numbers.covisible_share_a.unwrap(),
            metrics.numbers.covisible_share_b.unwrap(),
            full.slope_corr_true_ceiling,
            full.chamfer_10k_floor_m,
            full.point_error_plane_rel,
        );
        num_compared += 1;
    }
    if num_compared == 0 {
        println!("SKIP shared-data: no sample pairs in {}", root.display());
    } else {
        println!(
            "RAN shared-data: shared_sample_pairs_have_their_ceilings_and_floors ({num_compared} pairs)"
        );
    }
}
