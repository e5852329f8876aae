use super::*;
use crate::prediction::PredictedView;
use crate::priors::{KnownLength, Priors};
use crate::relative_pose::JudgedMatch;
use crate::scale::World;
use crate::transform_file;
use crate::{Prediction, View};
use selenograph_geometry::{
    Body, BodyFixed, Camera, Geodetic, Point2, Point3, Rigid3, Vector3, lookat, pixel,
};
use selenograph_raster::codec::npz;
use selenograph_raster::dem::{DemReader, OpenOptions};

/// A gentle surface seen from 30 units, by two cameras beside each other.
fn prediction() -> (Prediction, View) {
    let camera = Camera::from_fov(48, 40, 0.7).unwrap();
    let at = |shift: f64| {
        let points = Raster::from_fn(48, 40, |x, y| {
            let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap();
            let z = 30.0 + 0.3 * (8.0 * ray.x + 3.0 * ray.y).sin();
            (ray * z + Vector3::new(shift, 0.0, 0.0)).map(|v| v as f32).into()
        });
        PredictedView {
            confidence: points.map(|_| 0.9),
            sigma: Some(points.map(|_| 0.02)),
            fill: Raster::from_fn(48, 40, |x, _| if x < 40 { Fill::Measured } else { Fill::Completed }),
            points,
        }
    };
    let cam_b = Rigid3::from_quaternion(1.0, 0.0, 0.0, 0.0, Point3::new(-2.0, 0.0, 0.0));
    let image = Raster::from_fn(48, 40, |x, y| ((x + y) % 10) as f32 / 10.0);
    (Prediction { cam_b_from_cam_a: Ok(cam_b), views: Some([at(0.0), at(2.0)]) }, View { image, camera })
}

fn over_the_moon() -> World {
    let body = Body::moon();
    let above = Geodetic::from_deg(-85.0, 40.0, 3000.0);
    let axes = body.body_from_enu(&above);
    let body_from_cam = lookat::from_forward_and_right::<BodyFixed>(
        body.point(&above),
        &-body.up(&above),
        &axes.vector(&Vector3::x()),
    );
    World::Body { body, body_from_cam_a: body_from_cam.unwrap().relabel() }
}

#[test]
fn every_file_is_there_and_can_be_read() {
    let (prediction, view) = prediction();
    let dir = tempfile::tempdir().unwrap();
    let matches = [JudgedMatch {
        a: Point2::new(1.5, 2.0),
        b: Point2::new(3.0, 4.25),
        residual_px: 0.1,
        sigma_px: Some(0.05),
        inlier: true,
    }];
    let baseline = Some(KnownLength { metres: 200.0, sigma_m: 2.0 });
    for (name, baseline, world, metric) in [
        ("map", baseline, over_the_moon(), true),
        ("metric", baseline, World::Unknown, true),
        ("relative", None, World::Unknown, false),
    ] {
        let folder = dir.path().join(name);
        let placement = Priors { baseline, world, ..Priors::default() }.place(&prediction).unwrap();
        let input = ProductInput {
            views: [&view, &view],
            prediction: &prediction,
            placement: &placement,
            matches: Some(&matches),
            shaded: None,
        };
        let products = write(&folder, &input, &ProductOptions::default()).unwrap();
        let text = std::fs::read(folder.join(SUMMARY_NAME)).unwrap();
        let summary: ProductSummary = serde_json::from_slice(&text).unwrap();
        assert_eq!(summary, products.summary);
        assert_eq!(summary.metric, metric);
        assert_eq!(summary.crs.is_some(), name == "map");
        assert_eq!(summary.files.len(), 13);
        for file in &summary.files {
            assert_eq!(
                std::fs::metadata(folder.join(&file.name)).unwrap().len(),
                file.bytes,
                "{}",
                file.name
            );
        }
        let leftovers = std::fs::read_dir(&folder).unwrap().count();
        assert_eq!(leftovers, 14, "files beside those of the summary");
        let names = std::fs::read_to_string(folder.join("hazard.tif.aux.xml")).unwrap();
        let names: Vec<&str> = names
            .lines()
            .filter_map(|line| line.trim().strip_prefix("<Category>")?.strip_suffix("</Category>"))
            .collect();
        assert_eq!(
            names,
            ["no height", "safe", "cannot be told", "too rough", "too steep", "too steep and too rough"]
        );
        assert!(summary.measured[0] > 0.8 && summary.completed[0] > 0.1);
        let alignment = transform_file::read_alignment(&folder.join("transform.json")).unwrap();
        assert_eq!(alignment.world, if name == "map" { "moon_me" } else { "local" });
        // The points are written with their size.
        assert_eq!(alignment.world_from_pred.scale(), 1.0);
        let shares = &summary.hazard;
        let total = shares.safe + shares.slope + shares.roughness + shares.both + shares.unknown;
        assert!((total - 1.0).abs() < 1e-9);
    }
    let mut dem = DemReader::open(&dir.path().join("map/dem.tif"), &OpenOptions::default()).unwrap();
    assert_eq!(dem.info().crs.projection.name(), "polar stereographic (south)");
    // 30 units of 100 m below 3000 m, and relief of ±30 m.
    let heights = dem.read_all().unwrap();
    assert!(heights.data.iter().filter(|h| !h.is_nan()).all(|h| h.abs() < 80.0));
}

#[test]
fn pointmaps_are_in_metres_where_the_scale_is_known() {
    let (prediction, view) = prediction();
    let baseline = Some(KnownLength { metres: 200.0, sigma_m: 2.0 });
    let placement = Priors { baseline, ..Priors::default() }.place(&prediction).unwrap();
    let input = ProductInput {
        views: [&view, &view],
        prediction: &prediction,
        placement: &placement,
        matches: None,
        shaded: None,
    };
    let bytes = arrays::pointmaps(&input).unwrap();
    let arrays = npz::decode(&bytes, Path::new("memory")).unwrap();
    assert_eq!(arrays["pts3d_a"].shape, [40, 48, 3]);
    let points = arrays["pts3d_a"].to_f64().unwrap();
    assert!(
        (points[2] / 100.0 - f64::from(prediction.views.as_ref().unwrap()[0].points.data[0][2])).abs() < 1e-4
    );
    assert_eq!(arrays["metric"].to_f64().unwrap(), [1.0]);
    assert_eq!(arrays["fill_b"].to_f64().unwrap()[47], 2.0);
    assert_eq!(arrays["sigma_b"].shape, [40, 48]);
    assert!((arrays["cam_b_from_cam_a"].to_f64().unwrap()[3] + 200.0).abs() < 1e-9);
}

#[test]
fn a_prediction_without_points_writes_nothing() {
    let (prediction, view) = prediction();
    let empty = Prediction { views: None, ..prediction };
    let placement = Priors::default().place(&empty).unwrap();
    let input = ProductInput {
        views: [&view, &view],
        prediction: &empty,
        placement: &placement,
        matches: None,
        shaded: None,
    };
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("out");
    assert!(matches!(write(&folder, &input, &ProductOptions::default()), Err(Error::TooFewPoints { .. })));
    assert!(!folder.exists());
}
