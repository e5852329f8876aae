//! Bad campaigns, terrains, cameras and datasets: one clear line, a hint, exit code 1, and nothing left behind.

use crate::campaign::{TINY, with_terrain};
use crate::program::{Answer, Place};

/// Runs `generate` on a changed campaign and asserts that it left nothing.
fn refused(change: impl Fn(&str) -> String, says: &str, hints: &str) -> Answer {
    let place = with_terrain();
    let text = change(TINY);
    assert_ne!(text, TINY, "the change does not change anything");
    place.write("tiny.toml", text);
    let before = place.names();
    let answer = place.run("generate tiny.toml --terrain terrain --out dataset").refused(says, hints);
    assert_eq!(place.names(), before);
    answer
}

#[test]
fn unknown_keys_get_a_suggestion() {
    let answer = refused(|text| text.replace("width_px", "widht_px"), "widht_px", "did you mean `width_px`");
    assert!(answer.stderr.contains("tiny.toml") && answer.stderr.contains("line 5"), "{}", answer.stderr);
    refused(|text| text.replace("[nadir]", "[nadire]"), "nadire", "did you mean `nadir`");
    Place::new()
        .run("config show --preset descent --set descent.pears=4")
        .refused("pears", "did you mean `pairs`");
}

#[test]
fn broken_toml() {
    refused(|text| text.replace("pairs = 1", "pairs = "), "tiny.toml", "config show");
    refused(|text| text.replace("pairs = 1", "pairs = \"many\""), "invalid type", "config show");
}

#[test]
fn contradictory_keys() {
    refused(
        |text| text.replace("[camera]", "[camera]\nfov_deg = 45.0\nfocal_px = 50.0"),
        "`camera.fov_deg` and `camera.focal_px` contradict each other",
        "leave one",
    );
    refused(
        |text| text.replace("max = -89.96", "max = -90.0").replace("min = -90.0", "min = -89.0"),
        "contradict each other",
        "leave one",
    );
}

#[test]
fn zero_rays() {
    refused(|text| text.replace("rays_per_pixel = 2", "rays_per_pixel = 0"), "rays_per_pixel", "config show");
    let place = with_terrain();
    place
        .run("render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --rays-per-pixel 0 --out picture")
        .refused("rays_per_pixel", "--help");
    assert!(!place.path("picture").exists());
}

#[test]
fn more_than_a_plan_can_hold() {
    refused(|text| text.replacen("pairs = 1", "pairs = 1000000000000", 1), "nadir.pairs", "config show");
    let place = with_terrain();
    #[cfg(unix)]
    place.run("plan /dev/zero --terrain terrain --out plan.csv").refused("/dev/zero", "");
}

#[test]
fn absurd_cameras() {
    refused(
        |text| text.replace("width_px = 48", "width_px = 0"),
        "`camera.width_px`: expected a number between 1 and",
        "",
    );
    refused(|text| text.replace("[camera]", "[camera]\nfov_deg = 180.0"), "field of view", "180 degrees");
    refused(|text| text.replace("[camera]", "[camera]\nfocal_px = -3.0"), "camera.focal_px", "");
    refused(
        |text| text.replace("[camera]", "[camera]\nprincipal_point_px = [24.0, 5000.0]"),
        "principal_point_px",
        "",
    );
}

#[test]
fn no_campaign_and_unknown_presets() {
    let place = with_terrain();
    place.run("generate --terrain terrain --out dataset").refused("no campaign is named", "--preset");
    place
        .run("generate --preset moon --terrain terrain --out dataset")
        .refused("no preset `moon`", "presets");
    place.run("plan nowhere.toml --terrain terrain --out plan.csv").refused("nowhere.toml", "check the path");
    place
        .run("plan tiny.toml --set nadir.pairs --terrain terrain --out p.csv")
        .refused("not an assignment", "key=value");
    assert_eq!(place.names(), ["terrain", "tiny.toml"]);
}

#[test]
fn terrain_smaller_than_the_view() {
    refused(
        |text| text.replace("altitude_levels_m = [4000.0]", "altitude_levels_m = [60000.0]"),
        "carries none of the 3 pairs",
        "larger or finer terrain",
    );
}

#[test]
fn holes_inside_the_footprint() {
    let place = with_terrain();
    let mut dem = crate::tiff::Dem::hills(256, 40.0);
    // A hole at the pole that every view of a site near it sees.
    for row in 100..156 {
        dem.heights[row * 256 + 100..row * 256 + 156].fill(f32::NAN);
    }
    place.write("holed.tif", dem.bytes());
    place.run("dem import holed.tif --out holed").ok();
    place.run("generate tiny.toml --terrain holed --out dataset").refused("carries none", "terrain");
    assert!(!place.path("dataset").exists());
}

