//! Dense stereo on surfaces with a closed form, and on pictures that say nothing.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_geometry::{CamA, CamB, Camera, Distortion, Point2, Point3, Rigid3, Rotation3, pixel};
use selenograph_raster::Raster;
use selenograph_reconstruct::matching::Match;
use selenograph_reconstruct::stereo::{self, Completion, Dense, StereoOptions};
use selenograph_reconstruct::{Fill, View};

/// Smooth pictures without noise over a gentle surface are found to a few hundredths of a pixel of parallax; the largest
/// errors are at the rim.
const MEDIAN_ERROR_PX_OF_HEIGHT: f64 = 0.3;

/// Ground `z = 10 + relief(x, y)` in the frame of A.
fn relief(x: f64, y: f64) -> f64 {
    0.25 * (0.9 * x).sin() * (0.7 * y + 0.3).cos() + 0.05 * x
}

/// Grey level of the ground: waves of many sizes and directions.
fn paint(x: f64, y: f64) -> f64 {
    let mut sum = 0.5;
    for k in 0..24 {
        let angle = 2.4 * f64::from(k);
        let frequency = 3.0 * 1.13f64.powi(k);
        sum += 0.35 / (1.0 + f64::from(k)).sqrt()
            * (frequency * (x * angle.cos() + y * angle.sin()) + f64::from(k * k)).sin();
    }
    sum
}

/// Where a ray from A's frame meets the ground.
fn ground(eye: &Point3<f64>, ray: &selenograph_geometry::Vector3<f64>) -> Point3<f64> {
    let mut k = (10.0 - eye.z) / ray.z;
    for _ in 0..40 {
        let p = eye + ray * k;
        k = (10.0 + relief(p.x, p.y) - eye.z) / ray.z;
    }
    eye + ray * k
}

fn picture(camera: &Camera, cam_from_a: &Rigid3<CamB, CamA>, gain: f64) -> (View, Raster<f64>) {
    let a_from_cam = cam_from_a.inverse();
    let point = |x: usize, y: usize| {
        let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap();
        ground(&a_from_cam.origin(), &a_from_cam.vector(&ray))
    };
    let image = Raster::from_fn(camera.width, camera.height, |x, y| {
        let p = point(x, y);
        (gain * paint(p.x, p.y)) as f32
    });
    let truth = Raster::from_fn(camera.width, camera.height, |x, y| cam_from_a.point(&point(x, y)).z);
    (View { image, camera: camera.clone() }, truth)
}

struct Scene {
    a: View,
    b: View,
    b_from_a: Rigid3<CamB, CamA>,
    truth: [Raster<f64>; 2],
    seeds: Vec<Match>,
}

/// B is turned by two thirds of a half turn, half as bright, of another size, and has a lens if asked.
fn scene(lens: Distortion) -> Scene {
    let cam_a = Camera::from_fov(160, 128, 0.7).unwrap();
    let cam_b = Camera::from_fov(144, 150, 0.75).unwrap().with_distortion(lens);
    let b_from_a = Rigid3::new(Rotation3::from_euler_angles(0.04, -0.06, 2.1), Point3::new(0.7, -0.5, 0.4));
    let (a, truth_a) = picture(&cam_a, &Rigid3::identity(), 1.0);
    let (b, truth_b) = picture(&cam_b, &b_from_a, 0.5);
    let mut seeds = vec![];
    for y in (8..128).step_by(16) {
        for x in (8..160).step_by(16) {
            let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let seen =
                cam_b.project(&b_from_a.point(&ground(&Point3::origin(), &cam_a.ray_z1(&at).unwrap())));
            if let Some(seen) = seen.filter(|p| p.x > 0.0 && p.y > 0.0 && p.x < 144.0 && p.y < 150.0) {
                seeds.push(Match { a: at, b: seen, score: 1.0 });
            }
        }
    }
    Scene { a, b, b_from_a, truth: [truth_a, truth_b], seeds }
}

fn run(scene: &Scene, options: &StereoOptions) -> Dense {
    stereo::dense(&scene.a, &scene.b, &scene.b_from_a, &scene.seeds, options).unwrap()
}

/// Median error in pixels of height over measured pixels, and their share.
fn error_px(dense: &Dense, scene: &Scene, idx: usize) -> (f64, f64) {
    let view = &dense.views[idx];
    let focal = [&scene.a, &scene.b][idx].camera.fx;
    let mut errors: Vec<f64> = (0..view.fill.data.len())
        .filter(|&at| view.fill.data[at] == Fill::Measured)
        .map(|at| {
            (f64::from(view.depth_z.data[at]) - scene.truth[idx].data[at]).abs() / scene.truth[idx].data[at]
                * focal
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() / 2], errors.len() as f64 / view.fill.data.len() as f64)
}

