//! From a synthetic terrain to triplets, with small pictures.

use crate::program::{Place, names};
use crate::tiff::Dem;
use selenograph_raster::codec::exr;
use std::sync::OnceLock;

/// A campaign that takes no time: three pairs of 48 × 48 pixels under two lights.
pub const TINY: &str = "name = \"tiny\"\nseed = 3\n\
    lights = [{ azimuth_deg = 330.0, elevation_deg = 20.0 }, { azimuth_deg = 180.0, elevation_deg = 15.0 }]\n\
    [camera]\nwidth_px = 48\nheight_px = 48\n\
    [sites]\nlat_deg = { min = -90.0, max = -89.96 }\n\
    [limits]\nmin_overlap = 0.3\nmax_coarse_share = 1.0\n\
    [nadir]\npairs = 1\naltitude_levels_m = [4000.0]\n\
    [oblique]\npairs = 1\naltitude_levels_m = [4000.0]\n\
    [dynamic]\npairs = 1\naltitude_levels_m = [4000.0]\n\
    [render]\nrays_per_pixel = 2\n[tone]\nbits = 8\n";

/// A place with `terrain` (10 km round the pole in cells of 40 m) and `tiny.toml`.
pub fn with_terrain() -> Place {
    static TERRAIN: OnceLock<Place> = OnceLock::new();
    let made = TERRAIN.get_or_init(|| {
        let place = Place::new();
        place.run("dem synth --size 256 --cell-m 40 --relief 0.5 --out moon.tif").ok();
        place.run("dem import moon.tif --out terrain").ok();
        place
    });
    let place = Place::new();
    std::fs::create_dir(place.path("terrain")).unwrap();
    for name in names(&made.path("terrain")) {
        std::fs::copy(made.path("terrain").join(&name), place.path("terrain").join(&name)).unwrap();
    }
    place.write("tiny.toml", TINY);
    place
}

#[test]
fn pairs_are_made_resumed_checked_shown_split_and_exported() {
    let place = with_terrain();
    let dry = place.run("generate tiny.toml --terrain terrain --out dataset --dry-run").ok();
    assert!(
        dry.stdout.contains("3 pairs under 2 lights") && !place.path("dataset").exists(),
        "{}",
        dry.stdout
    );
    let dry = place.run("generate tiny.toml --terrain terrain --out dataset --dry-run --json").ok().json();
    assert_eq!((&dry["num_pairs"], &dry["num_lights"]), (&3.into(), &2.into()));
    let report = place.run("generate tiny.toml --terrain terrain --out dataset --json").ok().json();
    assert_eq!((&report["num_done"], &report["num_resumed"]), (&3.into(), &0.into()));
    let pair = place.path("dataset/pairs/000/000001");
    let files = names(&pair);
    for name in ["a.depth_z.exr", "b.l1.png", "a.l0.lit.png", "b.camera.json", "pair.json"] {
        assert!(files.iter().any(|file| file == name), "{name} in {files:?}");
    }
    // The same command goes on: here one pair was lost.
    let before = std::fs::read(pair.join("a.l0.png")).unwrap();
    std::fs::remove_dir_all(&pair).unwrap();
    let check = place.run("data check dataset");
    assert!(check.code == 1 && check.stdout.contains("the plan has this pair"), "{}", check.stdout);
    let again = place.run("generate tiny.toml --terrain terrain --out dataset --json").ok();
    assert!(again.stderr.contains("the plan is there"), "{}", again.stderr);
    let report = again.json();
    assert_eq!((&report["num_done"], &report["num_resumed"]), (&1.into(), &2.into()));
    assert_eq!(before, std::fs::read(pair.join("a.l0.png")).unwrap(), "a pair is a function of its number");

    let check = place.run("data check dataset --json").ok().json();
    assert_eq!(check["num_pairs"], 3);
    let sheets = place.run("data sheet dataset --out sheets --thumbnail-px 48 --json").ok().json();
    assert_eq!(sheets["num_pages"], 1);
    assert_eq!(names(&place.path("sheets")), ["run.toml", "sheet_000.png"]);
    place.run("data split dataset --out split.json --val-share 0.34").ok();
    let split: serde_json::Value =
        serde_json::from_slice(&std::fs::read(place.path("split.json")).unwrap()).unwrap();
    let count = |part: &str| split[part].as_array().unwrap().len();
    assert_eq!(count("train") + count("val") + count("left_out"), 3);
    let summary = place.run("data export dataset --split split.json --out triplets --json").ok().json();
    assert_eq!((&summary["num_pairs"], &summary["num_images"]), (&3.into(), &12.into()));
    place.run("data check triplets --k-convention center").ok();
    // Pictures that were swapped are found by whatever reads them, unless it is told not to look.
    std::fs::copy(pair.join("b.l0.png"), pair.join("a.l0.png")).unwrap();
    place.run("data export dataset --out swapped").refused("checksum", "");
    place.run("data export dataset --out swapped --no-verify").ok();
    let scored = place.run("evaluate dataset --method plane --out scores");
    assert!(scored.code == 3 && scored.stderr.contains("checksum"), "{}", scored.stderr);
    place.run("evaluate dataset --method plane --no-verify --out unseen").ok();
}

