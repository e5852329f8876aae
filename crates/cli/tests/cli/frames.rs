//! `frames` from outside.

use crate::program::{Place, names};
use selenograph_raster::Raster;
use selenograph_raster::codec::png;

fn picture(size: usize, level: u8) -> Vec<u8> {
    png::encode_grey8(&Raster::from_fn(size, size, |x, y| level.wrapping_add((x + 2 * y) as u8))).unwrap()
}

fn with_folder() -> Place {
    let place = Place::new();
    std::fs::create_dir(place.path("seq")).unwrap();
    for k in 0..12u8 {
        place.write(&format!("seq/f{k}.png"), picture(40, 10 * k));
    }
    place
}

#[test]
fn a_folder_becomes_pairs_and_the_camera_is_cut_too() {
    let place = with_folder();
    place.write("k.toml", "width_px = 40\nheight_px = 40\nfov_deg = 45.0\n");
    place.run("frames seq --every 5 --gap 2 --size 16 --at 3,4 --camera k.toml --out out -q").ok();
    assert_eq!(names(&place.path("out")), ["camera.toml", "pairs.csv", "pictures", "run.toml"]);
    let table = std::fs::read_to_string(place.path("out/pairs.csv")).unwrap();
    let rows: Vec<&str> = table.lines().skip(1).collect();
    // Frame 10 has no partner at 12; f10 comes after f9.
    assert_eq!(
        rows,
        [
            "0,pictures/000000.png,pictures/000002.png,0,2,f0.png,f2.png",
            "1,pictures/000005.png,pictures/000007.png,5,7,f5.png,f7.png",
        ]
    );
    assert_eq!(names(&place.path("out/pictures")).len(), 4);
    let camera = std::fs::read_to_string(place.path("out/camera.toml")).unwrap();
    assert!(camera.contains("cx_px = 17.0") && camera.contains("cy_px = 16.0"), "{camera}");
}

#[test]
fn broken_pictures_are_skipped_and_listed() {
    let place = with_folder();
    place.write("seq/f1.png", "no picture");
    let answer = place.run("frames seq --size 16 --out out");
    assert_eq!(answer.code, 3, "{}", answer.stderr);
    assert!(answer.stderr.contains("skipped: f1.png"), "{}", answer.stderr);
    assert_eq!(std::fs::read_to_string(place.path("out/pairs.csv")).unwrap().lines().count(), 1 + 9);
}

#[test]
fn a_truncated_stream_keeps_what_was_whole() {
    let place = Place::new();
    let mut bytes = b"YUV4MPEG2 W24 H24 F25:1 Cmono\n".to_vec();
    for k in 0..4u8 {
        bytes.extend(b"FRAME\n");
        bytes.extend([k * 9; 576]);
    }
    place.write("cut.y4m", &bytes[..bytes.len() - 100]);
    let answer = place.run("frames cut.y4m --size 16 --out out");
    assert_eq!(answer.code, 3, "{}", answer.stderr);
    assert!(answer.stderr.contains("ends inside a frame, after 3 whole ones"), "{}", answer.stderr);
    assert_eq!(std::fs::read_to_string(place.path("out/pairs.csv")).unwrap().lines().count(), 1 + 2);
}

#[test]
fn what_makes_no_pair_is_refused_and_leaves_nothing() {
    let place = with_folder();
    place.write("noise.bin", "neither");
    let before = place.names();
    place.run("frames seq --size 64 --out out -q").refused("no pair can be made", "--size");
    place.run("frames noise.bin --out out -q").refused("YUV4MPEG2", "");
    place.run("frames nowhere --out out -q").refused("nowhere", "check the path");
    place.run("frames seq --every 0 --out out -q").refused("above 0", "");
    assert_eq!(place.names(), before);
}
