//! `reconstruct` from outside: what it refuses, what it cannot say, what it writes.

use crate::program::{Place, names};
use selenograph_raster::Raster;
use selenograph_raster::codec::png;
use std::sync::OnceLock;

const SIDE: usize = 160;

/// Smooth ground seen from straight above, lit from the side: a texture of many sizes without a period.
fn ground(x: f64, y: f64) -> f64 {
    (1..7)
        .map(|k| {
            let (f, a) = (0.045 * 1.55f64.powi(k), 1.0 / 1.25f64.powi(k));
            let phase = 1.7 * f64::from(k * k);
            a * (f * x + 0.6 * (0.7 * f * y + phase).sin() * 2.0 + phase).sin() * (f * y * 1.1 - phase).cos()
        })
        .sum()
}

/// A picture of rough ground from a camera at (`east`, 0): parallax grows with the ground's height.
pub fn picture(east: f64) -> Vec<u8> {
    let grey = Raster::from_fn(SIDE, SIDE, |x, y| {
        let (x, y) = (x as f64, y as f64);
        let height = 0.12 * (0.05 * x + 1.0).sin() * (0.043 * y).cos();
        (128.0 + 45.0 * ground(x + east * (1.0 + height), y)).clamp(0.0, 255.0) as u8
    });
    png::encode_grey8(&grey).unwrap()
}

/// A place with `a.png` and `b.png` of rough ground.
pub fn with_pair() -> Place {
    static PICTURES: OnceLock<[Vec<u8>; 2]> = OnceLock::new();
    let [a, b] = PICTURES.get_or_init(|| [picture(0.0), picture(14.0)]);
    let place = Place::new();
    place.write("a.png", a);
    place.write("b.png", b);
    place
}

/// Refused or not told, with a hint, and nothing is left behind.
fn nothing_comes_of(place: &Place, options: &str, says: &str, hints: &str) {
    let before = place.names();
    place.run(&format!("reconstruct {options} --out out -q")).refused(says, hints);
    assert_eq!(place.names(), before, "something was left behind");
}

fn flat(width: usize, height: usize, level: u8) -> Vec<u8> {
    png::encode_grey8(&Raster::filled(width, height, level)).unwrap()
}

#[test]
fn a_pair_becomes_a_folder_with_everything_and_its_pose_is_taken_again() {
    let place = with_pair();
    place.run("reconstruct a.png b.png --fov-deg 45 --baseline-m 80 --out out -q").ok();
    let files = names(&place.path("out"));
    for name in [
        "pose.json",
        "reconstruction.json",
        "matches.npz",
        "pointmaps.npz",
        "cloud.ply",
        "dem.tif",
        "report.html",
        "run.toml",
    ] {
        assert!(files.iter().any(|file| file == name), "{name} in {files:?}");
    }
    let page = std::fs::read_to_string(place.path("out/report.html")).unwrap();
    assert!(page.contains("metric") && !page.contains("src=\"http"));
    place.run("reconstruct a.png b.png --fov-deg 45 --out out").refused("`out` exists", "--force");
    let again = "reconstruct a.png b.png --fov-deg 45 --cam-b-from-cam-a out/pose.json --no-report --out two --json -q";
    let answer = place.run(again).ok().json();
    assert_eq!((&answer["pose"]["source"], &answer["pose"]["metric"]), (&"given".into(), &true.into()));
    assert!(!place.path("two/report.html").exists());
}

#[test]
fn without_a_camera_or_a_scale_it_says_so() {
    let place = with_pair();
    let answer = place.run("reconstruct a.png b.png --no-report --out out --json").ok();
    assert!(answer.stderr.contains("no camera was given"), "{}", answer.stderr);
    assert!(answer.stderr.contains("metric: false"), "{}", answer.stderr);
    assert_eq!(answer.json()["pose"]["metric"], false);
}

#[test]
fn pictures_that_are_none() {
    let place = with_pair();
    place.write("black.png", flat(SIDE, SIDE, 0));
    place.write("white.png", flat(SIDE, SIDE, 255));
    place.write("text.png", "no picture at all");
    let whole = std::fs::read(place.path("a.png")).unwrap();
    place.write("cut.png", &whole[..whole.len() / 2]);
    nothing_comes_of(&place, "a.png black.png --fov-deg 45", "all black", "light");
    nothing_comes_of(&place, "white.png a.png --fov-deg 45", "all white", "light");
    nothing_comes_of(&place, "a.png text.png --fov-deg 45", "text.png", "");
    nothing_comes_of(&place, "a.png cut.png --fov-deg 45", "cut.png", "damaged");
    nothing_comes_of(&place, "a.png nowhere.png --fov-deg 45", "nowhere.png", "check the path");
}

