//! Arrays made from the truth: pose, length and points must come out right.

use super::*;
use crate::Fill;
use crate::matching::Grain;
use selenograph_geometry::Point2;
use selenograph_geometry::{Rotation3, pixel};
use selenograph_raster::Raster;

/// The network's unit over the true one.
const UNIT: f64 = 3.7;
const SIDE: usize = 160;

/// Hills of a fifth of the distance, seen from above: height over the plane `z = 10` at (x, y).
fn hill(x: f64, y: f64) -> f64 {
    0.9 * (1.3 * x).sin() * (1.1 * y + 0.4).cos() + 0.4 * (2.9 * x + 1.7 * y).sin()
}

fn camera(width: usize, height: usize) -> Camera {
    Camera::from_fov(width, height, 45f64.to_radians()).unwrap()
}

fn true_pose() -> Rigid3<CamB, CamA> {
    Rigid3::new(Rotation3::from_euler_angles(0.05, 0.22, 0.3), Point3::new(-2.4, 0.3, 0.4))
}

/// The point on the ground in the frame of A that a camera sees at a pixel, by bisection along its ray; NaN where there is none.
fn seen(camera: &Camera, cam_a_from_cam: &Rigid3<CamA, CamB>, at: &Point2<f64>) -> Point3<f64> {
    let ray = cam_a_from_cam.vector(&camera.ray_z1(at).unwrap());
    let origin = cam_a_from_cam.origin();
    let over = |range: f64| {
        let x = origin + ray * range;
        x.z - (10.0 - hill(x.x, x.y))
    };
    let (mut near, mut far) = (4.0, 30.0);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if over(middle) < 0.0 { near = middle } else { far = middle }
    }
    origin + ray * (0.5 * (near + far))
}

/// Where a match is in picture B.
#[derive(Clone, Copy, PartialEq)]
enum Places {
    /// Where the point is seen.
    Exact,
    /// At the pixel that holds it, as matched descriptors have it.
    Whole,
}

/// What a perfect network says in its own unit: points everywhere, a match for every eighth pixel of A and for all.
fn truth(cameras: [&Camera; 2], pose: &Rigid3<CamB, CamA>, places: Places) -> Learned {
    let poses = [Rigid3::identity(), pose.inverse()];
    let pointmaps = [0, 1].map(|k| {
        let (width, height) = (cameras[k].width, cameras[k].height);
        let points = Raster::from_fn(width, height, |x, y| {
            let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let point = seen(cameras[k], &poses[k], &at).coords * UNIT;
            [point.x as f32, point.y as f32, point.z as f32]
        });
        Pointmap { points, confidence: Raster::filled(width, height, 0.9) }
    });
    let matches_of = |step: usize| {
        let mut matches = Vec::new();
        for y in (step / 2..cameras[0].height).step_by(step) {
            for x in (step / 2..cameras[0].width).step_by(step) {
                let a = Point2::new(pixel::center_of(x), pixel::center_of(y));
                let Some(b) = cameras[1].project(&pose.point(&seen(cameras[0], &poses[0], &a))) else {
                    continue;
                };
                let whole = |at: f64, side: usize| {
                    usize::try_from(pixel::index_of(at)).ok().filter(|idx| *idx < side).map(pixel::center_of)
                };
                let held = whole(b.x, cameras[1].width).zip(whole(b.y, cameras[1].height));
                let at = |(x, y)| if places == Places::Whole { Point2::new(x, y) } else { b };
                matches.extend(held.map(|held| Match { a, b: at(held), score: 1.0 }));
            }
        }
        matches
    };
    let (matches, dense) = (matches_of(8), matches_of(1));
    Learned {
        pointmaps: Some(pointmaps),
        matches,
        dense_matches: Some(dense),
        grain: Grain::of_pixels(1.0, 16.0),
    }
}

fn angle_deg(found: &Rigid3<CamB, CamA>) -> f64 {
    (&found.inverse() * &true_pose()).rotation_angle_rad().to_degrees()
}

fn direction_deg(found: &Rigid3<CamB, CamA>) -> f64 {
    found.origin().coords.angle(&true_pose().origin().coords).to_degrees()
}

