//! `reconstruct --method fused`: where its Suns come from, and what is said where they are not known.

use crate::campaign::with_terrain;
use crate::program::{Answer, Place};
use crate::reconstruct::with_pair;
use selenograph_evaluate::dataset_source::{Choice, LoadedPair, Source};
use selenograph_geometry::sun::sub_solar;
use selenograph_geometry::time::Utc;
use selenograph_geometry::{Point3, Vector3};
use selenograph_raster::codec::{Picture, png};
use serde_json::Value;
use std::path::Path;

/// A camera over the south pole that looks straight down, its axes those of the Moon.
const POLE: &str = "width_px = 160\nheight_px = 160\nfx_px = 190.0\ncx_px = 80.0\ncy_px = 80.0\npixel_convention = \"corner\"\n\
     world = \"moon_me\"\nposition_m = [0.0, 0.0, -1741000.0]\n\
     world_from_cam_quaternion = { qw = 1.0, qx = 0.0, qy = 0.0, qz = 0.0 }\n";

/// The Sun is 1.5° over the south pole, and half a year before as far below it.
const SUMMER: &str = "2009-10-15T00:00:00";
const WINTER: &str = "2009-04-15T00:00:00";

fn at_the_pole() -> Place {
    let place = with_pair();
    place.write("pose.toml", POLE);
    place
}

const FUSED: &str = "--method fused --fov-deg 45 --no-report --out out";

fn direction(record: &Value) -> Vector3<f64> {
    Vector3::from_fn(|i, _| record["direction"][i].as_f64().unwrap())
}

fn from(record: &Value) -> &str {
    record["from"].as_str().unwrap()
}

/// The grey levels of `a.png` as a raw image with a label that says more.
fn labelled(place: &Place, name: &str, says: &str) {
    let bytes = std::fs::read(place.path(&format!("{name}.png"))).unwrap();
    let Picture::Grey8(grey) = png::decode(&bytes, Path::new("a.png")).unwrap() else {
        panic!("no grey picture")
    };
    let label = format!(
        "PDS_VERSION_ID = PDS3\n^IMAGE = \"{name}.img\"\n{says}\nOBJECT = IMAGE\nLINES = {}\nLINE_SAMPLES = {}\n\
         SAMPLE_TYPE = UNSIGNED_INTEGER\nSAMPLE_BITS = 8\nEND_OBJECT = IMAGE\nEND\n",
        grey.height, grey.width
    );
    place.write(&format!("{name}.img"), &grey.data);
    place.write(&format!("{name}.lbl"), label);
}

#[test]
fn times_tell_the_sun_where_the_place_is_known() {
    let place = at_the_pole();
    let said = place
        .run(&format!(
            "reconstruct a.png b.png --world-from-cam-a pose.toml --time-a {SUMMER}Z --time-b 2009-288T00:10 {FUSED} --json"
        ))
        .ok();
    let answer = said.json();
    let sun = sub_solar(SUMMER.parse::<Utc>().unwrap()).unwrap();
    let expected = sun.direction_from(&Point3::new(0.0, 0.0, -1_741_000.0));
    assert!((direction(&answer["sun_a"]) - expected).norm() < 1e-12, "{}", answer["sun_a"]);
    assert_eq!(
        (from(&answer["sun_a"]), &answer["sun_a"]["axes"]),
        ("--time-a, 2009-10-15T00:00:00Z", &"cam_a".into())
    );
    assert_eq!(from(&answer["sun_b"]), "--time-b, 2009-10-15T00:10:00Z");
    // Ten minutes: 0.08°.
    let apart = direction(&answer["sun_b"]).angle(&expected).to_degrees();
    assert!((0.07..0.1).contains(&apart), "{apart}");
    assert!((answer["sun_a"]["elevation_deg"].as_f64().unwrap() - 1.515).abs() < 0.02);
    assert!(
        said.stderr.contains("Sun of picture A: from --time-a, 2009-10-15T00:00:00Z, 1.5° above the horizon"),
        "{}",
        said.stderr
    );
    let record = std::fs::read_to_string(place.path("out/run.toml")).unwrap();
    assert!(record.contains("[settings.known.sun_a]\nfrom = \"--time-a, 2009-10-15T00:00:00Z\""), "{record}");
    // The same written the other way.
    let [x, y, z] = <[f64; 3]>::from(expected);
    let run = format!(
        "reconstruct a.png b.png --sun-a {x},{y},{z} --sun-b {x},{y},{z} --time-a {WINTER} {FUSED} --force --json"
    );
    let answer = place.run(&run).ok().json();
    assert_eq!((from(&answer["sun_a"]), from(&answer["sun_b"])), ("--sun-a", "--sun-b"));
    assert_eq!((&answer["sun_a"]["axes"], &answer["sun_b"]["axes"]), (&"cam_a".into(), &"own".into()));
}

