//! `evaluate`: a dataset measured, gone on with, compared, refused.

use crate::campaign::with_terrain;
use crate::program::{Place, names};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A place with `dataset`: three pairs of 48 × 48 pixels under two lights.
pub fn with_dataset() -> Place {
    static DATASET: OnceLock<Place> = OnceLock::new();
    let made = DATASET.get_or_init(|| {
        let place = with_terrain();
        place.run("generate tiny.toml --terrain terrain --out dataset").ok();
        place
    });
    let place = Place::new();
    copy(&made.path("dataset"), &place.path("dataset"));
    place
}

pub fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for name in names(from) {
        let (from, to) = (from.join(&name), to.join(&name));
        if from.is_dir() {
            copy(&from, &to);
        } else {
            std::fs::copy(from, to).unwrap();
        }
    }
}

pub fn lines(path: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn anchors_are_measured_and_everything_is_written() {
    let place = with_dataset();
    let summary = place
        .run("evaluate dataset --method truth --method plane --out evaluation --figures --json")
        .ok()
        .json();
    assert_eq!((&summary["num_items"], &summary["num_resumed"]), (&12.into(), &0.into()));
    let number = |method: &str, keys: &[&str]| {
        let start = &summary["methods"][method]["by_trajectory"]["all"]["numbers"];
        let found = keys.iter().fold(start, |value, key| &value[key]);
        found["value"].as_f64().unwrap_or_else(|| panic!("{method} {keys:?}: {found}"))
    };
    let point_error = ["full_frame", "overlap", "point_error_rel"];
    // The truth is its own answer, to the rounding of its f32 points.
    assert!(number("truth", &point_error) < 1e-6, "{}", number("truth", &point_error));
    assert!(number("plane", &point_error) > 1e-4);
    assert!(number("truth", &["pose", "AUC@5"]) > 0.999);
    assert_eq!(number("truth", &["full_frame", "overlap", "coverage"]), 1.0);
    assert_eq!(
        names(&place.path("evaluation")),
        ["figures", "plane", "plots", "report.html", "run.toml", "summary.json", "tables", "truth"]
    );
    let found = lines(&place.path("evaluation/truth/metrics.jsonl"));
    let items: Vec<(&str, u64)> =
        found.iter().map(|l| (l["pair"].as_str().unwrap(), l["light_a"].as_u64().unwrap())).collect();
    let expected: Vec<(&str, u64)> =
        ["000000", "000001", "000002"].into_iter().flat_map(|pair| [(pair, 0), (pair, 1)]).collect();
    assert_eq!(items, expected);
    assert!(
        found[0]["rra_deg"].as_f64().unwrap() < 1e-6 && found[0]["overlap"]["chamfer_10k_floor_m"].is_f64()
    );
    // One word, one number: the record's, the check's and the evaluation's.
    for line in &found {
        let pair = format!("dataset/pairs/000/{}/pair.json", line["pair"].as_str().unwrap());
        let record: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(place.path(&pair)).unwrap()).unwrap();
        for key in ["baseline_over_height", "relative_rotation_deg"] {
            let [told, found] = [&record[key], &line[key]].map(|value| value.as_f64().unwrap());
            assert!((told - found).abs() < 1e-9, "{pair} {key}: {told} {found}");
        }
    }
    let page = std::fs::read_to_string(place.path("evaluation/report.html")).unwrap();
    for words in ["paper-compatible form", "honest form", "floor / ceiling", "data:image/png;base64", "<svg"]
    {
        assert!(page.contains(words), "{words}");
    }
    for file in ["pose.csv", "pose_paper.tex", "terrain_overlap.md", "terrain_paper.txt", "by_light.txt"] {
        assert!(place.path("evaluation/tables").join(file).is_file(), "{file}");
    }
    assert_eq!(names(&place.path("evaluation/figures")), ["000000", "000001", "000002"]);
    let printed = place.run("evaluate dataset --method truth --method plane --out evaluation").ok();
    assert!(
        printed.stdout.starts_with("method")
            && printed.stdout.lines().count() == 3
            && printed.stderr.contains("12 of them there already")
    );
}

