//! The real files of the shared data folder, where it is present.
// Helpers of a test are tests too: a failure there is a panic with its place.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr)]

use selenograph_raster::Raster;
use selenograph_raster::dem::{DemInfo, DemReader, OpenOptions};
use selenograph_raster::resample;
use std::path::{Path, PathBuf};

fn dem_folder(test: &str) -> Option<PathBuf> {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        |root| {
            let root = PathBuf::from(root);
            // A relative path counts from the workspace's root.
            if root.is_absolute() {
                root
            } else {
                Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(root)
            }
        },
    );
    let folder = root.join("data/dem");
    if folder.is_dir() {
        eprintln!("RAN shared-data: {test}");
        Some(folder)
    } else {
        eprintln!("SKIP shared-data: {test}: no folder {}", folder.display());
        None
    }
}

fn read(path: &Path, band: usize) -> (DemInfo, Raster<f32>) {
    let options = OpenOptions { band: Some(band), ..OpenOptions::default() };
    let mut dem = DemReader::open(path, &options).unwrap_or_else(|e| panic!("{e}"));
    let heights = dem.read_all().unwrap_or_else(|e| panic!("{e}"));
    (dem.info().clone(), heights)
}

fn range(heights: &Raster<f32>) -> (f32, f32) {
    let valid = heights.data.iter().filter(|h| !h.is_nan());
    valid.fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), h| (lo.min(*h), hi.max(*h)))
}

/// No place of the Moon lies lower or higher by the LOLA data set (−9.13 to 10.78 km).
const LUNAR_RANGE_M: (f32, f32) = (-9200.0, 10800.0);

#[test]
fn shared_every_dem_opens() {
    let Some(folder) = dem_folder("every_dem_opens") else { return };
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for path in files {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        if !["tif", "img", "lbl", "xml"].iter().any(|e| ending == *e) {
            continue;
        }
        let bands = DemReader::open(&path, &OpenOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        for band in 1..=bands.info().num_bands {
            let (info, heights) = read(&path, band);
            let (lo, hi) = range(&heights);
            eprintln!("{} band {band}: {}, {lo}..{hi}", path.display(), info.storage);
            assert!(lo < hi, "{}", path.display());
            assert!(info.map_from_pixel.inverse().is_ok());
            // The middle of the raster lies on the map.
            let [x, y] = info.map_from_pixel.apply(info.width as f64 / 2.0, info.height as f64 / 2.0);
            assert!(info.crs.projection.place_from_map(x, y).is_some());
        }
    }
}

/// Ranges and places that the folder's README tells.
#[test]
fn shared_named_dems_are_as_described() {
    let Some(folder) = dem_folder("named_dems_are_as_described") else { return };
    // Name, band, lowest and highest (README, whole metres), corner x and y, cell.
    let expected = [
        ("peak_near_shackleton_5m.tif", 1, -416.0, 1648.0, 22_010.0, -12_010.0, 5.0),
        ("connecting_ridge_5m.tif", 1, -516.0, 1958.0, -18_990.0, -4_010.0, 5.0),
        ("shackleton_region_40m.tif", 1, -2870.0, 1957.0, -11_960.0, 19_960.0, 40.0),
        ("lola_dem_south.tif", 1, -9025.0, 6907.0, -609_600.0, 609_600.0, 1600.0),
        ("lola_dem_north.tif", 1, -4977.0, 3319.0, -609_600.0, 609_600.0, 1600.0),
        ("Aristarchus_CP_data.tif", 3, -3304.0, 505.0, f64::NAN, f64::NAN, 214.0),
        ("Herodutus_Mons_hsr.tif", 2, -1685.0, -297.0, -6865.161, 5131.756, 53.634),
        ("gz_dem_moon.tif", 1, -212.0, -205.0, -53_750.0, -51_050.0, 2.4266),
        ("ldem_4.lbl", 1, -8878.5, 10_504.0, -5_458_203.076, 2_729_101.538, 7580.8376),
    ];
    for (name, band, lo, hi, x, y, cell_m) in expected {
        let path = folder.join(name);
        if !path.is_file() {
            eprintln!("SKIP shared-data: {name} is not there");
            continue;
        }
        let (info, heights) = read(&path, band);
        let found = range(&heights);
        assert!((found.0 - lo).abs() <= 0.6 && (found.1 - hi).abs() <= 0.6, "{name}: {found:?}");
        assert!(found.0 > LUNAR_RANGE_M.0 && found.1 < LUNAR_RANGE_M.1);
        let [x0, y0] = info.map_from_pixel.apply(0.0, 0.0);
        assert!(x.is_nan() || (x0 - x).abs() < 1e-3 && (y0 - y).abs() < 1e-3, "{name}: {x0} {y0}");
        let [step, _] = info.map_from_pixel.steps();
        assert!((step / cell_m - 1.0).abs() < 5e-3, "{name}: {step}");
        assert_eq!(info.crs.body.radius_m, 1_737_400.0, "{name}");
    }
}

/// The global map's half pixel, measured: it fits the polar maps best as its label is read, not half a pixel off.
#[test]
fn shared_global_map_agrees_with_polar_maps() {
    let Some(folder) = dem_folder("global_map_agrees_with_polar_maps") else { return };
    let global = folder.join("ldem_4.lbl");
    for polar in [folder.join("lola_dem_south.tif"), folder.join("lola_dem_north.tif")] {
        if !global.is_file() || !polar.is_file() {
            eprintln!("SKIP shared-data: ldem_4 and polar maps are not there");
            return;
        }
        let (wide, wide_heights) = read(&global, 1);
        let (map, map_heights) = read(&polar, 1);
        let pixel_from_map = wide.map_from_pixel.inverse().unwrap();
        let map_from_grid = map.map_from_pixel.grid_from_pixel();
        let rms = |dc: f64, dr: f64| {
            let (mut sum, mut count) = (0.0, 0);
            for row in (0..map.height).step_by(3) {
                for column in (0..map.width).step_by(3) {
                    let [x, y] = map_from_grid.apply(column as f64, row as f64);
                    // Near the pole the global map's columns crowd; beyond 600 km the corners begin.
                    if !(3e5..6e5).contains(&x.hypot(y)) {
                        continue;
                    }
                    let place = map.crs.projection.place_from_map(x, y).unwrap();
                    let [gx, gy] = wide.crs.projection.map_from_place(&place).unwrap();
                    let [c, r] = pixel_from_map.apply(gx, gy);
                    let Some(h) = resample::bilinear(&wide_heights, c + dc, r + dr) else { continue };
                    sum += (h - f64::from(map_heights[(column, row)])).powi(2);
                    count += 1;
                }
            }
            assert!(count > 10_000);
            (sum / f64::from(count)).sqrt()
        };
        let here = rms(0.0, 0.0);
        eprintln!("{}: rms {here:.1} m", polar.display());
        for (dc, dr) in [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)] {
            assert!(here < 0.9 * rms(dc, dr), "shift {dc} {dr}");
        }
    }
}