#[test]
fn labels_tell_the_sun_and_flags_come_first() {
    let place = at_the_pole();
    labelled(&place, "a", &format!("START_TIME = {SUMMER}\nSTOP_TIME = 2009-10-15T00:00:20"));
    labelled(
        &place,
        "b",
        "TARGET_NAME = MOON\nSUB_SOLAR_LATITUDE = -1.5\nSUB_SOLAR_LONGITUDE = 224.5 <DEG>\nSUB_SOLAR_AZIMUTH = 12",
    );
    let run = |options: &str| place.run(&format!("reconstruct a.img b.img {FUSED} {options}"));
    let world = "--world-from-cam-a pose.toml";
    let said = run(&format!("{world} --json")).ok();
    let answer = said.json();
    assert_eq!(
        from(&answer["sun_a"]),
        "`./a.lbl`, the middle of START_TIME and STOP_TIME, 2009-10-15T00:00:10Z"
    );
    assert_eq!(from(&answer["sun_b"]), "`./b.lbl`, SUB_SOLAR_LATITUDE and SUB_SOLAR_LONGITUDE");
    let note = "`./b.lbl`: SUB_SOLAR_AZIMUTH = 12 is not used: it does not say what it counts from";
    assert!(
        answer["warnings"].as_array().unwrap().contains(&note.into()) && said.stderr.contains(note),
        "{answer}"
    );
    let record = std::fs::read_to_string(place.path("out/run.toml")).unwrap();
    assert!(record.contains("\"./a.lbl\" = "), "{record}");
    // One that is given, the other one found.
    let answer = run(&format!("{world} --json --force --time-a 2009-10-14T23:59:00")).ok().json();
    assert_eq!(from(&answer["sun_a"]), "--time-a, 2009-10-14T23:59:00Z");
    assert_eq!(from(&answer["sun_b"]), "`./b.lbl`, SUB_SOLAR_LATITUDE and SUB_SOLAR_LONGITUDE");
    // Without a place a label's Sun is no direction.
    run("--force -q").refused("no Sun is given (the Sun of `./a.lbl`", "--world-from-cam-a");
    // A label that is wrong is not believed.
    labelled(&place, "a", &format!("START_TIME = {WINTER}"));
    let says = "the Sun of the first picture is not known (the Sun of `./a.lbl`, START_TIME, 2009-04-15T00:00:00Z is not used: it stands 1.6° below the horizon";
    run(&format!("{world} --force -q")).refused(says, "--sun-a");
}

