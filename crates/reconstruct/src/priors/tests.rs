use super::*;
use crate::prediction::{Fill, PredictedView};
use selenograph_geometry::{Point3, Rotation3};
use selenograph_raster::Raster;

/// Level ground two baselines below camera A, which looks straight down.
fn scene() -> Prediction {
    let points = Raster::from_fn(16, 16, |x, y| [(x as f32 - 8.0) / 16.0, (y as f32 - 8.0) / 16.0, 2.0]);
    let view = PredictedView {
        points,
        confidence: Raster::filled(16, 16, 1.0),
        sigma: None,
        fill: Raster::filled(16, 16, Fill::Measured),
    };
    let motion = Rigid3::new(Rotation3::identity(), Point3::new(-1.0, 0.0, 0.0));
    Prediction { cam_b_from_cam_a: Ok(motion), views: Some([view.clone(), view]) }
}

#[test]
fn the_first_source_is_taken_unless_another_is_asked_for() {
    let prediction = scene();
    let length = |metres: f64| Some(KnownLength { metres, sigma_m: 0.0 });
    assert!(!Priors::default().place(&prediction).unwrap().metric);
    let both = Priors { baseline: length(850.0), altitude: length(1000.0), ..Priors::default() };
    assert_eq!(both.place(&prediction).unwrap().cam_a_from_pred.scale(), 850.0);
    let asked = Priors { scale_from: Some(ScaleSource::Altitude), ..both.clone() };
    let placement = asked.place(&prediction).unwrap();
    assert_eq!((placement.source, placement.cam_a_from_pred.scale()), (Some(ScaleSource::Altitude), 500.0));
    let absent = Priors { scale_from: Some(ScaleSource::Points), ..both };
    assert!(matches!(absent.place(&prediction), Err(Error::Undetermined { .. })));
}

#[test]
fn two_suns_are_two_in_one_camera() {
    let sun = |direction: Vector3<f64>, axes: SunAxes| Some(KnownSun { direction, axes, sigma_rad: 0.0 });
    let (own, cam_a) = (SunAxes::Own, SunAxes::CamA);
    let (x, y) = (Vector3::x(), Vector3::y());
    // Camera B is turned by 90° about its axis: A's X is its Y.
    let turned =
        Rigid3::new(Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2), Point3::origin());
    let pose = Some(KnownPose { cam_b_from_cam_a: turned, metric: false });
    for (suns, cam_b_from_cam_a, two) in [
        ([None, None], None, false),
        ([sun(x, own), None], pose, false),
        ([sun(x, own), sun(y, own)], pose, false),
        ([sun(x, own), sun(x, own)], pose, true),
        ([sun(x, cam_a), sun(x, cam_a)], pose, false),
        ([sun(x, cam_a), sun(y, cam_a)], None, true),
        // Nothing says how the cameras are turned: other numbers may be another Sun.
        ([sun(x, own), sun(y, own)], None, true),
        ([sun(x, own), sun(x, own)], None, false),
    ] {
        let priors = Priors { suns, cam_b_from_cam_a, ..Priors::default() };
        assert_eq!(priors.may_be_two_suns(), two, "{suns:?}");
    }
}
