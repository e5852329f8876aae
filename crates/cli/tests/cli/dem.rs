//! `dem info | import | synth | hillshade`.

use crate::program::{Place, names};
use crate::tiff::Dem;

#[test]
fn info_says_what_where_how_high_and_how_steep() {
    let place = Place::new();
    place.write("hills.tif", Dem::hills(64, 20.0).bytes());
    let text = place.run("dem info hills.tif").ok();
    for words in ["geotiff", "64 × 64 pixels", "Moon", "polar stereographic (south)", "median"] {
        assert!(text.stdout.contains(words), "`{words}` in {}", text.stdout);
    }
    let report = &place.run("dem info hills.tif --json").ok().json()[0];
    assert_eq!(report["width"], 64);
    assert_eq!(report["extent_map"]["x_min"], -640.0);
    assert_eq!(report["extent_deg"]["lat_min"], -90.0);
    let cell = report["cell_m"][0].as_f64().unwrap();
    assert!((cell - 20.0).abs() < 1e-3, "{cell}");
    assert!(report["height_m"]["min"].as_f64().unwrap() >= 88.0);
    assert!(report["slope_deg"]["median"].as_f64().unwrap() > 1.0);
    assert_eq!(report["absent_share"], 0.0);
}

#[test]
fn absent_samples_are_counted() {
    let place = Place::new();
    let mut dem = Dem::hills(10, 20.0);
    dem.heights[..25].fill(-9999.0);
    dem.nodata = Some("-9999");
    place.write("holes.tif", dem.bytes());
    let report = &place.run("dem info holes.tif --json").ok().json()[0];
    assert_eq!(report["absent_share"], 0.25);
    // The option takes the place of the file's own mark.
    let report = &place.run("dem info holes.tif --nodata -1 --json").ok().json()[0];
    assert_eq!(report["height_m"]["min"], -9999.0);
}

#[test]
fn a_synthetic_moon_is_a_geotiff_that_can_be_read_shaded_and_imported() {
    let place = Place::new();
    let made = place.run("dem synth --size 96 --cell-m 40 --seed 3 --out moon.tif --json").ok().json();
    assert_eq!((&made["width"], &made["cell_m"]), (&96.into(), &40.0.into()));
    let report = &place.run("dem info moon.tif --json").ok().json()[0];
    assert_eq!(report["width"], 96);
    assert!(report["slope_deg"]["median"].as_f64().unwrap() > 0.5);
    let first = std::fs::read(place.path("moon.tif")).unwrap();
    place.run("dem synth --size 96 --cell-m 40 --seed 3 --threads 1 --out moon.tif --force").ok();
    assert_eq!(first, std::fs::read(place.path("moon.tif")).unwrap(), "a seed is a Moon");
    let shaded = place.run("dem hillshade moon.tif --out moon.png --max-side 40 --json").ok().json();
    assert_eq!((&shaded["width"], &shaded["reduced_by"]), (&32.into(), &3.into()));
    assert!(std::fs::read(place.path("moon.png")).unwrap().starts_with(b"\x89PNG"));
    place.run("dem import moon.tif --out terrain").ok();
    let terrain = place.run("dem info terrain --verify --json").ok().json();
    assert_eq!(terrain[0]["layers"][0]["cols"], 96);
    // One flipped bit among the heights opens as before, and is found when asked for.
    let file = place.path("terrain").join(terrain[0]["layers"][0]["file"].as_str().unwrap());
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[9000] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    place.run("dem info terrain").ok();
    place.run("dem info terrain --verify").refused("layer-0.bin", "");
    assert_eq!(place.names(), ["moon.png", "moon.tif", "terrain"]);
}

#[test]
fn quiet_says_nothing() {
    let place = Place::new();
    let answer = place.run("dem synth --size 32 --cell-m 40 --out moon.tif --quiet").ok();
    assert!(answer.stderr.is_empty() && answer.stdout.is_empty(), "{}{}", answer.stdout, answer.stderr);
}

#[test]
fn shared_elevation_models_all_open() {
    let Some(folder) = shared("data/dem") else { return };
    let place = Place::new();
    let mut seen = 0;
    for name in names(&folder) {
        let path = folder.join(&name);
        // A raw image stands beside its label, and the label is what is opened.
        if path.with_extension("lbl").exists() && !name.ends_with("lbl") {
            continue;
        }
        let report = place.run_args(&["dem", "info", "--json", path.to_str().unwrap()]).ok().json();
        let report = &report[0];
        assert!(report["extent_deg"]["lat_min"].is_number(), "{name}: {report}");
        assert!(report["height_m"]["max"].as_f64() >= report["height_m"]["min"].as_f64(), "{name}");
        seen += 1;
    }
    assert!(seen > 0, "{} is empty", folder.display());
    eprintln!("RAN shared-data: shared_elevation_models_all_open ({seen} files)");
}

/// A folder of the shared data, or `None` with a message.
pub fn shared(folder: &str) -> Option<std::path::PathBuf> {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        |root| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(root),
    );
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path.canonicalize().unwrap());
    }
    eprintln!("SKIP shared-data: {folder} is not there");
    None
}
