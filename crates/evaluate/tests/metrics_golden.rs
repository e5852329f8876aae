//! Every number of a small pair against NumPy, SciPy and scikit-image (`testdata/metrics/make.py`).
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_evaluate::pair_metrics::{Promise, Region, Settings, definitions, measure};
use selenograph_evaluate::ssim;
use selenograph_evaluate::truth::{Precision, TruthPair, TruthView};
use selenograph_geometry::{Cam, CamA, CamB, Camera, Matrix3, PixelConvention, Point3, Rigid3};
use selenograph_raster::Raster;
use selenograph_raster::codec::npz::{self, Array};
use selenograph_reconstruct::{Fill, PredictedView, Prediction};
use std::collections::BTreeMap;
use std::path::Path;

/// Both sides compute in f64 from the same f32 inputs; sums run in another order.
const RELATIVE: f64 = 1e-6;

/// Keys that hang on random draws, on half floats or on what this pair has not.
const NOT_COMPARED: [&str; 5] = ["_10k", "ransac", "_ceiling", "_floor", "unaligned"];

type Arrays = BTreeMap<String, Array>;

fn numbers(arrays: &Arrays, name: &str) -> Vec<f64> {
    arrays[name].to_f64().unwrap()
}

fn raster(arrays: &Arrays, name: &str) -> Raster<f32> {
    let shape = &arrays[name].shape;
    let data = numbers(arrays, name).iter().map(|v| *v as f32).collect();
    Raster::new(shape[1], shape[0], data).unwrap()
}

fn rigid<To: selenograph_geometry::Frame, From: selenograph_geometry::Frame>(
    arrays: &Arrays,
    name: &str,
) -> Rigid3<To, From> {
    let m = numbers(arrays, name);
    let rotation = Matrix3::from_fn(|i, j| m[4 * i + j]);
    Rigid3::from_matrix(&rotation, Point3::new(m[3], m[7], m[11])).unwrap()
}

fn truth_view(arrays: &Arrays, view: &str) -> TruthView {
    let depth_z = raster(arrays, &format!("depth_z_{view}"));
    let k = Matrix3::from_row_slice(&numbers(arrays, "k"));
    let camera = Camera::from_k(depth_z.width, depth_z.height, &k, PixelConvention::Corner).unwrap();
    let precision = Precision::of(&depth_z);
    let world_from_cam = rigid::<_, Cam>(arrays, &format!("world_from_cam_{view}"));
    TruthView { camera, world_from_cam, depth_z, precision }
}

fn predicted_view(arrays: &Arrays, view: &str) -> PredictedView {
    let points = numbers(arrays, &format!("points_{view}"));
    let confidence = raster(arrays, &format!("confidence_{view}"));
    let points = points.chunks_exact(3).map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]).collect();
    let unit = numbers(arrays, "unit")[0] as f32;
    PredictedView {
        points: Raster::new(confidence.width, confidence.height, points).unwrap(),
        confidence: confidence.map(|level| level / 255.0),
        sigma: Some(raster(arrays, &format!("sigma_{view}")).map(|steps| steps * unit)),
        fill: raster(arrays, &format!("fill_{view}")).map(|kind| match *kind as u8 {
            0 => Fill::Absent,
            1 => Fill::Measured,
            _ => Fill::Completed,
        }),
    }
}

fn close(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= RELATIVE * expected.abs().max(1.0)
}

#[test]
fn every_number_is_that_of_independent_programs() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/metrics");
    let arrays: Arrays = npz::read(&folder.join("pair.npz")).unwrap().into_iter().collect();
    let text = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    let truth = TruthPair { views: ["a", "b"].map(|view| truth_view(&arrays, view)) };
    let prediction = Prediction {
        cam_b_from_cam_a: Ok(rigid::<CamB, CamA>(&arrays, "cam_b_from_cam_a")),
        views: Some(["a", "b"].map(|view| predicted_view(&arrays, view))),
    };
    let settings = Settings { normals_stride: 1, ..Settings::default() };
    let metrics = measure(&truth, &prediction, Promise::Points, &settings).unwrap();

    let mut wrong = Vec::new();
    let mut num_compared = 0;
    let mut compare = |place: &str, key: &str, found: Option<f64>, expected: &serde_json::Value| {
        if NOT_COMPARED.iter().any(|part| key.contains(part)) || key.ends_with("_paper") {
            return;
        }
        num_compared += 1;
        match (found, expected.as_f64()) {
            (Some(found), Some(expected)) if close(found, expected) => {}
            other => wrong.push(format!("{place}{key}: {other:?}")),
        }
    };
    for (key, found) in metrics.numbers.iter() {
        compare("", key, found, &expected[key]);
    }
    for (place, region) in [("overlap", Region::Overlap), ("full", Region::Full)] {
        for (key, found) in metrics.region(region).numbers.iter() {
            compare(&format!("{place}."), key, found, &expected[place][key]);
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(num_compared > 120, "{num_compared} of {} keys", definitions().count());

    let whole = |name: &str| raster(&arrays, name).map(|v| f64::from(*v));
    let found = ssim(&whole("whole_found"), &whole("whole_truth")).unwrap();
    assert!(close(found, expected["ssim_whole"].as_f64().unwrap()), "{found}");
}
