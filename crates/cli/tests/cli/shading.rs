//! `reconstruct --shading`: when it joins stereo, what it leaves in the folder, and when it stays out.

use crate::campaign::with_terrain;
use crate::program::{Place, names};
use crate::reconstruct::with_pair;
use selenograph_raster::dem::{DemReader, OpenOptions};

/// A place with a pair of 160 × 160 pixels under two lights.
fn with_pair_folder() -> Place {
    let place = with_terrain();
    place
        .run(
            "generate tiny.toml --terrain terrain --out dataset --set oblique.pairs=0 --set dynamic.pairs=0 \
             --set camera.width_px=160 --set camera.height_px=160 -q",
        )
        .ok();
    place
}

const FOLDER: &str = "dataset/pairs/000/000000";
const SURFACE: [&str; 7] = [
    "albedo.tif",
    "albedo_sigma.tif",
    "slope_sigma.tif",
    "model_a.tif",
    "model_b.tif",
    "residual_a.tif",
    "residual_b.tif",
];

#[test]
fn shading_joins_stereo_where_both_suns_are_known() {
    let place = with_pair_folder();
    let run = |options: &str| {
        place.run(&format!(
            "reconstruct {FOLDER}/a.l0.png {FOLDER}/b.l0.png --camera-a {FOLDER}/a.camera.json --camera-b {FOLDER}/b.camera.json \
             --world-from-cam-a {FOLDER}/a.camera.json --world-from-cam-b {FOLDER}/b.camera.json --json {options}"
        ))
    };
    let answer = run("--complete --out joined").ok().json();
    let shading = &answer["shading"];
    assert_eq!((&shading["asked"], &shading["used"]), (&"auto".into(), &true.into()), "{answer}");
    for picture in ["picture_a", "picture_b"] {
        assert!(shading[picture]["correlation"].as_f64().unwrap() > 0.9, "{shading}");
        assert!(shading[picture]["sun_elevation_deg"].as_f64().unwrap() > 5.0, "{shading}");
        assert!(shading[picture]["sun_turned_deg"].as_f64().unwrap() < 1e-3, "{shading}");
    }
    let record = std::fs::read_to_string(place.path("joined/run.toml")).unwrap();
    assert!(record.contains("[outcome.shading]") && record.contains("shading_use = \"auto\""), "{record}");
    let files = names(&place.path("joined"));
    let page = std::fs::read_to_string(place.path("joined/report.html")).unwrap();
    for words in ["Picture less model", "Residual against slope", "Hillshade of stereo alone", "Albedo"] {
        assert!(page.contains(words), "{words}");
    }
    let read = |name: &str| {
        let path = place.path(&format!("joined/{name}"));
        DemReader::open(&path, &OpenOptions::default()).unwrap().read_all().unwrap()
    };
    let heights = read("dem.tif");
    // Sigma is there wherever a height is.
    let sigma = read("dem_sigma.tif");
    let without = heights
        .data
        .iter()
        .zip(&sigma.data)
        .filter(|(h, s)| h.is_finite() && (s.is_nan() || **s <= 0.0))
        .count();
    assert_eq!(without, 0, "cells without sigma of {}", heights.data.len());
    for name in SURFACE {
        assert!(files.iter().any(|file| file == name), "{name} in {files:?}");
        let raster = read(name);
        assert_eq!((raster.width, raster.height), (heights.width, heights.height), "{name}");
    }
    // The same gain for all cells: the albedo of ground of one albedo is about one.
    let albedo: Vec<f32> = read("albedo.tif").data.into_iter().filter(|a| a.is_finite()).collect();
    let mean = albedo.iter().sum::<f32>() / albedo.len() as f32;
    assert!(albedo.len() > heights.data.len() / 2 && (0.8..1.25).contains(&mean), "{} {mean}", albedo.len());

    let answer = run("--shading off --out stereo").ok().json();
    assert!(answer["shading"].is_null() && answer["sun_a"].is_null(), "{answer}");
    let files = names(&place.path("stereo"));
    assert!(SURFACE.iter().all(|name| !files.iter().any(|file| file == name)), "{files:?}");
    let [off, auto] = [run("--shading off --force --out x"), run("--shading on --no-report --force --out x")];
    assert_eq!((off.code, &auto.ok().json()["shading"]["asked"]), (0, &"on".into()));
}

#[test]
fn without_suns_auto_is_stereo_and_says_what_would_help() {
    let place = with_pair();
    let run =
        |options: &str| place.run(&format!("reconstruct a.png b.png --fov-deg 45 --no-report {options}"));
    let said = run("--out out --json").ok();
    let answer = said.json();
    assert_eq!(
        (&answer["shading"]["used"], &answer["shading"]["why_not"]),
        (&false.into(), &"no Sun is given".into())
    );
    assert_eq!(said.stderr.lines().filter(|line| line.contains("--sun-a")).count(), 1, "{}", said.stderr);
    run("--shading off --out off -q").ok();
    let bytes = |folder: &str| std::fs::read(place.path(&format!("{folder}/dem.tif"))).unwrap();
    assert_eq!(bytes("out"), bytes("off"));
    // One alone is none.
    let answer = run("--sun-a 0,-1,-1 --out one --json").ok().json();
    assert_eq!(answer["shading"]["why_not"], "the Sun of the second picture is not known");
}

#[test]
fn what_cannot_be_shaded_is_refused() {
    let place = with_pair();
    let before = place.names();
    let run = |options: &str| {
        place.run(&format!("reconstruct a.png b.png --fov-deg 45 --no-report --out out -q {options}"))
    };
    run("--shading on").refused("--shading on looks at shading, and no Sun is given", "--sun-a");
    run("--shading on --sun-a 0,-1,-1").refused("the Sun of the second picture is not known", "--sun-b");
    run("--shading on --sun-a 90,-3 --sun-b 90,-3").refused("above the horizon", "");
    run("--shading on --method sift").refused("--shading on is for the methods", "--method");
    run("--shading off --method fused").refused("--method fused, which is stereo and shading", "leave one");
    assert_eq!(place.names(), before, "something was left behind");
}

#[test]
fn a_surface_that_explains_nothing_leaves_stereo_as_it_is() {
    let place = with_pair();
    // Painted and not lit: no Sun explains these.
    let run = |options: &str| {
        place.run(&format!("reconstruct a.png b.png --fov-deg 45 --no-report --json {options}"))
    };
    let suns = "--sun-a 0,0.2,1 --sun-b 0,0.2,1";
    let answer = run(&format!("{suns} --out auto")).ok().json();
    assert_eq!(answer["shading"]["used"], false, "{answer}");
    let why = answer["shading"]["why_not"].as_str().unwrap();
    assert!(answer["warnings"].as_array().unwrap().iter().any(|w| w.as_str() == Some(why)), "{answer}");
    run("--shading off --out off").ok();
    let bytes = |folder: &str| std::fs::read(place.path(&format!("{folder}/dem.tif"))).unwrap();
    assert_eq!(bytes("auto"), bytes("off"));
}
