//! Relative pose of two pictures of a synthetic roof, and of pictures that allow none.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_geometry::pixel::center_of;
use selenograph_geometry::{CamA, CamB, Camera, Distortion, Point2, Point3, Rigid3, Rotation3, Vector3};
use selenograph_pose::relative::{CannotSay, Refinement};
use selenograph_raster::Raster;
use selenograph_reconstruct::evidence::{FocalKnowledge, FocalSource, PoseSource};
use selenograph_reconstruct::learned::{Learned, LearnedInput};
use selenograph_reconstruct::matching::{Grain, Match};
use selenograph_reconstruct::pipeline::{Input, Method, Options, reconstruct};
use selenograph_reconstruct::priors::{KnownPose, Priors};
use selenograph_reconstruct::relative_pose::{OrbOptions, SiftOptions, orb, sift};
use selenograph_reconstruct::{Error, Fill, View};

/// Windows across the ridge see two planes at once: some times the spread that smooth ground leaves.
const MAX_ROTATION_DEG: f64 = 0.1;
const MAX_DIRECTION_DEG: f64 = 0.4;

/// Corners at whole samples of coarse levels are worth degrees, not tenths.
const MAX_ORB_DEG: f64 = 4.0;

/// A number in `[0, 1)` for each point of a lattice.
fn hash(x: i64, y: i64, seed: i64) -> f64 {
    let mut h =
        (x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D)) as u64;
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D_F1A5_17C9);
    h ^= h >> 29;
    (h.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 40) as f64 / f64::from(1 << 24)
}

/// Smooth noise of cells of one unit.
fn noise(x: f64, y: f64, seed: i64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * t * (10.0 + t * (6.0 * t - 15.0));
    let (u, v) = (ease(x - i), ease(y - j));
    let at = |di: i64, dj: i64| hash(i as i64 + di, j as i64 + dj, seed);
    (at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v) + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v
}

/// Albedo of the roof: several sizes of grain, none finer than a few pixels.
fn texture(x: f64, y: f64, seed: i64) -> f32 {
    let scale = |k: i32| 9.0 * 1.7f64.powi(k);
    (0..4).map(|k| noise(x * scale(k), y * scale(k), seed + i64::from(k))).sum::<f64>() as f32 / 4.0
}

/// Distance along a ray from `origin` to the roof `z = 3 − 0.35 |x − 0.1|` (in the frame of A).
fn roof(origin: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    [0.35, -0.35].into_iter().find_map(|slope| {
        // z + slope (x − 0.1) = 3 on the side where slope (x − 0.1) is positive.
        let t = (3.0 - origin.z - slope * (origin.x - 0.1)) / (ray.z + slope * ray.x);
        let x = origin.x + t * ray.x;
        (t > 0.0 && slope * (x - 0.1) >= 0.0).then_some(t)
    })
}

fn photograph<F: selenograph_geometry::Frame>(
    camera: &Camera,
    a_from_cam: &Rigid3<CamA, F>,
    seed: i64,
    gain: f32,
) -> View {
    let image = Raster::from_fn(camera.width, camera.height, |x, y| {
        let Some(ray) = camera.ray_z1(&Point2::new(center_of(x), center_of(y))) else { return f32::NAN };
        let (origin, ray) = (a_from_cam.origin(), a_from_cam.vector(&ray));
        roof(&origin, &ray).map_or(f32::NAN, |t| {
            let hit = origin + t * ray;
            gain * texture(hit.x, hit.y, seed) + 0.01
        })
    });
    View { image, camera: camera.clone() }
}

/// A turned, smaller, closer camera with a lens, and where it stands.
fn second() -> (Camera, Rigid3<CamB, CamA>) {
    let lens = Distortion { k1: -0.08, k2: 0.01, p1: 3e-4, p2: -2e-4, k3: 0.0 };
    let camera = Camera::from_fov(360, 400, 0.75).unwrap().with_distortion(lens);
    let rotation = Rotation3::from_euler_angles(0.05, -0.12, 2.1);
    let a_from_b: Rigid3<CamA, CamB> = Rigid3::new(rotation, Point3::new(0.5, -0.1, 0.4));
    (camera, a_from_b.inverse())
}