#[test]
fn a_killed_run_is_gone_on_with_and_gives_the_same_bytes() {
    let place = with_dataset();
    let line = "evaluate dataset --method plane --out evaluation";
    place.run(&format!("{line} --threads 2")).ok();
    let path: PathBuf = place.path("evaluation/metrics.jsonl");
    let whole = std::fs::read(&path).unwrap();
    // Cut inside the fourth line, as a kill in the middle of a write leaves it.
    let ends: Vec<usize> = (0..whole.len()).filter(|k| whole[*k] == b'\n').collect();
    std::fs::write(&path, &whole[..ends[2] + 40]).unwrap();
    let summary = place.run(&format!("{line} --threads 1 --json")).ok().json();
    assert_eq!((&summary["num_items"], &summary["num_resumed"]), (&6.into(), &3.into()));
    assert_eq!(std::fs::read(&path).unwrap(), whole);
    // A limit takes part of what is there; the rest stays in the file.
    let summary = place.run(&format!("{line} --limit 1 --json")).ok().json();
    assert_eq!((&summary["num_items"], &summary["num_resumed"]), (&2.into(), &2.into()));
    assert_eq!(std::fs::read(&path).unwrap(), whole);
}

#[test]
fn lights_are_crossed() {
    let place = with_dataset();
    place.run("evaluate dataset --method truth --cross-light --trajectory nadir --out crossed").ok();
    let found = lines(&place.path("crossed/metrics.jsonl"));
    let lights: Vec<(u64, u64)> =
        found.iter().map(|l| (l["light_a"].as_u64().unwrap(), l["light_b"].as_u64().unwrap())).collect();
    assert_eq!(lights, [(0, 1), (1, 0)]);
    // Azimuths 330° and 180°, elevations 20° and 15°.
    let (a, b) = (20f64.to_radians(), 15f64.to_radians());
    let cosine = a.sin() * b.sin() + a.cos() * b.cos() * 150f64.to_radians().cos();
    let angle = found[0]["illumination_difference_deg"].as_f64().unwrap();
    assert!((angle - cosine.acos().to_degrees()).abs() < 1e-6, "{angle}");
    place.run("evaluate dataset --method truth --cross-light=beside --pairs 0,2 --out both").ok();
    assert_eq!(lines(&place.path("both/metrics.jsonl")).len(), 8);
}

#[test]
fn broken_pairs_are_left_out_and_listed() {
    let place = with_dataset();
    let pair = |n: u32| place.path(&format!("dataset/pairs/000/00000{n}"));
    let picture = std::fs::read(pair(0).join("b.l1.png")).unwrap();
    std::fs::write(pair(0).join("b.l1.png"), &picture[..picture.len() / 2]).unwrap();
    std::fs::write(pair(1).join("a.depth_z.exr"), b"no picture").unwrap();
    let answer = place.run("evaluate dataset --method truth --out evaluation --json");
    assert_eq!(answer.code, 3, "{}", answer.stderr);
    assert_eq!(answer.json()["num_items"], 3);
    let skips: Vec<&str> = answer.stderr.lines().filter(|line| line.starts_with("skipped: ")).collect();
    assert_eq!(skips.len(), 2, "{}", answer.stderr);
    assert!(skips[0].contains("000000 light 1") && skips[1].contains("000001"), "{skips:?}");
    // What is mended is done the next time.
    std::fs::write(pair(0).join("b.l1.png"), picture).unwrap();
    let answer = place.run("evaluate dataset --method truth --out evaluation --json");
    assert_eq!((answer.code, &answer.json()["num_items"]), (3, &4.into()));
}