#[test]
fn a_plan_is_a_table_that_can_be_rendered_later() {
    let place = with_terrain();
    place.run("plan tiny.toml --terrain terrain --out plan.csv").ok();
    let plan = std::fs::read_to_string(place.path("plan.csv")).unwrap();
    assert!(plan.starts_with("pair_id,trajectory,") && plan.lines().count() == 4, "{plan}");
    place.run("plan tiny.toml --terrain terrain --out again.csv --threads 1").ok();
    assert_eq!(plan, std::fs::read_to_string(place.path("again.csv")).unwrap());
    place.run("generate tiny.toml --terrain terrain --plan plan.csv --out one").ok();
    place.run("generate tiny.toml --terrain terrain --out two").ok();
    let picture = "pairs/000/000002/b.l1.png";
    assert_eq!(
        std::fs::read(place.path("one").join(picture)).unwrap(),
        std::fs::read(place.path("two").join(picture)).unwrap()
    );
}

#[test]
fn one_picture_with_its_maps() {
    let place = with_terrain();
    let record = place
        .run("render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --width 32 --height 32 --rays-per-pixel 2 --out picture --json")
        .ok()
        .json();
    let over = record["camera"]["altitude_over_terrain_m"].as_f64().unwrap();
    assert!((over - 3000.0).abs() < 1e-6, "{over}");
    assert_eq!(
        names(&place.path("picture")),
        ["depth_z.png", "lit.png", "picture.png", "record.json", "run.toml", "slope.png", "truth.exr"]
    );
}

#[test]
fn a_sun_below_the_horizon_makes_a_dark_picture_and_says_so() {
    let place = with_terrain();
    let line = "render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --width 16 --height 16 --rays-per-pixel 1";
    let answer = place.run(&format!("{line} --sun-elevation-deg -40 --out dark --json")).ok();
    assert!(answer.stderr.contains("below the horizon"), "{}", answer.stderr);
    assert_eq!(answer.json()["lit_share"], 0.0);
}

#[test]
fn presets_and_settings_can_be_read() {
    let place = Place::new();
    let presets = place.run("presets --json").ok().json();
    for preset in presets.as_array().unwrap() {
        let name = preset["name"].as_str().unwrap();
        let text = place.run(&format!("presets {name}")).ok().stdout;
        assert!(text.contains(&format!("name = \"{name}\"")));
    }
    let settings =
        place.run("config show --preset descent --set descent.pairs=5 --seed 9 --json").ok().json();
    let of = |key: &str| {
        let entries = settings.as_array().unwrap();
        entries.iter().find(|entry| entry["key"] == key).unwrap_or_else(|| panic!("{key}")).clone()
    };
    assert_eq!(of("descent.pairs")["value"], 5);
    assert_eq!(of("descent.pairs")["origin"], "--set descent.pairs");
    assert_eq!(of("seed")["value"], 9);
    assert_eq!(of("sites.placement")["origin"], "preset descent");
    assert_eq!(of("limits.max_attempts")["origin"], "default");
}

#[test]
fn an_albedo_map_scales_the_picture() {
    let place = with_terrain();
    // 4 km round the pole: bright in the west, dark in the east; the picture sees 2.5 km.
    let side = 8;
    let values = (0..side * side).map(|k| if k % side < side / 2 { 0.4 } else { 0.1 }).collect();
    place.write("map.tif", Dem { heights: values, ..Dem::hills(side, 500.0) }.bytes());
    let line = "render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --width 24 --height 24 --rays-per-pixel 4 \
                --psf-sigma-px 0 --json --out";
    place.run(&format!("{line} plain")).ok();
    let record = place.run(&format!("{line} mapped --albedo map.tif")).ok().json();
    assert_eq!((&record["albedo"]["file"], &record["albedo"]["band"]), (&"map.tif".into(), &1.into()));
    let mean = record["albedo"]["mean"].as_f64().unwrap();
    assert!((mean - 0.25).abs() < 1e-6 && record["albedo"]["elsewhere"].as_f64() == Some(mean));
    let radiance = |folder: &str| {
        let truth = exr::read(&place.path(folder).join("truth.exr")).unwrap();
        truth.channel("radiance_factor").unwrap().samples.clone()
    };
    let ratios: Vec<f32> = radiance("mapped")
        .into_iter()
        .zip(radiance("plain"))
        .filter(|(_, plain)| *plain > 0.0)
        .map(|(mapped, plain)| mapped / plain)
        .collect();
    assert!(ratios.len() > 200);
    // Between the nodes on both sides of the step values are blended.
    let count = |albedo: f32| ratios.iter().filter(|ratio| (*ratio - albedo).abs() < 1e-3).count();
    assert!(count(0.4) > 60 && count(0.1) > 60, "{} {}", count(0.4), count(0.1));
    assert!(ratios.iter().all(|ratio| (0.0999..0.4001).contains(ratio)));

    place.write("below.tif", Dem::flat(8, -1.0).bytes());
    place.run(&format!("{line} no --albedo below.tif")).refused("goes down to -1", "--albedo-band");
    place
        .run(&format!("{line} no --albedo map.tif --albedo-elsewhere -2"))
        .refused("--albedo-elsewhere -2", "at least 0");
    place.run(&format!("{line} no --albedo map.tif --albedo-band 3")).refused("band 3", "count from 1");
    place.run(&format!("{line} no --albedo-band 1")).refused("--albedo", "");
}
