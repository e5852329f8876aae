//! `refine` from outside: what pictures make of a coarse elevation model, and what it refuses.

use crate::program::{Answer, Place, names};
use selenograph_raster::dem::{DemReader, GeoTiffWriter, OpenOptions, WriteOptions};
use selenograph_raster::{Raster, gradient, resample};
use std::path::Path;
use std::sync::OnceLock;

/// A pair from 6 km over 10 km of polar ground, under two lights.
const CAMPAIGN: &str = "name = \"above\"\nseed = 3\n\
    lights = [{ azimuth_deg = 330.0, elevation_deg = 20.0 }, { azimuth_deg = 230.0, elevation_deg = 25.0 }]\n\
    [camera]\nwidth_px = 160\nheight_px = 160\n\
    [sites]\nlat_deg = { min = -89.93, max = -89.91 }\n\
    [limits]\nmin_overlap = 0.3\nmax_coarse_share = 1.0\n\
    [nadir]\npairs = 1\naltitude_levels_m = [6000.0]\n[oblique]\npairs = 0\n[dynamic]\npairs = 0\n\
    [render]\nrays_per_pixel = 16\n[tone]\nbits = 8\n";
/// The coarse model has one node for so many cells along each side.
const COARSER: usize = 8;

/// What every test begins with: `true.tif`, `coarse.tif`, `camera.json`, `l0.png` and `l1.png`, and the Suns as vectors.
struct Campaign {
    place: Place,
    suns: [String; 2],
}

const FILES: [&str; 5] = ["true.tif", "coarse.tif", "camera.json", "l0.png", "l1.png"];

fn campaign() -> Campaign {
    static MADE: OnceLock<(Place, [String; 2])> = OnceLock::new();
    let (made, suns) = MADE.get_or_init(|| {
        let place = Place::new();
        place.run("dem synth --size 256 --cell-m 40 --relief 0.5 --out true.tif").ok();
        place.run("dem import true.tif --out terrain").ok();
        place.write("campaign.toml", CAMPAIGN);
        place.run("generate campaign.toml --terrain terrain --out dataset").ok();
        let pair = place.path("dataset/pairs/000/000000");
        for (from, to) in [("a.camera.json", "camera.json"), ("a.l0.png", "l0.png"), ("a.l1.png", "l1.png")] {
            std::fs::copy(pair.join(from), place.path(to)).unwrap();
        }
        let heights = read(&place.path("true.tif"));
        write(&place.path("true.tif"), &place.path("coarse.tif"), &coarse(&heights));
        let json = |path: &Path| -> serde_json::Value {
            serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
        };
        let (camera, record) = (json(&place.path("camera.json")), json(&pair.join("pair.json")));
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let suns = [0, 1].map(|k| {
            let in_cam = |axis: usize| {
                let along = |row: usize| {
                    number(&camera["world_from_cam"][row][axis])
                        * number(&record["suns"][k]["direction"][row])
                };
                along(0) + along(1) + along(2)
            };
            format!("{},{},{}", in_cam(0), in_cam(1), in_cam(2))
        });
        (place, suns)
    });
    let place = Place::new();
    for name in FILES {
        std::fs::copy(made.path(name), place.path(name)).unwrap();
    }
    Campaign { place, suns: suns.clone() }
}

impl Campaign {
    /// With pictures under these lights, on a model.
    fn refine(&self, dem: &str, lights: &[usize], options: &str) -> Answer {
        let pictures: String = lights.iter().map(|k| format!(" l{k}.png")).collect();
        let known: String =
            lights.iter().map(|k| format!(" --camera camera.json --sun {}", self.suns[*k])).collect();
        self.place.run(&format!("refine {dem}{pictures}{known} {options} --force"))
    }

    /// Refused, with a hint, and nothing is left behind.
    fn refused(&self, dem: &str, options: &str, says: &str, hints: &str) {
        let before = self.place.names();
        self.refine(dem, &[0], &format!("{options} --out out -q")).refused(says, hints);
        assert_eq!(self.place.names(), before, "something was left behind");
    }
}

fn read(path: &Path) -> Raster<f32> {
    DemReader::open(path, &OpenOptions::default()).unwrap().read_all().unwrap()
}

/// Heights on the grid of a file.
fn write(like: &Path, path: &Path, heights: &Raster<f32>) {
    let info = DemReader::open(like, &OpenOptions::default()).unwrap().info().clone();
    let (width, height) = (heights.width, heights.height);
    let options = WriteOptions::default();
    let mut writer =
        GeoTiffWriter::create(path, width, height, &info.crs, &info.map_from_pixel, options).unwrap();
    writer.write_rows(&heights.data).unwrap();
    writer.finish().unwrap();
}

