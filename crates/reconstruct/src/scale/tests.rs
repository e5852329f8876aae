use super::*;
use crate::prediction::{Fill, PredictedView};
use crate::priors::{KnownLength, Priors};
use selenograph_geometry::{CamB, Camera, Point2, Point3, pixel};
use selenograph_raster::Raster;

/// A plane `z = z0 + slope·y` in camera A, in units of half a baseline; both views hold the same points.
fn prediction(z0: f64, slope: f64) -> Prediction {
    let camera = Camera::from_fov(64, 64, 0.8).unwrap();
    let points = Raster::from_fn(64, 64, |x, y| {
        let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap();
        let t = z0 / (1.0 - slope * ray.y);
        [(ray.x * t) as f32, (ray.y * t) as f32, t as f32]
    });
    let view = PredictedView {
        confidence: points.map(|_| 1.0),
        sigma: None,
        fill: points.map(|_| Fill::Measured),
        points,
    };
    let cam_b_from_cam_a: Rigid3<CamB, CamA> =
        Rigid3::from_quaternion(1.0, 0.0, 0.0, 0.0, Point3::new(2.0, 0.0, 0.0));
    Prediction { cam_b_from_cam_a: Ok(cam_b_from_cam_a), views: Some([view.clone(), view]) }
}

#[test]
fn a_baseline_gives_the_scale_and_its_error() {
    let with = |metres: f64, sigma_m: f64| Priors {
        baseline: Some(KnownLength { metres, sigma_m }),
        ..Priors::default()
    };
    let placement = with(500.0, 5.0).place(&prediction(10.0, 0.0)).unwrap();
    assert!((placement.cam_a_from_pred.scale() - 250.0).abs() < 1e-9);
    assert!(placement.metric && (placement.scale_sigma.unwrap() - 0.01).abs() < 1e-12);
    let mut without = prediction(10.0, 0.0);
    without.cam_b_from_cam_a = Ok(Rigid3::identity());
    assert!(matches!(with(500.0, 5.0).place(&without), Err(Error::Undetermined { .. })));
    for baseline_m in [0.0, -1.0, f64::NAN] {
        assert!(matches!(with(baseline_m, 0.0).place(&without), Err(Error::Value { .. })));
    }
}

/// f32 points ten units away.
const TOLERANCE: f64 = 1e-5;

#[test]
fn an_altitude_is_that_of_the_ground_straight_below() {
    let altitude = Some(KnownLength { metres: 3000.0, sigma_m: 0.0 });
    let at = |world: World| Priors { altitude, world, ..Priors::default() };
    // Nadir, level ground: 10 units are 3000 m.
    let level = at(World::Unknown).place(&prediction(10.0, 0.0)).unwrap();
    assert!((level.cam_a_from_pred.scale() / 300.0 - 1.0).abs() < TOLERANCE);
    // The camera looks along the vertical at sloping ground: the point on the axis counts, not the nearest one.
    let down = Rigid3::<Enu, CamA>::new(
        selenograph_geometry::Rotation3::from_matrix_unchecked(selenograph_geometry::Matrix3::from_diagonal(
            &Vector3::new(1.0, -1.0, -1.0),
        )),
        Point3::origin(),
    );
    let sloping = at(World::Level(down)).place(&prediction(10.0, 0.4)).unwrap();
    assert!((sloping.cam_a_from_pred.scale() / 300.0 - 1.0).abs() < 1e-3);
    // Without attitude the normal of the ground is taken for the vertical: 10 cos(atan 0.4).
    let fitted = at(World::Unknown).place(&prediction(10.0, 0.4)).unwrap();
    let across = 10.0 / 1.16f64.sqrt();
    assert!((fitted.cam_a_from_pred.scale() * across / 3000.0 - 1.0).abs() < 1e-3);
}

#[test]
fn ground_that_is_not_seen_is_carried_on() {
    // The camera is tilted by 60°: the vertical is far outside the picture.
    let tilt = 60f64.to_radians();
    let up = Vector3::new(0.0, -tilt.sin(), -tilt.cos());
    let points = prediction(10.0, -tilt.tan());
    let above = altitude::above_surface(&points, Some(&up)).unwrap();
    assert!(!above.seen_below);
    // The plane z = 10 − y tan 60° lies 10 cos 60° below.
    assert!((above.altitude - 5.0).abs() < TOLERANCE, "{}", above.altitude);
    assert!(altitude::above_surface(&points, Some(&-up)).is_err());
    let nothing = Prediction { views: None, ..points };
    assert!(matches!(altitude::above_surface(&nothing, Some(&up)), Err(Error::TooFewPoints { .. })));
}