fn errors_deg(found: &Rigid3<CamB, CamA>, truth: &Rigid3<CamB, CamA>) -> [f64; 2] {
    let turn = (&found.inverse() * truth).rotation_angle_rad();
    [turn.to_degrees(), found.origin().coords.angle(&truth.origin().coords).to_degrees()]
}

fn pair() -> (View, View, Rigid3<CamB, CamA>) {
    let (camera_b, b_from_a) = second();
    let camera_a = Camera::from_fov(384, 384, 0.8).unwrap();
    let a = photograph(&camera_a, &Rigid3::<CamA, CamA>::identity(), 5, 0.7);
    // A tenth of the exposure: nothing may depend on grey levels.
    let b = photograph(&camera_b, &b_from_a.inverse(), 5, 0.07);
    (a, b, b_from_a)
}

#[test]
fn rolled_scaled_and_distorted_views_are_solved_whatever_the_threads() {
    let (mut a, b, truth) = pair();
    // What the picture does not say must not be used.
    for y in 100..130 {
        a.image.row_mut(y)[40..90].fill(f32::NAN);
    }
    let found = sift(&a, &b, &SiftOptions::default()).unwrap();
    let [rotation, direction] = errors_deg(&found.pose.cam_b_from_cam_a, &truth);
    println!("{rotation:.4}° {direction:.4}° {:?}", found.counts);
    assert!(rotation < MAX_ROTATION_DEG && direction < MAX_DIRECTION_DEG);
    assert_eq!(found.pose.inliers.len(), found.matches.len());
    assert!(found.matches.iter().all(|m| {
        !(m.a.x > 40.0 && m.a.x < 90.0 && m.a.y > 100.0 && m.a.y < 130.0) && m.sigma_px.is_some()
    }));
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = alone.install(|| sift(&a, &b, &SiftOptions::default())).unwrap();
    assert_eq!(found.matches, again.matches);
    assert_eq!(found.pose.cam_b_from_cam_a, again.pose.cam_b_from_cam_a);
}

#[test]
fn orb_answers_roughly_and_refined_better() {
    let (a, b, truth) = pair();
    let refined = OrbOptions { refinement: Refinement::Full, ..OrbOptions::default() };
    let found = orb(&a, &b, &refined).unwrap();
    let [rotation, direction] = errors_deg(&found.pose.cam_b_from_cam_a, &truth);
    println!("{rotation:.4}° {direction:.4}° {:?}", found.counts);
    assert!(rotation < MAX_ORB_DEG && direction < MAX_ORB_DEG);
}

#[test]
fn one_picture_twice_has_no_parallax() {
    let (a, _, _) = pair();
    let reason = sift(&a, &a, &SiftOptions::default()).unwrap_err();
    assert!(matches!(reason, CannotSay::NoParallax { rotation_deg, .. } if rotation_deg < 0.01), "{reason}");
    assert!(matches!(
        orb(&a, &a, &OrbOptions { refinement: Refinement::Full, ..OrbOptions::default() }),
        Err(CannotSay::NoParallax { .. })
    ));
}

#[test]
fn views_without_common_ground_are_refused() {
    let (a, _, _) = pair();
    let (camera_b, b_from_a) = second();
    let elsewhere = photograph(&camera_b, &b_from_a.inverse(), 91, 0.7);
    let reason = sift(&a, &elsewhere, &SiftOptions::default()).unwrap_err();
    assert!(matches!(reason, CannotSay::NoConsensus { .. } | CannotSay::TooFewMatches { .. }), "{reason}");
}

#[test]
fn pictures_that_show_nothing_are_refused() {
    let (a, _, _) = pair();
    for level in [0.0, 1.0, f32::NAN] {
        let flat = View { image: a.image.map(|_| level), camera: a.camera.clone() };
        for [x, y] in [[&a, &flat], [&flat, &a], [&flat, &flat]] {
            let reason = sift(x, y, &SiftOptions::default()).unwrap_err();
            assert!(matches!(reason, CannotSay::TooFewMatches { .. }), "{reason}");
            assert!(matches!(orb(x, y, &OrbOptions::default()), Err(CannotSay::TooFewMatches { .. })));
        }
    }
}