/// The length is a median of some 500 ratios that are each off by 0.3 px of a parallax of some 40 px.
const LENGTH: f64 = 0.005;

#[test]
fn pose_length_and_points_come_out_right() {
    let camera = camera(SIDE, SIDE);
    let cameras = [&camera, &camera];
    // Degrees of rotation and of direction, share of the length. Exact places leave the rounding of f32 points; places off by 0.3 px at
    // 193 px of focal length, some 300 of them, leave a quarter of a degree in what rough ground determines worst.
    for (places, bounds) in [(Places::Exact, [1e-3, 1e-2, 1e-4]), (Places::Whole, [0.25, 1.0, 0.01])] {
        let learned = truth(cameras, &true_pose(), places);
        let solved = solve(cameras, &learned, None, &LearnedOptions::default()).unwrap();
        let pose = solved.prediction.cam_b_from_cam_a.unwrap();
        assert!(matches!(solved.source, PoseSource::Estimated(_)));
        let length = pose.origin().coords.norm() / (UNIT * true_pose().origin().coords.norm());
        let errors = [angle_deg(&pose), direction_deg(&pose), (length - 1.0).abs()];
        assert!(errors.iter().zip(bounds).all(|(error, bound)| *error < bound), "{errors:?}");
        assert!(solved.warnings.is_empty(), "{:?}", solved.warnings);
        let views = solved.prediction.views.unwrap();
        assert_eq!(views[0].points, learned.pointmaps.as_ref().unwrap()[0].points);
        // What the other view does not see was not measured from both.
        for view in &views {
            let counts = [Fill::Measured, Fill::Completed, Fill::Absent]
                .map(|fill| view.fill.data.iter().filter(|f| **f == fill).count());
            assert!(
                counts[0] > SIDE * SIDE / 3 && counts[1] > SIDE * SIDE / 20 && counts[2] == 0,
                "{counts:?}"
            );
        }
    }
}

#[test]
fn a_given_metric_pose_brings_the_points_into_metres() {
    let camera = camera(SIDE, SIDE);
    let cameras = [&camera, &camera];
    let learned = truth(cameras, &true_pose(), Places::Whole);
    let known = KnownPose { cam_b_from_cam_a: true_pose(), metric: true };
    let matcher = Learned { matches: Vec::new(), ..learned.clone() };
    // From the matches; without any, from the pose that the points imply.
    for learned in [&learned, &matcher] {
        let solved = solve(cameras, learned, Some(&known), &LearnedOptions::default()).unwrap();
        assert!(matches!(solved.source, PoseSource::Given { .. }));
        let views = solved.prediction.views.unwrap();
        for (k, view) in views.iter().enumerate() {
            let maps = learned.pointmaps.as_ref().unwrap();
            let ratio = f64::from(maps[k].points[(80, 70)][2]) / f64::from(view.points[(80, 70)][2]);
            assert!((ratio / UNIT - 1.0).abs() < LENGTH, "{ratio}");
        }
    }
}

#[test]
fn points_give_the_pose_where_there_are_no_matches_and_it_is_said() {
    let camera = camera(SIDE, SIDE);
    let cameras = [&camera, &camera];
    let learned = Learned { matches: Vec::new(), ..truth(cameras, &true_pose(), Places::Whole) };
    let solved = solve(cameras, &learned, None, &LearnedOptions::default()).unwrap();
    let pose = solved.prediction.cam_b_from_cam_a.unwrap();
    // Perfect points are f32.
    const EXACT_DEG: f64 = 1e-4;
    assert!(angle_deg(&pose) < EXACT_DEG && direction_deg(&pose) < EXACT_DEG);
    assert!((pose.origin().coords.norm() / (UNIT * true_pose().origin().coords.norm()) - 1.0).abs() < 1e-5);
    assert!(matches!(solved.source, PoseSource::Points { .. }));
    assert!(solved.warnings[0].to_string().contains("tell no pose"), "{:?}", solved.warnings);
    // Points that the network itself does not believe give none.
    let mut unsure = learned.clone();
    for map in unsure.pointmaps.as_mut().unwrap() {
        map.confidence.data.fill(0.5);
    }
    let solved = solve(cameras, &unsure, None, &LearnedOptions::default()).unwrap();
    assert!(matches!(
        solved.prediction.cam_b_from_cam_a,
        Err(NoPose::CannotSay(CannotSay::TooFewMatches { found: 0, .. }))
    ));
    assert!(solved.prediction.views.is_some() && matches!(solved.source, PoseSource::Nothing));
}

