//! What labels say of the Sun.
// Helpers of a test are tests too: a failure there is a panic with its place.
#![allow(clippy::unwrap_used, clippy::print_stderr)]

use selenograph_geometry::sun::SubSolar;
use selenograph_geometry::time::Utc;
use selenograph_raster::illumination::{Illumination, read_illumination};
use std::path::{Path, PathBuf};

fn said(name: &str, label: &str) -> Option<Illumination> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, label).unwrap();
    read_illumination(&path).unwrap()
}

fn pds3(keywords: &str) -> Option<Illumination> {
    said("a.lbl", &format!("PDS_VERSION_ID = PDS3\r\n{}\r\nEND\r\n", keywords.replace('\n', "\r\n")))
}

fn utc(text: &str) -> Utc {
    text.parse().unwrap()
}

fn degrees(sun: &SubSolar) -> [f64; 2] {
    [sun.lat_rad.to_degrees(), sun.lon_rad.to_degrees()]
}

fn close(found: [f64; 2], expected: [f64; 2]) -> bool {
    found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-9)
}

#[test]
fn a_point_that_is_stated_comes_before_the_time() {
    let said = pds3(
        "TARGET_NAME = MOON\nSTART_TIME = 1971-07-31T01:25:02.243\nSTOP_TIME = 1971-07-31T01:25:04.243\n\
         SUB_SOLAR_LATITUDE = 0.24 <DEGREE>\nSUB_SOLAR_LONGITUDE = 78.7",
    )
    .unwrap();
    let sun = said.sun().unwrap();
    assert!(close(degrees(&sun.sub_solar), [0.24, 78.7]));
    assert_eq!((sun.from.as_str(), sun.sigma_rad), ("SUB_SOLAR_LATITUDE and SUB_SOLAR_LONGITUDE", 0.0));
    assert_eq!(said.taken, Some(utc("1971-07-31T01:25:03.243")));
    assert!(said.notes.is_empty(), "{:?}", said.notes);
}

#[test]
fn a_time_tells_the_sun_of_its_middle() {
    let said = pds3("START_TIME = 1971-212T01:25:02.243Z\nSTOP_TIME = \"UNK\"").unwrap();
    let sun = said.sun().unwrap();
    assert_eq!(sun.from, "START_TIME, 1971-07-31T01:25:02.243Z");
    let [lat_deg, lon_deg] = degrees(&sun.sub_solar);
    assert!((lat_deg - 0.2410).abs() < 0.01 && (lon_deg - 78.7382).abs() < 0.01);
    assert!(sun.sigma_rad > 0.0);
}

#[test]
fn west_longitudes_are_turned() {
    let said =
        pds3("SUB_SOLAR_LATITUDE = -1.5\nSUB_SOLAR_LONGITUDE = 30\nPOSITIVE_LONGITUDE_DIRECTION = WEST")
            .unwrap();
    assert!(close(degrees(&said.sub_solar.unwrap()), [-1.5, -30.0]));
}

#[test]
fn what_is_not_defined_or_not_possible_is_told_and_not_used() {
    for (keywords, note) in [
        (
            "SUB_SOLAR_AZIMUTH = 95.3 <DEG>",
            "SUB_SOLAR_AZIMUTH = 95.3 is not used: it does not say what it counts from",
        ),
        (
            "SUB_SOLAR_LATITUDE = 45\nSUB_SOLAR_LONGITUDE = 30",
            "SUB_SOLAR_LATITUDE = 45 is not used: expected up to 1.65° of the Moon",
        ),
        (
            "SUB_SOLAR_LATITUDE = 0.01 <RAD>\nSUB_SOLAR_LONGITUDE = 30",
            "SUB_SOLAR_LATITUDE = 0.01 RAD is not used: expected up to 1.65° of the Moon",
        ),
        (
            "SUB_SOLAR_LATITUDE = 1\nSUB_SOLAR_LONGITUDE = UNK",
            "SUB_SOLAR_LATITUDE stands alone: a point has a latitude and a longitude",
        ),
        (
            "TARGET_NAME = MARS\nSTART_TIME = 2009-11-29T14:51:21",
            "TARGET_NAME is MARS: the Sun of the Moon does not light it",
        ),
        (
            "START_TIME = 29.11.2009",
            "START_TIME is not used: time `29.11.2009`: expected a date and a time of day with T between",
        ),
        (
            "START_TIME = 1609-11-30T20:00:00",
            "START_TIME is not used: the Sun's place over the Moon is known from 1950 to 2100, not for 1609-11-30T20:00:00Z",
        ),
        (
            "START_TIME = 2009-11-29T14:51:21\nSTOP_TIME = 2009-12-29T14:51:21",
            "START_TIME and STOP_TIME are not used: they lie 720.00 h apart, and within 0.2 h the Sun stands still",
        ),
        (
            "START_TIME = 2009-11-29T14:51:21\nSTOP_TIME = 2009-11-29T13:51:21",
            "START_TIME and STOP_TIME are not used: they lie -1.00 h apart, and within 0.2 h the Sun stands still",
        ),
    ] {
        let said = pds3(keywords).unwrap();
        assert_eq!((said.sun(), said.notes.as_slice()), (None, [note.to_owned()].as_slice()), "{keywords}");
    }
    assert_eq!(
        pds3("TARGET_NAME = MOON\nSTART_TIME = N/A\nPRODUCT_CREATION_TIME = 2010-06-30T21:15:10"),
        None
    );
}