#[test]
fn a_similarity_to_the_body_is_a_scale_and_a_pose() {
    let rigid: Rigid3<BodyFixed, PredA> =
        Rigid3::from_quaternion(0.5, 0.5, -0.5, 0.5, Point3::new(1e6, 2e5, -1.3e6));
    let body_from_pred = Sim3::new(123.0, rigid).unwrap();
    let placement =
        Placement::from_body(Body::moon(), &body_from_pred, Some(0.01), ScaleSource::Points).unwrap();
    let x = Point3::new(0.3, -2.0, 11.0);
    let back = placement.body_from_pred().unwrap().point(&x);
    assert!((back - body_from_pred.point(&x)).norm() < 1e-8);
    let up = placement.world.up_in_cam_a().unwrap();
    assert!((up.norm() - 1.0).abs() < 1e-12);
}

/// A camera over the equator at 0° E, `height_m` up, that looks `tilt_rad` off straight down, towards the east; its X is north.
fn over_the_equator(body: Body, height_m: f64, tilt_rad: f64) -> World {
    let (sin, cos) = tilt_rad.sin_cos();
    let forward = Vector3::new(-cos, sin, 0.0);
    let right = Vector3::z();
    let axes = selenograph_geometry::Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    let rotation = selenograph_geometry::Rotation3::from_matrix_unchecked(axes);
    let position = Point3::new(body.radius_m + height_m, 0.0, 0.0);
    World::Body { body, body_from_cam_a: Rigid3::new(rotation, position) }
}

#[test]
fn a_sun_over_the_moon_is_seen_from_where_camera_a_stands() {
    let world = over_the_equator(Body::moon(), 100_000.0, 0.0);
    // Sun in the east at an elevation of 30°, less the parallax of 0.0006°.
    let sun = world.sun_in_cam_a(&SubSolar::from_deg(0.0, 60.0)).unwrap();
    let told = world.sky_in_cam_a(90f64.to_radians(), 30f64.to_radians()).unwrap();
    assert!((2e-6..1.2e-5).contains(&sun.angle(&told)), "{}", sun.angle(&told));
    let elevation = world.elevation_rad(&sun).unwrap().to_degrees();
    assert!((elevation - 30.0).abs() < 1e-3 && elevation < 30.0, "{elevation}");
    for other in
        [over_the_equator(Body::mars(), 100_000.0, 0.0), World::Level(Rigid3::identity()), World::Unknown]
    {
        assert_eq!(other.sun_in_cam_a(&SubSolar::from_deg(0.0, 60.0)), None);
    }
}

#[test]
fn the_horizon_is_that_of_the_ground_in_view() {
    // 300 km up and 45° off: arcsin(sin 45° · (R + 300 km) / R) − 45° further east.
    let world = over_the_equator(Body::moon(), 300_000.0, 45f64.to_radians());
    let radius = Body::moon().radius_m;
    let further = (45f64.to_radians().sin() * (radius + 300_000.0) / radius).asin() - 45f64.to_radians();
    let ground = world.ground().unwrap();
    assert!(
        (ground.lon_rad - further).abs() < 1e-9 && ground.lat_rad.abs() < 1e-12 && ground.height_m == 0.0
    );
    let east = world.sky_in_cam_a(90f64.to_radians(), 0.0).unwrap();
    assert!((world.elevation_rad(&east).unwrap() - further).abs() < 1e-9);
    // Past the limb the ground is that below the camera.
    let past = over_the_equator(Body::moon(), 300_000.0, 80f64.to_radians());
    assert!(past.ground().unwrap().lon_rad.abs() < 1e-12);
    let level = World::Level(Rigid3::identity());
    assert!((level.elevation_rad(&Vector3::new(0.0, 1.0, 1.0)).unwrap().to_degrees() - 45.0).abs() < 1e-9);
    assert_eq!((level.ground(), World::Unknown.elevation_rad(&Vector3::z())), (None, None));
}
