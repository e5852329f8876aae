//! The method `mast3r` from outside, with networks that have learnt nothing: files and answers are right, terrain is not.

use crate::evaluate::{lines, with_dataset};
use crate::program::{Place, names};
use crate::reconstruct::with_pair;

/// Makes `tiny.safetensors` in a place.
fn with_weights(place: &Place) {
    place.run("weights random --preset tiny --out tiny.safetensors -q").ok();
}

const LEARNED: &str = "reconstruct a.png b.png --fov-deg 45 --method mast3r --weights tiny.safetensors";

#[test]
fn points_without_a_pose_leave_every_file_and_say_what_they_are() {
    let place = with_pair();
    with_weights(&place);
    let answer = place.run(&format!("{LEARNED} --pose-from nothing --out out --json")).ok();
    let first = answer.stderr.lines().next().unwrap();
    assert!(
        first.contains("CPU engine") && first.contains("16442728 parameters") && first.contains("threads")
    );
    for said in ["nothing checks them", "metric: false"] {
        assert!(answer.stderr.contains(said), "{said}: {}", answer.stderr);
    }
    assert!(answer.json()["pose"].is_null());
    let files = names(&place.path("out"));
    for name in
        ["cloud.glb", "cloud.las", "cloud.ply", "dem.tif", "hazard.tif", "hillshade.tif", "matches.npz"]
    {
        assert!(files.iter().any(|file| file == name), "{name} in {files:?}");
    }
    for name in
        ["pointmaps.npz", "products.json", "reconstruction.json", "report.html", "run.toml", "slope.tif"]
    {
        assert!(files.iter().any(|file| file == name), "{name} in {files:?}");
    }
    assert!(!files.iter().any(|file| file == "pose.json"));
    let text = |name: &str| std::fs::read_to_string(place.path("out").join(name)).unwrap();
    let products: serde_json::Value = serde_json::from_str(&text("products.json")).unwrap();
    assert_eq!((&products["metric"], &products["scale_source"]), (&false.into(), &"none".into()));
    let run = text("run.toml");
    for words in ["tiny.safetensors", "CC0-1.0", "rule = \"whole\"", "pose = \"nothing\""] {
        assert!(run.contains(words), "{words} in {run}");
    }
    assert!(text("report.html").contains("There is no relative pose"));
    // The same again, whatever the number of threads.
    place.run(&format!("{LEARNED} --pose-from nothing --out again --threads 1 --no-report -q")).ok();
    let bytes = |folder: &str| std::fs::read(place.path(folder).join("pointmaps.npz")).unwrap();
    assert!(bytes("out") == bytes("again"), "one thread gives other points");
}

#[test]
fn what_has_learnt_nothing_cannot_say_and_leaves_nothing() {
    let place = with_pair();
    with_weights(&place);
    let before = place.names();
    for choice in ["", "--pose-from points", "--points-from triangulated", "--symmetric"] {
        place.run(&format!("{LEARNED} {choice} --out out -q")).refused("cannot say", "");
    }
    // The same picture twice.
    place.run(&format!("{} --out out -q", LEARNED.replace("b.png", "a.png"))).refused("cannot say", "");
    assert_eq!(place.names(), before);
}

#[test]
fn weights_and_devices_that_cannot_be() {
    let place = with_pair();
    with_weights(&place);
    let refused = |line: &str, says: &str, hints: &str| {
        place.run(&format!("{line} --out out -q")).refused(says, hints);
    };
    refused(
        &LEARNED.replace("mast3r", "stereo"),
        "is for the methods `mast3r` and `mast3r-stereo`",
        "--method mast3r",
    );
    refused(&format!("{LEARNED} --device cuda"), "device `cuda`", "--device cpu");
    let stereo = LEARNED.replace("mast3r", "mast3r-stereo");
    refused(&format!("{stereo} --points-from triangulated"), "are for the method `mast3r`", "leave them out");
    refused(
        &format!("{LEARNED} --pose-from points --cam-b-from-cam-a pose.json"),
        "cannot be used with",
        "usage",
    );
    place.write("text.safetensors", "no network at all");
    refused(&LEARNED.replace("tiny", "text"), "not a checkpoint", "safetensors");
    // One tensor of another shape: the header says twice as many rows as the network needs half of.
    let whole = std::fs::read(place.path("tiny.safetensors")).unwrap();
    let (from, to) = (b"\"shape\":[128,512]", b"\"shape\":[512,128]");
    let at = whole.windows(from.len()).position(|bytes| bytes == from).unwrap();
    let mut wrong = whole.clone();
    wrong[at..at + to.len()].copy_from_slice(to);
    place.write("wrong.safetensors", wrong);
    let answer = place.run(&format!("{} --out out -q", LEARNED.replace("tiny", "wrong")));
    for words in ["is [512, 128], expected [128, 512]", "mlp.fc2.weight", "weights info"] {
        assert!(answer.stderr.contains(words), "{words}: {}", answer.stderr);
    }
    assert_eq!(answer.code, 1);
    place.write("cut.safetensors", &whole[..whole.len() / 2]);
    refused(&LEARNED.replace("tiny", "cut"), "truncated", "fetch");
}