#[test]
fn dense_matches_are_triangulated_with_an_honest_sigma() {
    let (camera_a, camera_b) = (camera(SIDE, 120), camera(112, SIDE));
    let cameras = [&camera_a, &camera_b];
    let learned = truth(cameras, &true_pose(), Places::Whole);
    let options = LearnedOptions { points: PointsFrom::Triangulated, ..LearnedOptions::default() };
    let known = KnownPose { cam_b_from_cam_a: true_pose(), metric: true };
    let solved = solve(cameras, &learned, Some(&known), &options).unwrap();
    let views = solved.prediction.views.unwrap();
    let maps = learned.pointmaps.as_ref().unwrap();
    let (mut pulls, mut errors) = (Vec::new(), Vec::new());
    for (x, y) in (0..120).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let point = views[0].points[(x, y)].map(f64::from);
        if views[0].fill[(x, y)] != Fill::Measured {
            assert!(point[0].is_nan());
            continue;
        }
        let truth = maps[0].points[(x, y)].map(|v| f64::from(v) / UNIT);
        let ranges = [point, truth].map(|p| p.iter().map(|v| v * v).sum::<f64>().sqrt());
        errors.push((ranges[0] / ranges[1] - 1.0).abs());
        pulls.push((ranges[0] - ranges[1]) / f64::from(views[0].sigma.as_ref().unwrap()[(x, y)]));
    }
    assert!(pulls.len() > 5000, "{}", pulls.len());
    errors.sort_by(f64::total_cmp);
    // 0.3 px of a parallax of some 40 px.
    assert!(errors[errors.len() / 2] < 0.01, "{}", errors[errors.len() / 2]);
    let spread = (pulls.iter().map(|p| p * p).sum::<f64>() / pulls.len() as f64).sqrt();
    // Rounding is uniform, not normal, and its part along the line is as large as across it only on average.
    assert!((0.7..1.4).contains(&spread), "{spread}");
    // View B has as many, carried into A.
    let in_b = views[1].fill.data.iter().filter(|f| **f == Fill::Measured).count();
    assert!(in_b > 3000, "{in_b}");
}

