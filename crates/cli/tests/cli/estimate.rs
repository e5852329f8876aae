//! What a network will take, told before it takes it.

use crate::evaluate;
use crate::program::Place;
use selenograph_raster::Raster;
use selenograph_raster::codec::png;

const PAIR: &str =
    "reconstruct a.png b.png --fov-deg 45 --method mast3r --weights tiny.safetensors --out out";

/// A network, and two pictures that are large enough to take more memory than loading it does.
fn with_network() -> Place {
    let place = Place::new();
    place.run("weights random --preset tiny --out tiny.safetensors").ok();
    let picture = png::encode_grey8(&Raster::from_fn(320, 320, |x, y| (x * y % 251) as u8)).unwrap();
    place.write("a.png", &picture);
    place.write("b.png", &picture);
    place
}

#[test]
fn time_and_memory_are_told_and_nothing_is_run() {
    let place = with_network();
    let before = place.names();
    let told = place.run(&format!("{PAIR} --dry-run")).ok();
    for words in ["320×320 and 320×320", "GFLOP", " MB of ", "memory"] {
        assert!(told.stdout.contains(words), "{words}: {}", told.stdout);
    }
    let forward = place.run(&format!("{PAIR} --dry-run --json")).ok().json();
    let both = place.run(&format!("{PAIR} --dry-run --json --symmetric")).ok().json();
    assert!(forward["seconds"].as_f64().unwrap() > 0.0 && forward["allowed_bytes"].is_u64(), "{forward}");
    assert!(forward["bytes"].as_u64().unwrap() < both["bytes"].as_u64().unwrap());
    assert_eq!(forward["gflop"][0], both["gflop"][0]);
    assert_eq!(place.names(), before);
    place.run("reconstruct a.png b.png --dry-run --out out").refused("--dry-run is for", "--method mast3r");
}

#[test]
fn what_does_not_fit_is_refused_before_it_is_loaded() {
    let place = with_network();
    let need = |options: &str| {
        place.run(&format!("{PAIR} --dry-run --json {options}")).ok().json()["bytes"].as_u64().unwrap()
    };
    let (forward, both) = (need(""), need("--symmetric"));
    let allowed = |bytes: u64, options: &str| place.run(&format!("{PAIR} -q {options} --max-memory {bytes}"));
    allowed(both - 1, "--symmetric").refused("--max-memory allows", "leave --symmetric out");
    allowed(forward - 1, "").refused("would take", "--max-side 256 would fit");
    allowed(1_000_000, "").refused("--max-memory allows 1.00 MB", "smaller network");
    place.run(&format!("{PAIR} --max-memory lots")).refused("lots", "--help");
    assert!(!place.path("out").exists());
}

#[test]
fn an_evaluation_is_estimated_as_a_whole() {
    let place = evaluate::with_dataset();
    place.run("weights random --preset tiny --out tiny.safetensors").ok();
    let line =
        "evaluate dataset --method mast3r --weights tiny.safetensors --max-side 64 --out scores --dry-run";
    let told = place.run(&format!("{line} --json")).ok().json();
    assert!(told["num_pairs"].as_u64().unwrap() > 1);
    assert_eq!(told["inputs_px"][0], serde_json::json!([64, 64]));
    assert!(place.run(line).ok().stdout.contains("at most"));
    assert!(!place.path("scores").exists());
}