/// Means over squares, and straight lines between their middles.
fn coarse(heights: &Raster<f32>) -> Raster<f32> {
    let means = resample::block_mean(heights, COARSER);
    let at = |x: usize, count: usize| ((x as f64 + 0.5) / COARSER as f64).clamp(0.5, count as f64 - 0.5);
    Raster::from_fn(heights.width, heights.height, |x, y| {
        resample::bilinear(&means, at(x, means.width), at(y, means.height)).unwrap() as f32
    })
}

/// Root mean square errors of heights (metres) and of slopes (degrees) where the pictures see the ground, before and after.
fn errors(place: &Place, out: &str) -> [[f64; 2]; 2] {
    let answer: serde_json::Value =
        serde_json::from_slice(&std::fs::read(place.path(out).join("refine.json")).unwrap()).unwrap();
    let number = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
    let (left, top) = (number(&answer["first"][0]), number(&answer["first"][1]));
    let found = read(&place.path(out).join("dem.tif"));
    let seen = read(&place.path(out).join("albedo.tif"));
    let window = |name: &str| {
        let whole = read(&place.path(name));
        Raster::from_fn(found.width, found.height, |x, y| whole[(x + left, y + top)])
    };
    let (truth, given) = (window("true.tif"), window("coarse.tif"));
    let slope = |heights: &Raster<f32>| gradient::horn(heights, [40.0, 40.0]).slope_rad();
    let inside = |x: usize, y: usize| {
        // Not where the change fades out.
        (0..=16).all(|d| {
            let there = |x: Option<usize>, y: Option<usize>| {
                x.zip(y).and_then(|(x, y)| seen.get(x, y)).is_some_and(|v| v.is_finite())
            };
            there(Some(x + d), Some(y))
                && there(x.checked_sub(d), Some(y))
                && there(Some(x), Some(y + d))
                && there(Some(x), y.checked_sub(d))
        })
    };
    let rms = |a: &Raster<f32>, b: &Raster<f32>| {
        let (mut sum, mut count) = (0.0, 0);
        for y in 0..a.height {
            for x in 0..a.width {
                if inside(x, y) {
                    sum += f64::from(a[(x, y)] - b[(x, y)]).powi(2);
                    count += 1;
                }
            }
        }
        assert!(count > 3000, "{count}");
        (sum / f64::from(count)).sqrt()
    };
    [&given, &found].map(|heights| [rms(heights, &truth), rms(&slope(heights), &slope(&truth)).to_degrees()])
}

#[test]
fn one_picture_sharpens_and_two_suns_sharpen_more() {
    let campaign = campaign();
    let place = &campaign.place;
    campaign.refine("coarse.tif", &[0], "--out one -q").ok();
    let answer = campaign.refine("coarse.tif", &[0, 1], "--out two -q --json").ok().json();
    assert_eq!(answer["pictures"].as_array().unwrap().len(), 2);
    let [given, one] = errors(place, "one");
    let [_, two] = errors(place, "two");
    let factors = |after: [f64; 2]| [given[0] / after[0], given[1] / after[1]];
    let [one, two] = [factors(one), factors(two)];
    println!("given {given:?}, sharper by {one:?} with one picture, by {two:?} with two");
    // Measured: 1.32 and 2.78 with one picture, 1.54 and 5.97 with two. Long waves, which are most of the heights, are the model's.
    assert!(one[0] > 1.2 && one[1] > 2.0, "{one:?}");
    assert!(two[0] > 1.4 && two[1] > 4.0, "{two:?}");
    let files = names(&place.path("two"));
    for name in
        ["albedo.tif", "change.tif", "dem.tif", "refine.json", "report.html", "residual_2.tif", "run.toml"]
    {
        assert!(files.iter().any(|file| file == name), "{name} in {files:?}");
    }
    let record = std::fs::read_to_string(place.path("two/run.toml")).unwrap();
    assert!(record.contains("command = \"refine\"") && record.contains("coarse.tif"), "{record}");
}