#[test]
fn pictures_below_a_patch_and_of_odd_sizes() {
    let place = with_pair();
    with_weights(&place);
    let picture = |width: usize, height: usize| {
        let grey = selenograph_raster::Raster::from_fn(width, height, |x, y| (7 * x + 13 * y * y) as u8);
        selenograph_raster::codec::png::encode_grey8(&grey).unwrap()
    };
    let camera = |name: &str, width: usize, height: usize| {
        let text = format!("width_px = {width}\nheight_px = {height}\nfov_deg = 45.0\n");
        place.write(name, text);
    };
    place.write("a.png", picture(15, 40));
    place.write("b.png", picture(15, 40));
    place.run(&format!("{LEARNED} --out out -q")).refused("at least one patch of 16 pixels", "");
    // Landscape and portrait, padded and made smaller.
    place.write("a.png", picture(97, 61));
    place.write("b.png", picture(50, 130));
    camera("a.toml", 97, 61);
    camera("b.toml", 50, 130);
    let line = LEARNED.replace("--fov-deg 45", "--camera-a a.toml --camera-b b.toml");
    let answer = place.run(&format!("{line} --max-side 96 --pose-from nothing --no-report --out out")).ok();
    for said in [
        "`a.png`: for the network resized from 97×61 to 96×60",
        "`a.png`: for the network padded to 96×64",
        "`b.png`: for the network resized from 50×130 to 37×96",
        "`b.png`: for the network padded to 48×96",
    ] {
        assert!(answer.stderr.contains(said), "{said}: {}", answer.stderr);
    }
    let answer = place
        .run(&format!("{line} --max-side 96 --input published --pose-from nothing --no-report --out two"));
    assert!(answer.ok().stderr.contains("cropped to"));
}

#[test]
fn an_evaluation_names_its_network_and_goes_on_with_no_other() {
    let place = with_dataset();
    with_weights(&place);
    let line = "evaluate dataset --method mast3r --method plane --weights tiny.safetensors --out evaluation";
    let first = place.run(&format!("{line} --limit 2 --cross-light=beside --json")).ok().json();
    // Two pairs, two lights, both ways of mixing them, two methods.
    assert_eq!((&first["num_items"], &first["num_resumed"]), (&16.into(), &0.into()));
    let settings = first["methods"]["mast3r"]["settings"].as_str().unwrap();
    for words in ["tiny.safetensors", "BLAKE3", "CC0-1.0", "the whole picture"] {
        assert!(settings.contains(words), "{words}: {settings}");
    }
    let found = lines(&place.path("evaluation/mast3r/metrics.jsonl"));
    assert_eq!(found.len(), 8);
    for line in &found {
        // No pose, but points everywhere: they are measured.
        assert_eq!((&line["pose_failed"], &line["full"]["coverage"]), (&true.into(), &1.0.into()), "{line}");
    }
    let again = place.run(&format!("{line} --limit 2 --cross-light=beside --json")).ok().json();
    assert_eq!(again["num_resumed"], 16);
    place.run("weights random --preset tiny --seed 2 --out tiny.safetensors --force -q").ok();
    place
        .run(&format!("{line} --limit 2 --cross-light=beside -q"))
        .refused("other methods or settings", "--force");
    place
        .run("evaluate dataset --method plane --weights tiny.safetensors --out other -q")
        .refused("is for the methods `mast3r` and `mast3r-stereo`", "");
}

#[test]
fn the_builtin_network_is_a_checkpoint_like_any_other() {
    let place = with_pair();
    let info = place.run("weights info builtin --json").ok().json();
    assert!(info["complete"] == true && info["parameters"] == 6_560_778, "{info}");
    assert_eq!(info["license"], "MIT OR Apache-2.0");
    assert!(info["provenance"].as_str().unwrap().contains("synthetic"), "{info}");
    // At most 16 MB of every copy of the program.
    assert!(info["file_bytes"].as_u64().unwrap() < 16_000_000, "{info}");
    place.run("weights convert builtin --store-as f32 --out own.safetensors -q").ok();
    let line = "reconstruct a.png b.png --fov-deg 45 --no-report";
    let builtin = place.run(&format!("{line} --method mast3r-stereo --out builtin --json")).ok();
    assert!(builtin.stderr.contains("moon-hybrid (built in)"), "{}", builtin.stderr);
    let own =
        place.run(&format!("{line} --method mast3r-stereo --weights own.safetensors --out own --json")).ok();
    assert_eq!(builtin.json()["pose"], own.json()["pose"]);
    let points = place.run(&format!("{line} --method mast3r --out points"));
    assert!(points.stderr.contains("its own points are no terrain"), "{}", points.stderr);
    let run = std::fs::read_to_string(place.path("builtin/run.toml")).unwrap();
    assert!(
        run.contains("[settings.network.network]") && run.contains("[settings.pipeline.stereo]"),
        "{run}"
    );
}

