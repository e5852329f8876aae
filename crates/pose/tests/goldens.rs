//! The same answers as PoseLib and OpenCV; `testdata/make_goldens.py` asked them.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_geometry::{Enu, Matrix3, Point2, Point3, PredA, Sim3, Vector3};
use selenograph_pose::absolute::{self, AbsoluteOptions, Sighting};
use selenograph_pose::decompose::Motion;
use selenograph_pose::problems::angle_of;
use selenograph_pose::relative::{Match, RelativeOptions, estimate};
use selenograph_pose::solvers::essential_5pt;
use selenograph_pose::solvers::homography_4pt::{homography_4pt, homography_linear};
use selenograph_pose::solvers::p3p::p3p;
use selenograph_pose::solvers::umeyama::{Scaling, umeyama};
use serde_json::Value;

const FOCAL: f64 = 618.0;
/// PoseLib's minimal solvers reach this on all but a few problems; so must ours, against them.
const MINIMAL: f64 = 1e-5;
/// Share of those problems, as PoseLib's own accuracy has it.
const MINIMAL_SHARE: f64 = 0.95;

fn goldens() -> Value {
    serde_json::from_str(include_str!("../testdata/goldens.json")).unwrap()
}

fn rows(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().unwrap().iter().map(numbers).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn matrix(value: &Value) -> Matrix3<f64> {
    let r = rows(value);
    Matrix3::from_fn(|i, j| r[i][j])
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_vec(numbers(value))
}

fn up_to_sign(p: &Matrix3<f64>, q: &Matrix3<f64>) -> f64 {
    let (p, q) = (p.normalize(), q.normalize());
    (p - q).norm().min((p + q).norm())
}

#[test]
fn five_points_give_all_motions_of_poselib() {
    let (mut near, mut all) = (0, 0);
    for problem in goldens()["five_points"].as_array().unwrap() {
        let matches = rows(&problem["matches"]);
        let a = std::array::from_fn(|k| Vector3::new(matches[k][0], matches[k][1], 1.0));
        let b = std::array::from_fn(|k| Vector3::new(matches[k][2], matches[k][3], 1.0));
        let mut models = vec![];
        essential_5pt(&a, &b, &mut models);
        for motion in problem["motions"].as_array().unwrap() {
            let theirs =
                Motion { rotation: matrix(&motion["rotation"]), translation: vector(&motion["translation"]) };
            let e = theirs.essential();
            all += 1;
            near += usize::from(models.iter().any(|m| up_to_sign(m, &e) < MINIMAL));
        }
    }
    println!("{near} of {all}");
    assert!(near as f64 >= MINIMAL_SHARE * f64::from(all), "{near} of {all}");
}

#[test]
fn three_points_give_the_poses_of_poselib_and_no_others() {
    for (i, problem) in goldens()["three_points"].as_array().unwrap().iter().enumerate() {
        let (world, image) = (rows(&problem["world"]), rows(&problem["image"]));
        let points = std::array::from_fn(|k| Vector3::new(world[k][0], world[k][1], world[k][2]));
        let directions = std::array::from_fn(|k| Vector3::new(image[k][0], image[k][1], 1.0).normalize());
        let mut models = vec![];
        p3p(&points, &directions, &mut models);
        let theirs = problem["poses"].as_array().unwrap();
        assert_eq!(models.len(), theirs.len(), "{i}");
        for pose in theirs {
            let (r, t) = (matrix(&pose["rotation"]), vector(&pose["translation"]));
            let best = models
                .iter()
                .map(|m| (m.rotation - r).norm() + (m.translation - t).norm())
                .fold(1e9, f64::min);
            assert!(best < MINIMAL, "{i}: {best}");
        }
    }
}

#[test]
fn homographies_are_those_of_opencv() {
    for (i, problem) in goldens()["homography"].as_array().unwrap().iter().enumerate() {
        let matches = rows(&problem["matches"]);
        let theirs = matrix(&problem["homography"]);
        if matches.len() == 4 {
            let a = std::array::from_fn(|k| Vector3::new(matches[k][0], matches[k][1], 1.0));
            let b = std::array::from_fn(|k| Vector3::new(matches[k][2], matches[k][3], 1.0));
            let ours = homography_4pt(&a, &b).unwrap();
            assert!(up_to_sign(&ours, &theirs) < 1e-6, "{i}: {}", up_to_sign(&ours, &theirs));
        } else {
            let ours = homography_linear(matches.iter().map(|m| ([m[0], m[1], m[2], m[3]], 1.0))).unwrap();
            // OpenCV goes on to the least geometric error: that differs from the normalised linear fit by a part of the noise.
            assert!(up_to_sign(&ours, &theirs) < 0.1 / FOCAL, "{i}: {}", up_to_sign(&ours, &theirs));
        }
    }
}

#[test]
fn similarities_are_those_of_opencv() {
    for problem in goldens()["umeyama"].as_array().unwrap() {
        let point = |v: &Vec<f64>| Point3::new(v[0], v[1], v[2]);
        let pairs: Vec<_> = rows(&problem["from"])
            .iter()
            .zip(&rows(&problem["to"]))
            .map(|(p, q)| (point(p), point(q), 1.0))
            .collect();
        let found: Sim3<Enu, PredA> = umeyama(pairs, Scaling::Free).unwrap();
        // Inputs and answers are stored with twelve digits.
        assert!((found.scale() / problem["scale"].as_f64().unwrap() - 1.0).abs() < 1e-9);
        assert!((found.rotation() - matrix(&problem["rotation"])).amax() < 1e-9);
        assert!((found.origin().coords - vector(&problem["translation"])).amax() < 1e-8);
    }
}

/// Our error to the truth may exceed theirs by this factor and floor: both fit the same noise, with other weights.
const NO_WORSE: f64 = 1.3;
const FLOOR_DEG: f64 = 0.02;

#[test]
fn relative_poses_are_no_worse_than_theirs() {
    let (mut ours, mut poselib, mut opencv) = (0.0, 0.0, 0.0);
    for problem in goldens()["relative"].as_array().unwrap() {
        let matches: Vec<Match> = rows(&problem["matches"])
            .iter()
            .map(|m| Match { a: Point2::new(m[0], m[1]), b: Point2::new(m[2], m[3]), score: 1.0 })
            .collect();
        let options = RelativeOptions { threshold: 1.0 / FOCAL, ..RelativeOptions::default() };
        let found = estimate(&matches, &options).unwrap().cam_b_from_cam_a;
        let t = vector(&problem["translation"]);
        let rotation = angle_of(&(found.rotation() * matrix(&problem["rotation"]).transpose())).to_degrees();
        let direction =
            found.origin().coords.cross(&t).norm().atan2(found.origin().coords.dot(&t)).to_degrees();
        let theirs = |name: &str| numbers(&problem["errors_deg"][name]);
        let best: Vec<f64> = theirs("poselib").iter().zip(theirs("opencv")).map(|(p, o)| p.min(o)).collect();
        println!("{}: {rotation:.4} {direction:.4}; best of theirs {best:.4?}", problem["kind"]);
        assert!(
            rotation < NO_WORSE * best[0] + FLOOR_DEG && direction < NO_WORSE * best[1] + 5.0 * FLOOR_DEG
        );
        ours += direction;
        poselib += theirs("poselib")[1];
        opencv += theirs("opencv")[1];
    }
    println!("sum of direction errors: {ours:.3}, PoseLib {poselib:.3}, OpenCV {opencv:.3}");
    assert!(ours < 1.1 * poselib && ours < 0.5 * opencv);
}

#[test]
fn cameras_are_no_worse_than_theirs() {
    for problem in goldens()["absolute"].as_array().unwrap() {
        let sightings: Vec<Sighting> = rows(&problem["world"])
            .iter()
            .zip(&rows(&problem["image"]))
            .map(|(x, p)| Sighting { world: Point3::new(x[0], x[1], x[2]), image: Point2::new(p[0], p[1]) })
            .collect();
        let found =
            absolute::estimate::<Enu>(&sightings, &AbsoluteOptions::default()).unwrap().cam_from_world;
        let rotation = angle_of(&(found.rotation() * matrix(&problem["rotation"]).transpose())).to_degrees();
        let place = (found.origin().coords - vector(&problem["translation"])).norm();
        let theirs = numbers(&problem["errors"]["poselib"]);
        println!("{rotation:.4} {place:.5}; PoseLib {theirs:.5?}");
        assert!(rotation < NO_WORSE * theirs[0] + FLOOR_DEG && place < NO_WORSE * theirs[1] + 1e-3);
    }
}