#[test]
fn what_tells_no_sun_is_refused_with_all_the_ways() {
    let place = at_the_pole();
    let before = place.names();
    let run =
        |options: &str| -> Answer { place.run(&format!("reconstruct a.png b.png {FUSED} -q {options}")) };
    for hint in ["--sun-a", "--time-a", "--world-from-cam-a", "labels", "pair folder", "--method stereo"] {
        run("").refused("--method fused looks at shading, and no Sun is given", hint);
    }
    run("--sun-a 0,-1,-1").refused("the Sun of the second picture is not known", "--sun-b");
    run("--sun-b 0,-1,-1").refused("the Sun of the first picture is not known", "--time-b");
    run(&format!("--time-a {SUMMER} --sun-b 0,-1,-1"))
        .refused("nothing says where on the Moon", "--world-from-cam-a");
    run("--sun-a 90,10 --sun-b 0,-1,-1").refused("nothing says where north is", "--world-from-cam-a");
    let world = "--world-from-cam-a pose.toml --sun-b 1,0,-0.1";
    run(&format!("{world} --time-a {WINTER}"))
        .refused("--time-a 2009-04-15T00:00:00Z: the Sun stands 1.6° below the horizon", "UTC");
    run(&format!("{world} --time-a 1709-04-15T00:00"))
        .refused("known from 1950 to 2100, not for 1709-04-15T00:00:00Z", "--sun-a");
    run(&format!("{world} --time-a 15.4.2009")).refused("15.4.2009", "--help");
    place.write("pose.toml", POLE.replace("moon_me", "mars_iau"));
    run(&format!("{world} --time-a {SUMMER}")).refused("nothing says where on the Moon", "moon_me");
    assert_eq!(place.names(), before, "something was left behind");
    // Settings of a network that is not asked.
    run("--sun-a 0,-1,-1 --sun-b 0,-1,-1 --weights w.safetensors").refused("", "");
}

#[test]
fn suns_that_cannot_be_are_told() {
    let place = at_the_pole();
    let warned = |options: &str, says: &str| {
        let answer =
            place.run(&format!("reconstruct a.png b.png {FUSED} --force --json {options}")).ok().json();
        let warnings = answer["warnings"].as_array().unwrap();
        assert!(
            warnings.iter().any(|warning| warning.as_str().unwrap().contains(says)),
            "{says}: {warnings:?}"
        );
    };
    warned(
        "--sun-a 0,0.1,1 --sun-b 0,0.1,1",
        "the Sun of --sun-b stands 6° off the axis along which the camera looks",
    );
    // Z is the Moon's north, and the camera's forward.
    warned(
        "--world-from-cam-a pose.toml --sun-a 1,0,1 --sun-b 1,0,1",
        "the Sun of --sun-a stands 45.0° below the horizon of the ground at -90.00°",
    );
}

#[test]
fn a_pair_folder_tells_its_suns() {
    let place = with_terrain();
    place
        .run(
            "generate tiny.toml --terrain terrain --out dataset --set oblique.pairs=0 --set dynamic.pairs=0 \
                --set camera.width_px=160 --set camera.height_px=160 -q",
        )
        .ok();
    let source = Source::open(&place.path("dataset"), &Choice::default()).unwrap();
    let pair = LoadedPair::read(&source.entries[0], &source.pixels).unwrap();
    let folder = "dataset/pairs/000/000000";
    let cameras = format!("--camera-a {folder}/a.camera.json --camera-b {folder}/b.camera.json");
    let pose = format!("--world-from-cam-a {folder}/a.camera.json --world-from-cam-b {folder}/b.camera.json");
    let run = |options: &str| {
        place.run(&format!("reconstruct {folder}/a.l1.png {folder}/b.l1.png {cameras} {pose} --method fused --complete {options}"))
    };
    let answer = run("--out out --json --no-report").ok().json();
    for (key, sun) in ["sun_a", "sun_b"].into_iter().zip(pair.suns_in_cams([1, 1])) {
        assert!((direction(&answer[key]) - sun.unwrap()).norm() < 1e-9, "{}", answer[key]);
        assert_eq!(from(&answer[key]), format!("light 1 of `{folder}/pair.json`"));
    }
    let record = std::fs::read_to_string(place.path("out/run.toml")).unwrap();
    assert!(record.contains(&format!("\"{folder}/pair.json\" = ")), "{record}");
    // A picture of another pair.
    let path = place.path(&format!("{folder}/b.l1.png"));
    std::fs::copy(place.path(&format!("{folder}/b.l0.png")), &path).unwrap();
    run("--out x -q").refused("the Sun of the second picture is not known", "--sun-b");
    run("--out x -q").refused("its checksum is not the one in pair.json", "");
}
