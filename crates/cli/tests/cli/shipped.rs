//! What is scored is what ships: a pair through `evaluate`, and through the files that `reconstruct` wrote of it.

use crate::campaign::with_terrain;
use crate::evaluate::lines;
use crate::program::Place;
use selenograph_evaluate::dataset_source::{Choice, LoadedPair, Source};
use selenograph_evaluate::pair_metrics::{PreparedTruth, Promise, Settings};
use selenograph_geometry::{Point3, Rigid3, Rotation3};
use selenograph_raster::Raster;
use selenograph_raster::codec::npz::{self, Array};
use selenograph_reconstruct::{Fill, PredictedView, Prediction};
use serde_json::Value;
use std::collections::BTreeMap;

/// Numbers agree to what the files' f32 points carry through an alignment.
const TOLERANCE: f64 = 1e-5;

/// Pose and points of a folder that `reconstruct` wrote.
fn written(place: &Place, folder: &str) -> Prediction {
    let arrays = npz::read(&place.path(folder).join("pointmaps.npz")).unwrap();
    let pose = arrays["cam_b_from_cam_a"].to_f64().unwrap();
    let rotation =
        Rotation3::from_matrix_unchecked(selenograph_geometry::Matrix3::from_fn(|i, j| pose[4 * i + j]));
    let origin = Point3::new(pose[3], pose[7], pose[11]);
    Prediction {
        cam_b_from_cam_a: Ok(Rigid3::new(rotation, origin)),
        views: Some(["a", "b"].map(|view| points(&arrays, view))),
    }
}

fn points(arrays: &BTreeMap<String, Array>, view: &str) -> PredictedView {
    let array = |name: &str| &arrays[&format!("{name}_{view}")];
    let numbers = |name: &str| array(name).to_f64().unwrap();
    let &[height, width] = array("conf").shape.as_slice() else { panic!("{:?}", array("conf").shape) };
    let raster = |name: &str| Raster {
        width,
        height,
        data: numbers(name).into_iter().map(|v| v as f32).collect::<Vec<_>>(),
    };
    let xyz = numbers("pts3d");
    let fills = numbers("fill").into_iter().map(|fill| match fill as u8 {
        0 => Fill::Absent,
        1 => Fill::Measured,
        _ => Fill::Completed,
    });
    PredictedView {
        points: Raster {
            width,
            height,
            data: xyz.chunks(3).map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]).collect(),
        },
        confidence: raster("conf"),
        sigma: arrays.contains_key(&format!("sigma_{view}")).then(|| raster("sigma")),
        fill: Raster { width, height, data: fills.collect() },
    }
}

/// Every number below `scored` that is not the same in `shipped`, and how many there are.
fn compare(scored: &Value, shipped: &Value, at: &str, count: &mut usize) {
    match (scored, shipped) {
        (Value::Object(scored), Value::Object(shipped)) => {
            for (key, value) in scored {
                compare(value, &shipped[key], &format!("{at}/{key}"), count);
            }
        }
        (Value::Array(scored), Value::Array(shipped)) => {
            assert_eq!(scored.len(), shipped.len(), "{at}");
            for (k, (x, y)) in scored.iter().zip(shipped).enumerate() {
                compare(x, y, &format!("{at}/{k}"), count);
            }
        }
        (Value::Number(x), Value::Number(y)) => {
            let (x, y) = (x.as_f64().unwrap(), y.as_f64().unwrap());
            // Angles far below the rounding of points have no digits to compare.
            let off = (x - y).abs() / x.abs().max(y.abs()).max(1e-3);
            assert!(off < TOLERANCE, "{at}: evaluate says {x}, the files {y}");
            *count += 1;
        }
        _ => assert_eq!(scored, shipped, "{at}"),
    }
}

#[test]
fn what_is_scored_is_what_ships() {
    let place = with_terrain();
    let campaign = "generate tiny.toml --terrain terrain --out dataset --set nadir.pairs=0 --set dynamic.pairs=0 \
                    --set camera.width_px=160 --set camera.height_px=160";
    place.run(campaign).ok();
    place.run("evaluate dataset -m stereo,mast3r-stereo,fused --limit 1 --out scores -q").ok();
    let source = Source::open(&place.path("dataset"), &Choice::default()).unwrap();
    let pair = LoadedPair::read(&source.entries[0], &source.pixels).unwrap();
    let truth = PreparedTruth::new(&pair.truth, &Settings::default()).unwrap();
    let folder = "dataset/pairs/000/000000";
    let suns = pair.suns_in_cams([0, 0]).map(|sun| sun.unwrap());
    let suns = suns.map(|sun| format!("{},{},{}", sun.x, sun.y, sun.z));
    let suns = format!("--sun-a {} --sun-b {}", suns[0], suns[1]);
    for method in ["stereo", "mast3r-stereo", "fused"] {
        let scored = lines(&place.path(&format!("scores/{method}/metrics.jsonl")));
        let line = format!(
            "reconstruct {folder}/a.l0.png {folder}/b.l0.png --camera-a {folder}/a.camera.json --camera-b {folder}/b.camera.json \
             --method {method} --complete --no-report -q --out {method} {}",
            // In an evaluation shading is a method of its own.
            if method == "fused" { &suns } else { "--shading off" }
        );
        place.run(&line).ok();
        let shipped = truth.measure(&written(&place, method), Promise::Points).unwrap();
        let (scored, shipped) = (&scored[0], serde_json::to_value(&shipped).unwrap());
        let mut count = 0;
        for key in ["rra_deg", "rta_deg", "pose_failed", "overlap", "full"] {
            compare(&scored[key], &shipped[key], &format!("{method}/{key}"), &mut count);
        }
        assert!(count > 100, "{count} numbers were compared");
    }
}
