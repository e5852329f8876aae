//! Bad input: one clear line, a hint, exit code 1, and nothing left behind.

use crate::program::Place;
use crate::reconstruct::picture;
use crate::tiff::Dem;

fn with_dem(name: &str, dem: &Dem) -> Place {
    let place = Place::new();
    place.write(name, dem.bytes());
    place
}

/// Every command that reads an elevation model refuses the same file in the same words, and writes nothing.
fn refused_everywhere(place: &Place, name: &str, says: &str, hints: &str) {
    let before = place.names();
    place.run(&format!("dem info {name}")).refused(says, hints);
    place.run(&format!("dem import {name} --out terrain")).refused(says, hints);
    place.run(&format!("dem hillshade {name} --out shade.png")).refused(says, hints);
    assert_eq!(place.names(), before, "something was left behind");
}

#[test]
fn truncated_tiff() {
    let place = Place::new();
    let bytes = Dem::hills(32, 20.0).bytes();
    // The directory is at the end: cutting there loses it.
    place.write("cut.tif", &bytes[..bytes.len() / 2]);
    refused_everywhere(&place, "cut.tif", "cut.tif", "");
    place.write("cut.tif", &bytes[..6]);
    refused_everywhere(&place, "cut.tif", "cut.tif", "");
}

/// Wherever two maps meet; the older radius of the Moon is 600 m longer.
#[test]
fn a_second_radius() {
    let place = with_dem("new.tif", &Dem::hills(64, 400.0));
    place.write("old.tif", Dem { radius_m: 1_738_000.0, ..Dem::hills(64, 100.0) }.bytes());
    let says = |beside: &str| format!("lies on a sphere of 1738000 m, {beside} on one of 1737400 m");
    let heights = "--calc=\"A+(600)\"";
    for files in ["old.tif new.tif", "new.tif old.tif"] {
        let import = format!("dem import {files} --out terrain");
        place.run(&import).refused(&says("`new.tif`"), heights);
    }
    place
        .run("dem synth --size 16 --cell-m 20 --base old.tif --out moon.tif")
        .refused(&says("the synthetic relief"), heights);
    place.run("dem import new.tif --out terrain").ok();
    // An albedo has no height that could be off.
    place
        .run("render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --width 8 --height 8 --albedo old.tif --out o")
        .refused(&says("the terrain"), "+R=1737400");
    place.write(
        "camera.toml",
        "width_px = 160\nheight_px = 160\nfx_px = 190.0\ncx_px = 80.0\ncy_px = 80.0\npixel_convention = \"corner\"\n\
         world = \"moon_me\"\nposition_m = [0.0, 0.0, -1741000.0]\n\
         world_from_cam_quaternion = { qw = 1.0, qx = 0.0, qy = 0.0, qz = 0.0 }\n",
    );
    for (name, bytes) in [("a.png", 0.0), ("b.png", 14.0)].map(|(name, at)| (name, picture(at))) {
        place.write(name, bytes);
    }
    let names = place.names();
    place
        .run("reconstruct a.png b.png --camera camera.toml --world-from-cam-a camera.toml --dem old.tif --out out -q")
        .refused(&says("the first camera's world `moon_me`"), heights);
    assert_eq!(place.names(), names, "something was left behind");
}

/// Whatever reads a file refuses at once what would block it or never end.
#[cfg(unix)]
#[test]
fn pipes_and_devices() {
    let place = Place::new();
    assert!(place.command("mkfifo").arg("pipe").status().unwrap().success());
    let before = place.names();
    for file in ["pipe", "/dev/zero"] {
        for (line, hints) in [
            (format!("frames {file} --size 8 --out out"), "standard input"),
            (format!("weights info {file}"), "torch.save"),
            (format!("config show {file}"), "a pipe or a device"),
            (format!("dem info {file}"), "a pipe or a device"),
        ] {
            place.run(&line).refused("a pipe, socket or device", hints);
        }
    }
    assert_eq!(place.names(), before, "something was left behind");
}

#[test]
fn not_an_elevation_model() {
    let place = Place::new();
    place.write("noise.tif", [0xA5; 400]);
    refused_everywhere(&place, "noise.tif", "not a format read here", "");
    place.write("empty.tif", []);
    refused_everywhere(&place, "empty.tif", "empty file", "");
}

#[test]
fn missing_file() {
    refused_everywhere(&Place::new(), "nowhere.tif", "nowhere.tif", "check the path");
}

