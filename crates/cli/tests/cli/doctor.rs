//! `doctor`.

use crate::program::Place;

#[test]
fn it_tells_what_runs_here() {
    let place = Place::new();
    let report = place.run("doctor --json --threads 2").ok().json();
    for key in ["version", "processor", "memory", "disk", "devices", "weights", "programs", "shared_data"] {
        assert!(report.get(key).is_some(), "{key}: {report}");
    }
    assert_eq!(report["processor"]["threads"], 2);
    assert!(report["processor"]["product_gflop_per_s"].as_f64().unwrap() > 0.0);
    let devices = report["devices"].as_array().unwrap();
    let names: Vec<&str> = devices.iter().map(|device| device["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["cpu", "cuda", "wgpu"]);
    assert_eq!(devices[0]["ready"], true);
    assert_eq!(report["weights"].as_array().unwrap().len(), 0);
    let told = place.run("doctor").ok();
    for words in ["threads", "free of", "GFLOP/s", "cpu: ", "weights random", "ffmpeg"] {
        assert!(told.stdout.contains(words), "{words}: {}", told.stdout);
    }
    assert!(told.stderr.is_empty() && place.names().is_empty());
}

#[test]
fn a_broken_file_beside_a_good_one_is_told_in_one_line() {
    let place = Place::new();
    place.run("weights random --preset tiny --seed 3 --out good.safetensors").ok();
    place.write("broken.pth", "not weights, not at all");
    place.write("notes.txt", "weights are elsewhere");
    let told = place.run("doctor").ok().stdout;
    let lines_with = |word: &str| told.lines().filter(|line| line.contains(word)).collect::<Vec<_>>();
    assert_eq!((lines_with("broken.pth").len(), lines_with("good.safetensors").len()), (1, 1), "{told}");
    assert!(lines_with("broken.pth")[0].contains("not readable"), "{told}");
    for words in ["MASt3R tiny", "16442728 parameters in f32", "CC0"] {
        assert!(lines_with("good.safetensors")[0].contains(words), "{words}: {told}");
    }
    // Named, it is what was asked for, and found once all the same.
    let named = place.run("doctor broken.pth good.safetensors --json");
    assert_eq!(named.code, 1, "{}", named.stderr);
    let weights = named.json()["weights"].clone();
    assert_eq!(weights.as_array().unwrap().len(), 2);
    assert!(weights[0]["error"].as_str().unwrap().contains("broken.pth"), "{weights}");
    assert_eq!(weights[1]["checkpoint"]["parameters"], 16_442_728);
    assert_eq!(place.run("doctor absent.pth").code, 1);
    assert_eq!(place.run("doctor good.safetensors").code, 0);
}