#[test]
fn a_turned_darker_larger_second_view_with_and_without_a_lens() {
    let lens = Distortion { k1: -0.1, k2: 0.02, p1: 5e-4, p2: -4e-4, k3: 0.0 };
    for lens in [Distortion::default(), lens] {
        let scene = scene(lens);
        let dense = run(&scene, &StereoOptions::default());
        for idx in 0..2 {
            let (error, share) = error_px(&dense, &scene, idx);
            assert!(error < MEDIAN_ERROR_PX_OF_HEIGHT && share > 0.5, "view {idx}: {error} px, {share}");
        }
        // The points of B, carried into A's frame, lie on the same ground.
        let [_, b] = dense.to_points(&scene.a, &scene.b);
        let mut errors: Vec<f64> = b
            .points
            .data
            .iter()
            .filter(|p| p[0].is_finite())
            .map(|p| (f64::from(p[2]) - 10.0 - relief(f64::from(p[0]), f64::from(p[1]))).abs())
            .collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors[errors.len() / 2] < 0.02, "{}", errors[errors.len() / 2]);
    }
}

#[test]
fn one_thread_or_many_give_the_same_bits() {
    let scene = scene(Distortion::default());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&scene, &StereoOptions::default()))
    };
    let bits = |dense: &Dense| {
        dense.views.iter().flat_map(|v| v.depth_z.data.iter().map(|z| z.to_bits())).collect::<Vec<_>>()
    };
    assert_eq!(bits(&with(1)), bits(&with(3)));
}

#[test]
fn pictures_that_say_nothing_get_no_answer() {
    let scene = scene(Distortion::default());
    let flat =
        |view: &View, level: f32| View { image: view.image.map(|_| level), camera: view.camera.clone() };
    // Another ground altogether, in place of what A sees.
    let other = View {
        image: Raster::from_fn(144, 150, |x, y| paint(7.0 + 0.05 * x as f64, 50.0 - 0.06 * y as f64) as f32),
        camera: scene.b.camera.clone(),
    };
    for b in [flat(&scene.b, 0.0), flat(&scene.b, 1.0), flat(&scene.b, f32::NAN), other] {
        let dense =
            stereo::dense(&scene.a, &b, &scene.b_from_a, &scene.seeds, &StereoOptions::default()).unwrap();
        for view in &dense.views {
            let answered = view.fill.data.iter().filter(|&&f| f != Fill::Absent).count();
            assert!(answered * 20 < view.fill.data.len(), "{answered} pixels of {}", view.fill.data.len());
        }
    }
}

#[test]
fn a_coarse_plane_stands_in_for_matches() {
    let mut scene = scene(Distortion::default());
    let plane = Raster::from_fn(160, 128, |_, _| 10.05f32);
    scene.seeds = stereo::seeds_from_depth_z(&plane, &scene.a.camera, &scene.b.camera, &scene.b_from_a, 12);
    let dense = run(&scene, &StereoOptions::default());
    let (error, share) = error_px(&dense, &scene, 0);
    assert!(error < MEDIAN_ERROR_PX_OF_HEIGHT && share > 0.5, "{error} px, {share}");
}

#[test]
fn masked_pixels_are_bridged_only_when_asked() {
    let mut scene = scene(Distortion::default());
    for y in 60..70 {
        for x in 70..82 {
            scene.a.image[(x, y)] = f32::NAN;
        }
    }
    let none = run(&scene, &StereoOptions { completion: Completion::None, ..Default::default() });
    assert!(none.views[0].fill.data.iter().all(|&f| f != Fill::Completed));
    let everywhere = run(&scene, &StereoOptions { completion: Completion::Everywhere, ..Default::default() });
    assert!(everywhere.views[0].fill.data.iter().all(|&f| f != Fill::Absent));
    let middle = everywhere.views[0].depth_z[(76, 65)];
    assert!((f64::from(middle) / scene.truth[0][(76, 65)] - 1.0).abs() < 0.01);
}

#[test]
fn what_cannot_be_started_is_an_error() {
    let scene = scene(Distortion::default());
    let options = StereoOptions::default();
    let few = stereo::dense(&scene.a, &scene.b, &scene.b_from_a, &scene.seeds[..2], &options);
    assert!(matches!(few, Err(stereo::Error::TooFewSeeds { found: 2, .. })));
    let still = Rigid3::new(Rotation3::identity(), Point3::origin());
    let none = stereo::dense(&scene.a, &scene.b, &still, &scene.seeds, &options);
    assert_eq!(none.unwrap_err(), stereo::Error::NoBaseline);
    let mut small = scene.a.clone();
    small.image = Raster::filled(8, 8, 0.0);
    assert!(matches!(
        stereo::dense(&small, &scene.b, &scene.b_from_a, &scene.seeds, &options),
        Err(stereo::Error::Size { .. })
    ));
}
