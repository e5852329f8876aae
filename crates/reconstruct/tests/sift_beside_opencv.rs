//! Our SIFT beside OpenCV's on two synthetic pictures; `testdata/sift/make.py` says how they and its figures were made.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_geometry::{PixelConvention, Point2};
use selenograph_raster::Raster;
use selenograph_raster::codec::png;
use selenograph_reconstruct::features::{Features, sift};
use selenograph_reconstruct::matching;
use std::path::Path;

/// A point counts as found again within this distance, as in the script.
const FOUND_PX: f64 = 1.5;

/// Two implementations differ in borders, rounding and thresholds: this share of OpenCV's figure is asked for.
const SHARE_OF_OPENCV: f64 = 0.9;

/// Of OpenCV's strongest keypoints so many must be ours, each to `SAME_PX`: another convention of pixels or levels finds none.
const SHARE_OF_STRONGEST: f64 = 0.85;

/// Largest distance between the same keypoint of both.
const SAME_PX: f64 = 0.3;

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/sift"))
}

fn picture(name: &str) -> Raster<f32> {
    png::read(&folder().join(name)).unwrap().to_unit_grey()
}

fn opencv() -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(folder().join("opencv.json")).unwrap()).unwrap()
}

/// OpenCV's own resolution and threshold, without a limit.
fn options() -> sift::Options {
    sift::Options {
        first_octave: sift::FirstOctave::Doubled,
        contrast: 0.04,
        max_keypoints: 100_000,
        ..sift::Options::default()
    }
}

fn number(value: &serde_json::Value, key: &str) -> f64 {
    value[key].as_f64().unwrap()
}

/// Where the script puts a point of A in B, both measured from the corner.
fn mapped(opencv: &serde_json::Value, a: &Point2<f64>) -> Point2<f64> {
    let offset = PixelConvention::Center.to_corner_offset();
    let m = |i: usize, j: usize| opencv["b_from_a"][i][j].as_f64().unwrap();
    let [x, y] = [a.x - offset, a.y - offset];
    Point2::new(m(0, 0) * x + m(0, 1) * y + m(0, 2) + offset, m(1, 0) * x + m(1, 1) * y + m(1, 2) + offset)
}

fn repeatability(
    a: &Features<sift::Descriptor>,
    b: &Features<sift::Descriptor>,
    opencv: &serde_json::Value,
    side: f64,
) -> f64 {
    let inside = |p: &Point2<f64>| p.x.min(p.y) > 10.5 && p.x.max(p.y) < side - 10.5;
    let points: Vec<_> = a.keypoints.iter().map(|k| mapped(opencv, &k.at)).filter(inside).collect();
    let found = points.iter().filter(|p| b.keypoints.iter().any(|k| (k.at - **p).norm() < FOUND_PX)).count();
    found as f64 / points.len() as f64
}

#[test]
fn as_many_points_are_found_again_and_matched_as_by_opencv() {
    let opencv = opencv();
    let (a, b) = (picture("a.png"), picture("b.png"));
    let (found_a, found_b) = (sift::detect(&a, &options()), sift::detect(&b, &options()));
    let repeated = repeatability(&found_a, &found_b, &opencv, a.width as f64);
    let matches = matching::sift(&found_a, &found_b, &matching::Options { max_ratio: 0.8 });
    let errors = matches.iter().map(|m| (mapped(&opencv, &m.a) - m.b).norm());
    let correct = errors.filter(|error| *error < FOUND_PX).count();
    println!(
        "features {} {}, repeatability {repeated:.3}, matches {}, correct {correct}; OpenCV {} {} {:.3} {} {}",
        found_a.keypoints.len(),
        found_b.keypoints.len(),
        matches.len(),
        opencv["num_a"],
        opencv["num_b"],
        number(&opencv, "repeatability"),
        opencv["num_matches"],
        opencv["num_correct"],
    );
    assert!(repeated >= SHARE_OF_OPENCV * number(&opencv, "repeatability"));
    assert!(correct as f64 >= SHARE_OF_OPENCV * number(&opencv, "num_correct"));
    let precision = |correct: f64, all: f64| correct / all;
    let theirs = precision(number(&opencv, "num_correct"), number(&opencv, "num_matches"));
    assert!(precision(correct as f64, matches.len() as f64) >= SHARE_OF_OPENCV * theirs);
}

#[test]
fn the_strongest_keypoints_of_opencv_are_ours_too() {
    let offset = PixelConvention::Center.to_corner_offset();
    let found = sift::detect(&picture("a.png"), &options());
    let opencv = opencv();
    let strongest = opencv["strongest"].as_array().unwrap();
    let same = |place: &&serde_json::Value| {
        let v = |i: usize| place[i].as_f64().unwrap();
        let at = Point2::new(v(0) + offset, v(1) + offset);
        found
            .keypoints
            .iter()
            .any(|k| (k.at - at).norm() < SAME_PX && (2.0 * f64::from(k.sigma_px) / v(2) - 1.0).abs() < 0.1)
    };
    let share = strongest.iter().filter(same).count() as f64 / strongest.len() as f64;
    println!("{:.0} % of OpenCV's strongest keypoints are ours", 100.0 * share);
    assert!(share >= SHARE_OF_STRONGEST);
}