#[test]
fn label_without_its_image() {
    let place = Place::new();
    place.write(
        "lost.lbl",
        "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = 8\r\nFILE_RECORDS = 4\r\n\
         ^IMAGE = \"LOST.IMG\"\r\nOBJECT = IMAGE\r\n LINES = 4\r\n LINE_SAMPLES = 4\r\n SAMPLE_BITS = 16\r\n \
         SAMPLE_TYPE = LSB_INTEGER\r\nEND_OBJECT = IMAGE\r\nEND\r\n",
    );
    refused_everywhere(&place, "lost.lbl", "LOST.IMG", "beside its label");
}

#[test]
fn no_georeference() {
    let place = with_dem("bare.tif", &Dem { georeferenced: false, ..Dem::hills(16, 20.0) });
    refused_everywhere(&place, "bare.tif", "no georeference", "--crs");
}

#[test]
fn unknown_projection() {
    // 7: Mercator.
    let place = with_dem("mercator.tif", &Dem { transformation: 7, ..Dem::hills(16, 20.0) });
    refused_everywhere(&place, "mercator.tif", "projection", "--crs");
    // What --crs cannot read is refused as well.
    let answer = place.run_args(&["dem", "info", "mercator.tif", "--crs", "+proj=merc"]);
    answer.refused("merc", "--crs");
}

#[test]
fn nothing_but_nodata() {
    let nodata = Dem { nodata: Some("-9999"), ..Dem::flat(16, -9999.0) };
    refused_everywhere(&with_dem("void.tif", &nodata), "void.tif", "no valid sample", "--nodata");
    refused_everywhere(
        &with_dem("nan.tif", &Dem::flat(16, f32::NAN)),
        "nan.tif",
        "no valid sample",
        "--band",
    );
}

#[test]
fn band_that_is_not_there() {
    let place = with_dem("one.tif", &Dem::hills(16, 20.0));
    place.run("dem info one.tif --band 2").refused("band 2 was asked for", "count from 1");
    place.run("dem info one.tif --band 0").refused("band 0 was asked for", "count from 1");
}

#[test]
fn existing_target_without_force() {
    let place = with_dem("hills.tif", &Dem::hills(16, 20.0));
    place.write("shade.png", "mine");
    place.run("dem hillshade hills.tif --out shade.png").refused("`shade.png` exists", "--force");
    assert_eq!(std::fs::read(place.path("shade.png")).unwrap(), b"mine");
    let forced = place.run("dem hillshade hills.tif --out shade.png --force");
    forced.refused("`shade.png` is another file, not a PNG picture", "pass another --out");
    std::fs::remove_file(place.path("shade.png")).unwrap();
    place.run("dem hillshade hills.tif --out shade.png").ok();
    place.run("dem hillshade hills.tif --out shade.png --force").ok();
    place.run("dem import hills.tif --out terrain").ok();
    place.run("dem import hills.tif --out terrain").refused("`terrain` exists", "--force");
    place.run("dem import hills.tif --out terrain --force").ok();
    place.run("dem synth --size 16 --out hills.tif").refused("`hills.tif` exists", "--force");
}

#[test]
fn target_that_cannot_be_written() {
    let place = with_dem("hills.tif", &Dem::hills(16, 20.0));
    // A file where a folder is needed stands for a read-only disk: tests may run as a user who may do anything.
    let before = place.names();
    for command in ["dem hillshade hills.tif", "dem import hills.tif", "dem synth --size 16"] {
        let answer = place.run(&format!("{command} --out hills.tif/below/out"));
        assert_eq!(answer.code, 1, "{}", answer.stderr);
        assert!(answer.stderr.starts_with("error: cannot make the folder"), "{}", answer.stderr);
        assert!(answer.stderr.contains("\nhint: "), "{}", answer.stderr);
    }
    assert_eq!(place.names(), before);
}

#[test]
fn synthesis_without_sense() {
    let place = Place::new();
    for options in ["--size 0", "--size 64 --cell-m 0", "--size 64 --cell-m nan", "--size 64 --relief -1"] {
        let answer = place.run(&format!("dem synth {options} --out moon.tif"));
        assert_eq!(answer.code, 1, "{options}: {}", answer.stderr);
        assert!(answer.stderr.starts_with("error: "), "{options}: {}", answer.stderr);
        assert!(place.names().is_empty(), "{options}");
    }
}