/// Two Suns, 80° of azimuth apart, over ground that no network has seen.
const SUNS: &str = "lights=[{azimuth_deg=330.0,elevation_deg=20.0},{azimuth_deg=250.0,elevation_deg=20.0}]";

#[test]
fn the_builtin_network_matches_across_suns_where_features_cannot() {
    let place = Place::new();
    place.run("dem synth --size 1600 --cell-m 30 --seed 9 --out ground.tif -q").ok();
    place.run("dem import ground.tif --out ground -q").ok();
    let campaign = "generate --preset training --terrain ground --set nadir.pairs=2 --set oblique.pairs=0 \
        --set dynamic.pairs=0 --set camera.width_px=256 --set camera.height_px=256 \
        --set nadir.altitude_levels_m=[20000.0] --set nadir.b_over_h.min=0.25 --set sites.lat_deg.max=-89.8 --out pairs -q";
    let mut args: Vec<&str> = campaign.split_whitespace().collect();
    args.extend(["--set", SUNS]);
    place.run_args(&args).ok();
    place.run("evaluate pairs --method sift,mast3r --cross-light=only --out scores -q").ok();
    let sift = lines(&place.path("scores/sift/metrics.jsonl"));
    assert!(sift.len() == 4 && sift.iter().all(|line| line["pose_failed"] == true), "features may do it");
    for line in lines(&place.path("scores/mast3r/metrics.jsonl")) {
        let [turn, direction] = ["rra_deg", "rta_deg"].map(|key| line[key].as_f64().unwrap_or(180.0));
        println!("{} {}: {turn:.2}° {direction:.2}°", line["pair"], line["light_a"]);
        assert!(turn < 5.0 && direction < 10.0, "{turn} {direction}");
    }
}

/// Crops of which the cameras are known.
const APOLLO_NAMES: [&str; 2] = ["AS15-M-0297_crop.cub", "AS15-M-0298_crop.cub"];
/// Their focal lengths and principal points, pixels, from their labels.
const APOLLO_PX: [[f64; 3]; 2] = [[952.1, 216.24, 466.52], [952.1, -34.13, 403.92]];

/// Pictures on film, of which it has seen none: its matches lead to the pose that features lead to.
#[test]
fn shared_apollo_pair_is_matched_by_the_builtin_network() {
    let Some(folder) = crate::dem::shared("data/apollo15") else { return };
    let pictures = APOLLO_NAMES.map(|name| folder.join(name));
    if let Some(missing) = pictures.iter().find(|path| !path.is_file()) {
        eprintln!("SKIP shared-data: no {}", missing.display());
        return;
    }
    let pictures = pictures.map(|path| path.display().to_string());
    let place = Place::new();
    for (name, [f, cx, cy]) in ["a.toml", "b.toml"].into_iter().zip(APOLLO_PX) {
        let size = "width_px = 500\nheight_px = 500\npixel_convention = \"corner\"\n";
        place.write(name, format!("{size}fx_px = {f}\nfy_px = {f}\ncx_px = {cx}\ncy_px = {cy}\n"));
    }
    let pose = |method: &str| -> Vec<f64> {
        let cameras =
            ["--camera-a", "a.toml", "--camera-b", "b.toml", "--baseline-m", "1000", "--no-report", "-q"];
        let args = ["reconstruct", &pictures[0], &pictures[1], "--method", method, "--out", method];
        place.run_args(&[&args[..], &cameras[..]].concat()).ok();
        let pose = std::fs::read_to_string(place.path(method).join("pose.json")).unwrap();
        let pose: serde_json::Value = serde_json::from_str(&pose).unwrap();
        let rows = pose["cam_b_from_cam_a"].as_array().unwrap();
        rows.iter().flat_map(|row| row.as_array().unwrap()).map(|value| value.as_f64().unwrap()).collect()
    };
    let [features, network] = ["stereo", "mast3r-stereo"].map(pose);
    let largest = |of: fn(usize) -> bool| {
        let differences = features.iter().zip(&network).enumerate().filter(|(k, _)| of(*k));
        differences.map(|(_, (a, b))| (a - b).abs()).fold(0.0, f64::max)
    };
    // Radians, and metres of a baseline of 1000: three sigmas of the poses, some 0.015° and 0.03°.
    let (turn, shift_m) = (largest(|k| k % 4 < 3), largest(|k| k % 4 == 3));
    eprintln!("turn {turn:.6}, shift {shift_m:.3} m");
    assert!(turn < 8e-4 && shift_m < 1.7, "{turn} {shift_m}");
    eprintln!("RAN shared-data: shared_apollo_pair_is_matched_by_the_builtin_network");
}