/// Pixels of a matcher that saw the pictures at a third of their size.
const COARSE_PX: f64 = 3.0;

/// Matches of every fourth coarse pixel, at the middles of coarse pixels, as a network has them.
fn coarse_matches(a: &View, b: &View, b_from_a: &Rigid3<CamB, CamA>) -> Learned {
    let middle = |v: f64| ((v / COARSE_PX).floor() + 0.5) * COARSE_PX;
    let places = (0..32 * 32).map(|k| {
        let at = |n: usize| COARSE_PX * (4.0 * n as f64 + 0.5);
        Point2::new(at(k % 32), at(k / 32))
    });
    let matched = places.filter_map(|at| {
        let ray = a.camera.ray_z1(&at)?;
        let hit = Point3::from(ray * roof(&Point3::origin(), &ray)?);
        let seen = b.camera.project(&b_from_a.point(&hit))?;
        let is_inside = seen.x > 0.0 && seen.y > 0.0 && seen.x < 360.0 && seen.y < 400.0;
        is_inside.then(|| Match { a: at, b: Point2::new(middle(seen.x), middle(seen.y)), score: 1.0 })
    });
    let grain = Grain::of_pixels(COARSE_PX, 8.0 * COARSE_PX);
    Learned { pointmaps: None, matches: matched.collect(), dense_matches: None, grain }
}

#[test]
fn coarse_matches_of_a_network_give_the_pose_and_surface_of_subpixel_windows() {
    let (a, b, truth) = pair();
    let matches = coarse_matches(&a, &b, &truth);
    let solve = |matches: &Learned, priors: &Priors, options: &Options| {
        let cameras = [a.camera.clone(), b.camera.clone()];
        let said = LearnedInput { learned: matches.clone(), cameras, focal: FocalSource::Known };
        let input = Input { views: [&a, &b], learned: Some(&said), matches: None };
        reconstruct(&input, priors, options, |_| {})
    };
    let options = Options { method: Method::Mast3rStereo, ..Options::default() };
    let nothing = Priors::default();
    let found = solve(&matches, &nothing, &options).unwrap();
    let [rotation, direction] = errors_deg(found.prediction.cam_b_from_cam_a.as_ref().unwrap(), &truth);
    println!("{rotation:.4}° {direction:.4}° {:?}", found.counts);
    assert!(rotation < MAX_ROTATION_DEG && direction < MAX_DIRECTION_DEG);
    assert!(found.counts.matches == matches.matches.len() && found.counts.features == [0, 0]);
    let views = found.prediction.views.unwrap();
    let measured = views[0].fill.data.iter().filter(|fill| **fill == Fill::Measured).count();
    assert!(measured > 384 * 384 / 3, "{measured}");
    // A given pose: coarse matches agree with it by their own pixels.
    let known = KnownPose { cam_b_from_cam_a: truth, metric: true };
    let given = Priors { cam_b_from_cam_a: Some(known), ..Priors::default() };
    let found = solve(&matches, &given, &options).unwrap();
    let PoseSource::Given { agreeing, matches: all, .. } = found.pose else { panic!("{:?}", found.pose) };
    assert!(agreeing == all && found.placement.metric, "{agreeing} of {all}");
    // A guessed focal length comes from the same matches or is said to be an assumption.
    let guessed = Options { focal: FocalKnowledge::Guessed, ..options.clone() };
    let found = solve(&matches, &nothing, &guessed).unwrap();
    assert!(matches!(found.focal, FocalSource::Estimated { .. } | FocalSource::Assumed { .. }));
    // Matches that agree with nothing.
    let mut wrong = matches.clone();
    for (k, m) in wrong.matches.iter_mut().enumerate() {
        let anywhere = |seed: i64| center_of((360.0 * hash(k as i64, 0, seed)) as usize);
        m.b = Point2::new(anywhere(3), anywhere(4));
    }
    let refused = solve(&wrong, &nothing, &options);
    assert!(matches!(refused, Err(Error::CannotSay(_))), "{:?}", refused.map(|found| found.counts));
}