#[test]
fn what_cannot_be_evaluated_is_refused() {
    let place = with_dataset();
    place.run("evaluate dataset --method plain --out e").refused("no method `plain`", "did you mean `plane`");
    place.run("evaluate nowhere --method truth --out e").refused("nowhere", "check the path");
    for (set, says, hint) in [
        ("shading.noize=0.1", "setting `shading.noize`", "did you mean `noise`?"),
        ("method=orb", "expected a key of orb, sift, stereo, shading", "run.toml"),
        ("shading.noise", "is not an assignment", "shading.estimate_weights=false"),
    ] {
        place.run(&format!("evaluate dataset --method stereo --set {set} --out e")).refused(says, hint);
    }
    std::fs::create_dir(place.path("empty")).unwrap();
    place.run("evaluate empty --method truth --out e").refused("no pairs to evaluate", "`pairs/…`");
    place
        .run("evaluate dataset --method truth --pairs 77 --out e")
        .refused("filters leave none of 3", "--pairs");
    place
        .run("evaluate dataset --method truth --trajectory nadri --out e")
        .refused("no trajectory `nadri`", "nadir");
    place.run("evaluate dataset --method truth --out e").ok();
    place.run("evaluate dataset --method plane --out e").refused("other methods or settings", "--force");
    place.run("evaluate dataset --method plane --out e --force").ok();
    std::fs::create_dir(place.path("other")).unwrap();
    place.write("other/file", "");
    place
        .run("evaluate dataset --method truth --out other --force")
        .refused("a folder of something else, not an evaluation", "--out");
    for n in 0..3 {
        for view in ["a", "b"] {
            std::fs::remove_file(place.path(&format!("dataset/pairs/000/00000{n}/{view}.depth_z.exr")))
                .unwrap();
        }
    }
    place.run("evaluate dataset --method truth --out blind").refused("has no truth", "reconstruct");
    assert!(!place.path("blind").exists());
}

/// Root of the shared data.
fn shared() -> Option<PathBuf> {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        PathBuf::from,
    );
    let samples = root.join("data/stereolunar").canonicalize().ok()?;
    samples.is_dir().then_some(samples)
}

#[test]
fn shared_samples_have_exact_poses_and_their_floors() {
    let Some(samples) = shared() else {
        eprintln!("SKIP shared-data: the samples of the paper are not there");
        return;
    };
    let scenes = names(&samples);
    // What follows is known of pictures straight down.
    let Some(scene) = scenes.iter().find(|scene| scene.starts_with("nadir")) else {
        eprintln!("SKIP shared-data: no nadir scene among {scenes:?}");
        return;
    };
    let files = names(&samples.join(scene));
    let num_pictures = files.iter().filter(|name| name.ends_with(".jpg")).count();
    let place = Place::new();
    let samples = samples.display().to_string();
    let args = ["evaluate", &samples, "--method", "sift,truth", "--pairs", scene, "--out", "e", "--json"];
    let summary = place.run_args(&args).ok().json();
    // Two methods on each pair of pictures.
    assert_eq!(summary["num_items"], num_pictures);
    for line in lines(&place.path("e/sift/metrics.jsonl")) {
        assert!(line["rra_deg"].as_f64().unwrap() < 0.05, "{}", line["rra_deg"]);
        assert!(line["rta_deg"].as_f64().unwrap() < 0.2, "{}", line["rta_deg"]);
        assert!(line["overlap"]["point_error_rel"].is_null(), "a method that gives a pose only");
    }
    for line in lines(&place.path("e/truth/metrics.jsonl")) {
        let floor = line["reference_frame"]["full"]["chamfer_10k_floor_pct_bbox"].as_f64().unwrap();
        // Known of these pairs: 0.3 to 0.5 % of the box between two draws of 10 000 points.
        assert!((0.2..0.5).contains(&floor), "{floor}");
        assert!(line["overlap"]["slope_corr_gsd_ceiling"].as_f64().unwrap() < 0.99);
        assert_eq!(line["truth_is_half_float"], true);
    }
    eprintln!("RAN shared-data: shared_samples_have_exact_poses_and_their_floors");
}