#[test]
fn sizes_depths_and_colours_of_pictures() {
    let place = with_pair();
    let small = Raster::from_fn(100, 90, |x, y| (7 * x + 13 * y) as u8);
    place.write("small.png", png::encode_grey8(&small).unwrap());
    nothing_comes_of(
        &place,
        "a.png small.png --fov-deg 45",
        "different sizes, 160×160 and 100×90",
        "--camera-a",
    );
    // 16 bit and colour are as good as 8 bit grey.
    let decoded = png::read(&place.path("b.png")).unwrap().to_unit_grey();
    let deep = decoded.map(|v| (v * 60_000.0) as u16);
    place.write("deep.png", png::encode_grey16(&deep).unwrap());
    let colour = decoded.map(|v| [(v * 255.0) as u8; 3]);
    place.write("colour.png", png::encode_rgb8(&colour).unwrap());
    for name in ["deep.png", "colour.png"] {
        place.run(&format!("reconstruct a.png {name} --fov-deg 45 --no-report --out out_{name} -q")).ok();
    }
}

#[test]
fn cameras_and_poses_that_cannot_be() {
    let place = with_pair();
    for camera in ["--fov-deg 0", "--fov-deg 180", "--focal-px -5", "--focal-px 0"] {
        nothing_comes_of(&place, &format!("a.png b.png {camera}"), "", "");
    }
    let camera = |fx: &str| format!("width_px = 160\nheight_px = 160\nfx_px = {fx}\n");
    place.write("k.toml", camera("-190.0"));
    nothing_comes_of(&place, "a.png b.png --camera k.toml", "k.toml", "");
    place.write("k.toml", camera("190.0").replace("160", "512"));
    nothing_comes_of(&place, "a.png b.png --camera k.toml", "512×512", "camera");
    let pose = |rows: &str| {
        format!(
            "{{\"format\": \"selenograph.pose\", \"version\": 1, \"to\": \"cam_b\", \"from\": \"cam_a\", \
             \"cam_b_from_cam_a\": {rows}, \"unit\": \"m\", \"metric\": true}}"
        )
    };
    place.write("mirrored.json", pose("[[1,0,0,-1],[0,1,0,0],[0,0,-1,0]]"));
    place.write("skewed.json", pose("[[1,0.1,0,-1],[0,1,0,0],[0,0,1,0]]"));
    for name in ["mirrored.json", "skewed.json"] {
        nothing_comes_of(&place, &format!("a.png b.png --fov-deg 45 --cam-b-from-cam-a {name}"), name, "");
    }
    nothing_comes_of(&place, "a.png b.png --fov-deg 45 --baseline-m 0", "--baseline-m", "metres");
    nothing_comes_of(&place, "a.png b.png --fov-deg 45 --scale-from altitude", "altitude", "");
}

#[test]
fn what_two_pictures_cannot_tell_is_not_told() {
    let place = with_pair();
    nothing_comes_of(&place, "a.png a.png --fov-deg 45", "cannot say: no parallax", "baseline");
    // Another ground altogether.
    place.write("elsewhere.png", picture(9000.0));
    nothing_comes_of(&place, "a.png elsewhere.png --fov-deg 45", "cannot say", "");
    // Low light over flat ground: three grey levels of noise.
    let noise = |seed: usize| {
        Raster::from_fn(SIDE, SIDE, |x, y| 2 + ((x * 7919 + y * 104_729 + seed * 31) % 61 / 30) as u8)
    };
    for (name, seed) in [("dim_a.png", 1), ("dim_b.png", 77)] {
        place.write(name, png::encode_grey8(&noise(seed)).unwrap());
    }
    let answer = place.run("reconstruct dim_a.png dim_b.png --fov-deg 45 --out out -q");
    assert!(answer.code == 1 && answer.stderr.contains("cannot say"), "{}", answer.stderr);
    assert!(!place.path("out").exists());
}
