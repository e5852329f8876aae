use super::*;
use crate::prediction::{Fill, PredictedView};
use crate::scale::ScaleKind;
use selenograph_geometry::{Body, Camera, Geodetic, Point2, Point3, Sim3, lookat, pixel};
use selenograph_raster::Raster;

const SIDE: usize = 64;
/// Prediction's units per metre.
const UNIT: f64 = 1.0 / 850.0;
/// Pointmaps are f32: a point at ten units steps by 1e-6 of it.
const F32_TOLERANCE: f64 = 1e-5;

/// A camera 9 km over ground at 88° S, leaning by 20°, and the ground as a sphere 300 m above the Moon's.
struct Scene {
    body: Body,
    body_from_cam_a: Rigid3<BodyFixed, CamA>,
    prediction: Prediction,
    ground_radius_m: f64,
}

fn scene() -> Scene {
    let body = Body::moon();
    let ground_radius_m = body.radius_m + 300.0;
    let place = Geodetic::from_deg(-88.0, 40.0, 300.0);
    let back = body.direction(&place, 1.0, 70f64.to_radians());
    let right = body.direction(&place, 1.0 + std::f64::consts::FRAC_PI_2, 0.0);
    let origin = body.point(&place) + back * 9000.0;
    let body_from_cam_a: Rigid3<BodyFixed, CamA> =
        lookat::from_forward_and_right::<BodyFixed>(origin, &-back, &right).unwrap().relabel();
    let camera = Camera::from_fov(SIDE, SIDE, 0.7).unwrap();
    let points = Raster::from_fn(SIDE, SIDE, |x, y| {
        let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap().normalize();
        let (o, d) = (body_from_cam_a.origin().coords, body_from_cam_a.vector(&ray));
        let along = o.dot(&d);
        let distance = -along - (along * along - o.norm_squared() + ground_radius_m.powi(2)).sqrt();
        (ray * distance * UNIT).map(|v| v as f32).into()
    });
    let view = PredictedView {
        points,
        confidence: Raster::filled(SIDE, SIDE, 1.0),
        sigma: None,
        fill: Raster::filled(SIDE, SIDE, Fill::Measured),
    };
    let motion = Rigid3::new(selenograph_geometry::Rotation3::identity(), Point3::new(-1.0, 0.0, 0.0));
    let prediction = Prediction { cam_b_from_cam_a: Ok(motion), views: Some([view.clone(), view]) };
    Scene { body, body_from_cam_a, prediction, ground_radius_m }
}

fn relative_error(placement: &Placement) -> f64 {
    (placement.cam_a_from_pred.scale() * UNIT - 1.0).abs()
}

#[test]
fn known_points_give_size_and_place() {
    let Scene { body, body_from_cam_a, prediction, ground_radius_m } = scene();
    let points = &prediction.views.as_ref().unwrap()[0].points;
    let pixels = [(5, 7), (60, 9), (33, 58), (20, 30)];
    let world = |x: usize, y: usize| {
        let point = Point3::from(points[(x, y)].map(|v| f64::from(v) / UNIT));
        body_from_cam_a.point(&point)
    };
    let at = |x: usize, y: usize| Point2::new(pixel::center_of(x), pixel::center_of(y));
    let on_body = pixels.map(|(x, y)| KnownPoint {
        pixel: at(x, y),
        place: KnownPlace::Body(body.clone(), body.place(&world(x, y))),
    });
    let priors = Priors { points: on_body.to_vec(), ..Priors::default() };
    let placement = priors.place(&prediction).unwrap();
    assert!(relative_error(&placement) < F32_TOLERANCE, "{placement:?}");
    let lifted = placement.body_from_pred().unwrap().point(&Point3::from(points[(40, 40)].map(f64::from)));
    assert!((lifted.coords.norm() - ground_radius_m).abs() < 0.1);

    // In a frame of the user the size is the same; mixed frames, a line and two points are refused.
    let local = |(x, y): (usize, usize)| {
        let turned = Sim3::<selenograph_geometry::Enu, BodyFixed>::from_rigid(Rigid3::new(
            selenograph_geometry::Rotation3::from_euler_angles(0.2, 0.5, 1.0),
            Point3::origin(),
        ));
        let centre = turned.point(&world(33, 33));
        let place = KnownPlace::Local(Point3::from(turned.point(&world(x, y)) - centre));
        KnownPoint { pixel: at(x, y), place }
    };
    let priors = Priors { points: pixels.map(local).to_vec(), ..Priors::default() };
    let placement = priors.place(&prediction).unwrap();
    assert!(relative_error(&placement) < F32_TOLERANCE && matches!(placement.world, World::Level(_)));
    let mixed = vec![on_body[0].clone(), local(pixels[1]), local(pixels[2])];
    let mixed = Priors { points: mixed, ..Priors::default() };
    assert!(matches!(mixed.place(&prediction), Err(Error::Undetermined { .. })));
    let two = Priors { points: on_body[..2].to_vec(), ..Priors::default() };
    assert!(matches!(two.place(&prediction), Err(Error::TooFewPoints { found: 2, .. })));
    let same = Priors { points: vec![on_body[0].clone(); 3], ..Priors::default() };
    assert!(same.place(&prediction).is_err());
}

#[test]
fn the_first_source_is_taken_unless_another_is_asked_for() {
    let Scene { prediction, .. } = scene();
    let length = |metres: f64| Some(KnownLength { metres, sigma_m: 0.0 });
    assert!(!Priors::default().place(&prediction).unwrap().metric);
    let both = Priors { baseline: length(850.0), altitude: length(1000.0), ..Priors::default() };
    assert!(relative_error(&both.place(&prediction).unwrap()) < 1e-9);
    let asked = Priors { scale_from: Some(ScaleFrom::Altitude), ..both.clone() };
    assert_eq!(asked.place(&prediction).unwrap().source, ScaleKind::Altitude);
    let absent = Priors { scale_from: Some(ScaleFrom::Points), ..both };
    assert!(matches!(absent.place(&prediction), Err(Error::Undetermined { .. })));
}