#[test]
fn a_label_that_contradicts_itself_says_so() {
    let said =
        pds3("START_TIME = 1971-07-31T01:25:02\nSUB_SOLAR_LATITUDE = 0.24\nSUB_SOLAR_LONGITUDE = 80.74")
            .unwrap();
    let note = "SUB_SOLAR_LATITUDE and SUB_SOLAR_LONGITUDE and START_TIME differ by 2.0°: the first is taken";
    assert_eq!(said.notes, [note]);
}

#[test]
fn pds4_labels_by_their_elements() {
    let label = |inside: &str| {
        let xml = format!(
            "<?xml version=\"1.0\"?><Product_Observational xmlns:geom=\"g\"><Identification_Area><title>t</title></Identification_Area>\
             <Observation_Area><Time_Coordinates><start_date_time>2020-01-02T03:04:05.678Z</start_date_time>\
             <stop_date_time>2020-01-02T03:04:15.678Z</stop_date_time></Time_Coordinates>\
             <Target_Identification><name>Moon</name></Target_Identification>{inside}</Observation_Area></Product_Observational>"
        );
        said("a.xml", &xml).unwrap()
    };
    let plain = label("");
    assert_eq!(plain.taken, Some(utc("2020-01-02T03:04:10.678")));
    assert_eq!(
        plain.sun().unwrap().from,
        "the middle of start_date_time and stop_date_time, 2020-01-02T03:04:10.678Z"
    );
    let by_time = degrees(&plain.sun().unwrap().sub_solar);
    let stated = label(&format!(
        "<geom:subsolar_latitude unit=\"deg\">{}</geom:subsolar_latitude><geom:subsolar_longitude unit=\"deg\">{}</geom:subsolar_longitude>",
        by_time[0] + 0.002,
        by_time[1].rem_euclid(360.0)
    ));
    assert!(close(degrees(&stated.sun().unwrap().sub_solar), [by_time[0] + 0.002, by_time[1]]));
    assert!(stated.notes.is_empty(), "{:?}", stated.notes);
    let azimuth = label("<isda:sun_azimuth xmlns:isda=\"i\" unit=\"deg\">95</isda:sun_azimuth>");
    assert!(azimuth.sun().is_some() && azimuth.notes.len() == 1);
}

#[test]
fn isis_cubes_by_their_instrument() {
    let cube = "Object = IsisCube\n  Object = Core\n    StartByte = 65537\n  End_Object\n  Group = Instrument\n    TargetName = Moon\n    \
                StartTime  = 2009-11-29T14:51:21.968\n  End_Group\n  Group = Kernels\n    Shape = ($base/a.bp-\n      c, b)\n  End_Group\n  \
                Group = Code\n    StartTime = 1999-01-01T00:00:00\n  End_Group\nEnd_Object\nEnd\nStartTime = 1998-01-01T00:00:00\n";
    let said_of = |label: &str| said("a.cub", label).unwrap();
    assert_eq!(said_of(cube).taken, Some(utc("2009-11-29T14:51:21.968")));
    let stated = cube.replace(
        "  Group = Kernels",
        "  Group = Geometry\n    SubSolarLatitude = -1.2 <DEGREE>\n    SubSolarLongitude = 330.0 <DEGREE>\n    SubSolarGroundAzimuth = 9.0\n  End_Group\n  Group = Kernels",
    );
    let said = said_of(&stated);
    assert!(close(degrees(&said.sub_solar.unwrap()), [-1.2, -30.0]));
    assert!(said.notes[0].starts_with("SubSolarGroundAzimuth = 9.0 is not used"), "{:?}", said.notes);
}

#[test]
fn pictures_without_a_label_say_nothing() {
    assert_eq!(said("a.pgm", "P5 1 1 255\n\0"), None);
}

/// Points below the Sun in the labels' own tables (DE405, mean-Earth frame): latitude and longitude, degrees.
const APOLLO: [(&str, [f64; 2]); 3] = [
    ("AS15-M-0297_crop.cub", [0.240_97, 78.738_23]),
    ("AS15-M-0298_crop.cub", [0.240_96, 78.734_66]),
    ("AS15-M-0299_crop.cub", [0.240_96, 78.731_10]),
];

fn shared(test: &str) -> Option<PathBuf> {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        // A relative path counts from the workspace's root.
        |root| Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(root),
    );
    let folder = root.join("data");
    if folder.is_dir() {
        eprintln!("RAN shared-data: {test}");
        return Some(folder);
    }
    eprintln!("SKIP shared-data: {test}: no folder {}", folder.display());
    None
}

#[test]
fn shared_labels_tell_their_sun() {
    let Some(root) = shared("shared_labels_tell_their_sun") else { return };
    for (name, [lat_deg, lon_deg]) in APOLLO {
        let path = root.join("apollo15").join(name);
        if !path.is_file() {
            eprintln!("SKIP shared-data: {} is not there", path.display());
            continue;
        }
        let sun = read_illumination(&path).unwrap().unwrap().sun().unwrap();
        let [lat, lon] = degrees(&sun.sub_solar);
        eprintln!("{name}: {}: off by {:+.4}°, {:+.4}°", sun.from, lat - lat_deg, lon - lon_deg);
        assert!((lat - lat_deg).abs() < 0.004 && (lon - lon_deg).abs() < 0.004);
    }
    for (name, time) in [("nacl.img", "2009-11-29T14:51:30.7835"), ("nacr.img", "2009-11-29T14:51:30.7835")] {
        let path = root.join("lro").join(name);
        if !path.is_file() {
            eprintln!("SKIP shared-data: {} is not there", path.display());
            continue;
        }
        let said = read_illumination(&path).unwrap().unwrap();
        assert!(said.taken.unwrap().seconds_to(utc(time)).abs() < 0.01, "{name}: {:?}", said.taken);
        assert!(said.notes.is_empty(), "{:?}", said.notes);
    }
}