#[test]
fn cameras_below_ground_or_off_the_terrain() {
    let place = with_terrain();
    let line = "render terrain --lon-deg 0 --width 16 --height 16 --out picture";
    place
        .run(&format!("{line} --lat-deg -90 --altitude-m -50"))
        .refused("below the terrain", "raise the camera");
    place
        .run(&format!("{line} --lat-deg 12 --altitude-m 3000"))
        .refused("no height at latitude 12", "dem info");
    place.run(&format!("{line} --lat-deg 95 --altitude-m 3000")).refused("no such place", "latitudes");
    place.run(&format!("{line} --lat-deg -90 --altitude-m 3000 --fov-deg 190")).refused("field of view", "");
    place
        .run(&format!("{line} --lat-deg -90 --altitude-m 3000 --tilt-deg 90"))
        .refused("tilt 90", "--tilt-deg");
    assert!(!place.path("picture").exists());
}

#[test]
fn what_is_no_terrain() {
    let place = with_terrain();
    std::fs::create_dir(place.path("folder")).unwrap();
    place
        .run("generate tiny.toml --terrain tiny.toml --out dataset")
        .refused("tiny.toml", "`selenograph dem import FILE");
    for terrain in ["folder", "nowhere", "tiny.toml"] {
        let answer = place.run(&format!("generate tiny.toml --terrain {terrain} --out dataset"));
        assert_eq!(answer.code, 1, "{}", answer.stderr);
        assert!(
            answer.stderr.starts_with("error: ") && answer.stderr.contains("hint: "),
            "{}",
            answer.stderr
        );
    }
    assert!(!place.path("dataset").exists());
}

#[test]
fn targets_of_something_else() {
    let place = with_terrain();
    std::fs::create_dir(place.path("dataset")).unwrap();
    place.write("dataset/diary.txt", "mine");
    place
        .run("generate tiny.toml --terrain terrain --out dataset")
        .refused("a folder of something else, not a dataset", "--out");
    let forced = place.run("generate tiny.toml --terrain terrain --out dataset --force");
    assert_eq!(forced.code, 1, "{}", forced.stderr);
    assert_eq!(std::fs::read(place.path("dataset/diary.txt")).unwrap(), b"mine");
    // Another campaign in the same folder is refused, and --force begins anew.
    place
        .run("generate tiny.toml --terrain terrain --out one --set oblique.pairs=0 --set dynamic.pairs=0")
        .ok();
    place
        .run("generate tiny.toml --terrain terrain --out one")
        .refused("was made by another campaign", "--force");
    place.run("generate tiny.toml --terrain terrain --out one --force --set dynamic.pairs=0").ok();
}

#[test]
fn folders_without_pairs() {
    let place = Place::new();
    std::fs::create_dir(place.path("empty")).unwrap();
    for command in ["data check", "data sheet --out x", "data export --out x", "data split --out x"] {
        let answer = place.run(&format!("{command} empty"));
        assert_eq!(answer.code, 1, "{command}: {}", answer.stderr);
        assert!(answer.stderr.starts_with("error: "), "{command}: {}", answer.stderr);
    }
    let file = place.write("some.csv", "1,2");
    place.run("data check some.csv").refused("some.csv", "a folder is expected");
    std::fs::remove_file(file).unwrap();
    place.run("data check nowhere").refused("nowhere", "check the path");
    assert_eq!(place.names(), ["empty"]);
}

#[test]
fn triplets_with_a_missing_npz() {
    let place = with_terrain();
    place
        .run("generate tiny.toml --terrain terrain --out dataset --set oblique.pairs=0 --set dynamic.pairs=0")
        .ok();
    place.run("data export dataset --out triplets").ok();
    let scene = place.path("triplets/nadir");
    std::fs::remove_file(scene.join("im_00001.npz")).unwrap();
    let answer = place.run("data check triplets --k-convention center");
    assert_eq!(answer.code, 1, "{}", answer.stdout);
    assert!(answer.stdout.contains("im_00001.npz"), "{}", answer.stdout);
    let report = place.run("data check triplets --k-convention center --json").json();
    let codes: Vec<&str> =
        report["findings"].as_array().unwrap().iter().map(|f| f["code"].as_str().unwrap()).collect();
    assert!(codes.contains(&"missing-file"), "{codes:?}");
}
