use super::*;
use crate::prediction::{Fill, PredictedView};
use selenograph_geometry::{Body, Cam, Camera, Geodetic, Point2, lookat, pixel, proj_string};
use selenograph_pose::relative::CannotSay;
use selenograph_raster::{Affine, Raster};

const SITE: Geodetic = Geodetic { lat_rad: -1.5, lon_rad: 0.7, height_m: 0.0 };

/// Hills of some 150 m over kilometres, on the polar map.
fn hills(x: f64, y: f64, relief: f64) -> f64 {
    let wave = |kx: f64, ky: f64| ((kx * x + ky * y) / 1000.0).sin();
    relief * (80.0 * wave(1.7, 0.6) + 60.0 * wave(-0.9, 2.3) + 40.0 * wave(3.1, -2.2)) - 500.0
}

fn model(relief: f64) -> DemPatch {
    let crs = proj_string::parse("IAU_2015:30135").unwrap();
    let [x, y] = crs.projection.map_from_place(&SITE).unwrap();
    let map_from_pixel = Affine::north_up(x - 8000.0, y + 8000.0, 80.0, 80.0);
    let heights = Raster::from_fn(200, 200, |column, row| {
        let [x, y] = map_from_pixel.apply(pixel::center_of(column), pixel::center_of(row));
        hills(x, y, relief) as f32
    });
    DemPatch::new(heights, crs, &map_from_pixel).unwrap()
}

/// Camera A 5 km above the site, tilted by 20°.
fn pose() -> Rigid3<BodyFixed, CamA> {
    let body = Body::moon();
    let above = Geodetic { height_m: 4500.0, ..SITE };
    let axes = body.body_from_enu(&above);
    let forward = axes.vector(&Vector3::new(0.0, 0.34, -0.94));
    let cam: Rigid3<BodyFixed, Cam> =
        lookat::from_forward_and_right(body.point(&above), &forward, &axes.vector(&Vector3::x())).unwrap();
    cam.relabel()
}

/// What a perfect method would say with a unit of 700 m.
fn truth(dem: &DemPatch) -> Prediction {
    let camera = Camera::from_fov(64, 64, 0.8).unwrap();
    let body_from_cam = pose();
    let points = Raster::from_fn(64, 64, |x, y| {
        let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap();
        let mut t = 5000.0;
        for _ in 0..60 {
            t += dem.height_over(&body_from_cam.point(&Point3::from(ray * t))).unwrap();
        }
        (ray * (t / 700.0)).map(|v| v as f32).into()
    });
    let view = PredictedView {
        confidence: points.map(|_| 1.0),
        sigma: None,
        fill: points.map(|_| Fill::Measured),
        points,
    };
    let none = CannotSay::TooFewMatches { found: 0, needed: 5 };
    Prediction { cam_b_from_cam_a: Err(none.into()), views: Some([view.clone(), view]) }
}

/// The pose turned by half a degree and moved by 200 m.
fn wrong_pose() -> Rigid3<BodyFixed, CamA> {
    let truth = pose();
    let turn = Rigid3::<CamA, CamA>::new(
        Rotation3::new(Vector3::new(0.006, -0.004, 0.005)),
        Point3::new(120.0, -90.0, 130.0),
    );
    &truth * &turn
}

/// Largest distance of the placed points from the truth, metres.
fn error_of(found: &DemAlignment, prediction: &Prediction) -> f64 {
    let expected: Sim3<BodyFixed, PredA> = Sim3::new(700.0, pose().relabel()).unwrap();
    let points = sampled_points(prediction).into_iter().map(Point3::from);
    points.map(|p| (found.body_from_pred.point(&p) - expected.point(&p)).norm()).fold(0.0, f64::max)
}

/// A tenth of a cell: bilinear hills have creases along the cells.
const TOLERANCE_M: f64 = 8.0;

#[test]
fn relief_decides_all_seven_numbers() {
    let dem = model(1.0);
    let prediction = truth(&dem);
    for scale in [None, Some(730.0)] {
        let found = align(&prediction, &wrong_pose(), scale, &dem, &DemOptions::default()).unwrap();
        let error = error_of(&found, &prediction);
        assert!(error < TOLERANCE_M, "{error} m {found:?}");
        assert!((found.body_from_pred.scale() / 700.0 - 1.0).abs() < 2e-3);
        assert!(found.residual_before_m > 20.0 && found.residual_after_m < 1.0, "{found:?}");
        assert_eq!(found.observed, [true; 7]);
        let placement = found.placement(&dem).unwrap();
        assert!(placement.metric && placement.source == Some(ScaleSource::Dem));
    }
}

/// A fifth of what is known beforehand: turning and scaling the scene about the camera moves its middle a little.
const UNDECIDED_M: f64 = 100.0;
/// The heading is known to 17 milliradians, and nothing says more.
const UNDECIDED_RAD: f64 = 1e-3;

#[test]
fn a_plain_decides_only_what_it_can() {
    let dem = model(0.0);
    let prediction = truth(&dem);
    let found = align(&prediction, &wrong_pose(), Some(710.0), &dem, &DemOptions::default()).unwrap();
    // Height and the two tilts; neither place nor heading, which stay where they were given.
    assert_eq!(found.observed[..6], [false, false, true, true, true, false]);
    assert!(found.shift_m[0].abs() < UNDECIDED_M && found.shift_m[1].abs() < UNDECIDED_M, "{found:?}");
    assert!(found.turn_rad[2].abs() < UNDECIDED_RAD);
    assert!(found.residual_after_m < 0.1, "{found:?}");
}

/// Its standard deviation in the test below.
const POSITION_SIGMA_M: f64 = 50.0;

#[test]
fn a_camera_whose_place_is_known_stays_there() {
    // Gentle relief, and as much again that the model does not hold: a smaller scale would make that smaller too.
    let dem = model(0.1);
    let mut prediction = truth(&dem);
    let ripple = |p: [f32; 3], k: usize| p.map(|v| v * (1.0 + 0.004 * ((k * 617 % 97) as f32 / 97.0 - 0.5)));
    for view in prediction.views.iter_mut().flatten() {
        view.points.data.iter_mut().enumerate().for_each(|(k, p)| *p = ripple(*p, k));
    }
    let options = DemOptions { position_sigma_m: POSITION_SIGMA_M, ..DemOptions::default() };
    let found = align(&prediction, &pose(), None, &dem, &options).unwrap();
    let moved = (found.body_from_pred.origin() - pose().origin()).norm();
    assert!(moved < POSITION_SIGMA_M, "{moved} m {found:?}");
    // From 5 km above, a position known to 50 m leaves a scale known to 1 %.
    assert!((found.body_from_pred.scale() / 700.0 - 1.0).abs() < 0.01 && found.sigma[6] < 0.011, "{found:?}");
}

#[test]
fn a_scene_off_the_model_or_a_pose_below_it_is_an_error() {
    let dem = model(1.0);
    let prediction = truth(&dem);
    let below: Rigid3<BodyFixed, CamA> = Rigid3::new(
        Rotation3::from_matrix_unchecked(pose().rotation()),
        Point3::from(pose().origin().coords * 0.99),
    );
    let options = DemOptions::default();
    assert!(matches!(align(&prediction, &below, None, &dem, &options), Err(Error::Undetermined { .. })));
    assert!(matches!(
        align(&prediction, &pose(), Some(1e6), &dem, &options),
        Err(Error::TooFewPoints { .. })
    ));
    let absurd = DemOptions { position_sigma_m: 0.0, ..options };
    assert!(matches!(align(&prediction, &pose(), None, &dem, &absurd), Err(Error::Value { .. })));
}