#[test]
fn what_tells_nothing_gives_no_pose() {
    let camera = camera(SIDE, SIDE);
    let cameras = [&camera, &camera];
    let truth = truth(cameras, &true_pose(), Places::Whole);
    let anywhere = |k: usize, n: usize| {
        let mut bits = (k * 1009 + n) as u64;
        for _ in 0..3 {
            bits = (bits ^ (bits >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        }
        (bits >> 11) as f64 / (1u64 << 53) as f64
    };
    // The same picture twice: every match stands still, and sure points do not help.
    let still =
        Learned { matches: truth.matches.iter().map(|m| Match { b: m.a, ..*m }).collect(), ..truth.clone() };
    let solved = solve(cameras, &still, None, &LearnedOptions::default()).unwrap();
    assert!(matches!(
        solved.prediction.cam_b_from_cam_a,
        Err(NoPose::CannotSay(CannotSay::NoParallax { .. }))
    ));
    // As a network has it: a third of the matches are a pixel off, in steps that some direction explains better than others.
    for seed in 0..8 {
        let mut jittered = still.clone();
        for (k, m) in jittered.matches.iter_mut().enumerate() {
            let step =
                |n: usize| [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0][(7.0 * anywhere(k + 997 * seed, n)) as usize];
            m.b += selenograph_geometry::Vector2::new(step(101), step(389));
        }
        let found = solve(cameras, &jittered, None, &LearnedOptions::default()).unwrap();
        let pose = found.prediction.cam_b_from_cam_a;
        assert!(matches!(pose, Err(NoPose::CannotSay(CannotSay::NoParallax { .. }))), "{seed}: {pose:?}");
    }
    // Points that stand where they are seen from A: no parallax either.
    let maps = truth.pointmaps.as_ref().unwrap();
    let flat = Learned { pointmaps: Some([maps[0].clone(), maps[0].clone()]), ..truth.clone() };
    let options = LearnedOptions { pose: PoseFrom::Points, ..LearnedOptions::default() };
    let solved = solve(cameras, &flat, None, &options).unwrap();
    assert!(matches!(
        solved.prediction.cam_b_from_cam_a,
        Err(NoPose::CannotSay(CannotSay::NoParallax { .. }))
    ));
    // Noise: matches anywhere, points anywhere.
    let noise = Learned {
        matches: (0..300)
            .map(|k| Match {
                a: Point2::new(160.0 * anywhere(k, 101), 160.0 * anywhere(k, 389)),
                b: Point2::new(160.0 * anywhere(k, 617), 160.0 * anywhere(k, 211)),
                score: anywhere(k, 53),
            })
            .collect(),
        pointmaps: Some([0, 1].map(|_| Pointmap {
            points: Raster::from_fn(SIDE, SIDE, |x, y| {
                let k = y * SIDE + x;
                [anywhere(k, 71) as f32, anywhere(k, 307) as f32, 1.0 + anywhere(k, 211) as f32]
            }),
            confidence: Raster::filled(SIDE, SIDE, 0.9),
        })),
        ..truth.clone()
    };
    let solved = solve(cameras, &noise, None, &LearnedOptions::default()).unwrap();
    assert!(solved.prediction.cam_b_from_cam_a.is_err(), "{:?}", solved.prediction.cam_b_from_cam_a);
    // Smooth wrong matches, as a network gives of pictures with nothing in common: whole patches agree with a motion by chance,
    // which is only seen if a patch counts once.
    let mut fooled = 0;
    for seed in 0..12 {
        let mut smooth = still.clone();
        for m in &mut smooth.matches {
            let patch = 10 * (m.a.y as usize / 32) + m.a.x as usize / 32;
            let shift = |n: usize| (60.0 * (anywhere(patch + 211 * seed, n) - 0.5)).round();
            m.b += selenograph_geometry::Vector2::new(shift(101), shift(389));
        }
        let pose = |grain: Grain| {
            let smooth = Learned { grain, pointmaps: None, ..smooth.clone() };
            solve(cameras, &smooth, None, &LearnedOptions::default()).unwrap().prediction.cam_b_from_cam_a
        };
        assert!(pose(Grain::of_pixels(1.0, 32.0)).is_err(), "{seed}");
        fooled += usize::from(pose(Grain::of_pixels(1.0, 0.0)).is_ok());
    }
    assert!(fooled > 0, "no seed shows it");
    // A given pose that fits nothing: no size can be told.
    let known = KnownPose { cam_b_from_cam_a: true_pose(), metric: true };
    let error =
        solve(cameras, &Learned { matches: Vec::new(), ..noise }, Some(&known), &LearnedOptions::default());
    assert!(matches!(error, Err(Error::Undetermined { .. })), "{error:?}");
}

#[test]
fn a_matcher_gives_a_pose_and_arrays_of_another_size_are_refused() {
    let (camera, small) = (camera(SIDE, SIDE), camera(64, 64));
    let cameras = [&camera, &camera];
    let learned = truth(cameras, &true_pose(), Places::Whole);
    let matcher = Learned { pointmaps: None, ..learned.clone() };
    let solved = solve(cameras, &matcher, None, &LearnedOptions::default()).unwrap();
    let pose = solved.prediction.cam_b_from_cam_a.unwrap();
    assert!(solved.prediction.views.is_none() && (pose.origin().coords.norm() - 1.0).abs() < 1e-9);
    assert!(matches!(
        solve([&small, &camera], &learned, None, &LearnedOptions::default()),
        Err(Error::SizeMismatch { .. })
    ));
    let options = LearnedOptions { points: PointsFrom::Triangulated, ..LearnedOptions::default() };
    let without = Learned { dense_matches: None, ..learned };
    assert!(solve(cameras, &without, None, &options).is_err());
}