#[test]
fn ground_that_no_picture_sees_stays_and_there_is_no_seam() {
    let campaign = campaign();
    let place = &campaign.place;
    campaign.refine("coarse.tif", &[0], "--out out -q --no-report").ok();
    let answer = std::fs::read(place.path("out/refine.json")).unwrap();
    let answer: serde_json::Value = serde_json::from_slice(&answer).unwrap();
    let number = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
    let (left, top) = (number(&answer["first"][0]), number(&answer["first"][1]));
    let [found, seen, change] =
        ["dem.tif", "albedo.tif", "change.tif"].map(|name| read(&place.path("out").join(name)));
    let given = read(&place.path("coarse.tif"));
    let (mut unseen, mut step, mut rms) = (0, 0.0f32, 0.0f32);
    for y in 0..found.height {
        for x in 0..found.width {
            rms += change[(x, y)].powi(2) / change.data.len() as f32;
            if seen[(x, y)].is_nan() {
                unseen += 1;
                assert_eq!(found[(x, y)], given[(x + left, y + top)]);
            }
            let beside = seen.get(x + 1, y).copied().unwrap_or(seen[(x, y)]);
            if beside.is_nan() != seen[(x, y)].is_nan() {
                step = step.max((change[(x + 1, y)] - change[(x, y)]).abs());
            }
        }
    }
    assert!(unseen > 100 && rms > 0.01, "{unseen} {rms}");
    // Where a picture ends, the change has faded out.
    assert!(step < 0.05 * rms.sqrt(), "{step} of {}", rms.sqrt());
    // The same place on the map as the cells it was cut from.
    let corner = |name: &str| {
        let info = DemReader::open(&place.path(name), &OpenOptions::default()).unwrap().info().clone();
        info.map_from_pixel
    };
    assert_eq!(corner("out/dem.tif").apply(0.0, 0.0), corner("coarse.tif").apply(left as f64, top as f64));
    campaign.refine("coarse.tif", &[0], "--cell-m 20 --out fine -q --no-report").ok();
    let fine = read(&place.path("fine/dem.tif"));
    assert_eq!([fine.width, fine.height], [2 * found.width, 2 * found.height]);
}

#[test]
fn a_model_of_other_ground_is_refused() {
    let campaign = campaign();
    let place = &campaign.place;
    let coarse = read(&place.path("coarse.tif"));
    // The same relief 5 km away, as far as the map goes.
    let (width, height) = (coarse.width, coarse.height);
    let away =
        Raster::from_fn(width, height, |x, y| coarse[((x + width / 2) % width, (y + height / 2) % height)]);
    write(&place.path("coarse.tif"), &place.path("away.tif"), &away);
    campaign.refused("away.tif", "", "does not show this ground", "camera's place");
    // Level ground cannot be recognised, and that is said.
    let level = Raster::filled(width, height, -1300.0);
    write(&place.path("coarse.tif"), &place.path("level.tif"), &level);
    let answer = campaign.refine("level.tif", &[0], "--out level --no-report").ok();
    assert!(answer.stderr.contains("too smooth to be recognised in the pictures"), "{}", answer.stderr);
    // Another body, and another sphere of this one.
    let crs = |radius_m: u32| format!("+proj=stere +lat_0=-90 +R={radius_m} +units=m");
    let args = |radius_m: u32| {
        let crs = crs(radius_m);
        place.run_args(&[
            "refine",
            "coarse.tif",
            "l0.png",
            "--camera",
            "camera.json",
            "--sun",
            "330,20",
            "--out",
            "out",
            "--crs",
            &crs,
        ])
    };
    args(3_396_190).refused("sphere", "gdalwarp");
    args(1_738_000).refused("sphere", "gdalwarp");
    assert!(!place.path("out").exists());
}

#[test]
fn pictures_cameras_and_suns_that_cannot_be() {
    let campaign = campaign();
    let place = &campaign.place;
    let sun = &campaign.suns[0];
    let refused = |line: String, says: &str, hints: &str| {
        let before = place.names();
        place.run(&format!("refine {line} --out out -q")).refused(says, hints);
        assert_eq!(place.names(), before, "something was left behind");
    };
    refused(
        format!("coarse.tif l0.png l1.png --camera camera.json --sun {sun}"),
        "2 pictures and 1 cameras",
        "--camera once for each",
    );
    refused(
        format!("coarse.tif l0.png --camera camera.json --sun {sun} --sun {sun}"),
        "1 pictures and 2 Suns",
        "--sun once for each",
    );
    let black = Raster::filled(160, 160, 0u8);
    place.write("black.png", selenograph_raster::codec::png::encode_grey8(&black).unwrap());
    refused(
        format!(
            "coarse.tif l0.png black.png --camera camera.json --camera camera.json --sun {sun} --sun {sun}"
        ),
        "`black.png` is all black",
        "",
    );
    place.write("bare.toml", "width_px = 160\nheight_px = 160\nfov_deg = 45.0\n");
    refused(format!("coarse.tif l0.png --camera bare.toml --sun {sun}"), "without a place", "world");
    refused("coarse.tif l0.png --camera camera.json --sun 330,-5".to_owned(), "above the horizon", "");
    // The camera looks down its Z axis: this Sun is below it.
    refused(
        "coarse.tif l0.png --camera camera.json --sun 0,0.5,1".to_owned(),
        "below the horizon",
        "towards the Sun",
    );
    campaign.refused("coarse.tif", "--cell-m 60", "cells of 60 m", "--cell-m");
    campaign.refused("coarse.tif", "--dem-sigma-m -3", "no such length", "metres");
    // A corner of the map, far from the picture.
    let coarse = read(&place.path("coarse.tif"));
    let corner = Raster::from_fn(40, 40, |x, y| coarse[(x, y)]);
    write(&place.path("coarse.tif"), &place.path("corner.tif"), &corner);
    campaign.refused("corner.tif", "", "does not see the elevation model", "taken from");
}
