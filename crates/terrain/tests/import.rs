//! Files into terrain folders.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "a test may panic and tell"
)]

use selenograph_files::{Existing, FolderDraft};
use selenograph_geometry::{Body, Geodetic, Projection, proj_string::Crs};
use selenograph_raster::dem::{GeoTiffLayout, GeoTiffWriter, OpenOptions, WriteOptions};
use selenograph_raster::georef::Affine;
use selenograph_terrain::import::{ImportOptions, ImportSource, import};
use selenograph_terrain::store::TERRAIN;
use selenograph_terrain::{Error, Terrain};
use std::path::{Path, PathBuf};

fn draft(target: &Path) -> FolderDraft {
    FolderDraft::claim(target, &TERRAIN, Existing::Refuse).unwrap()
}

fn write(
    path: &Path,
    crs: &Crs,
    affine: &Affine,
    cols: usize,
    rows: usize,
    height: impl Fn(usize, usize) -> f32,
) {
    let options = WriteOptions { layout: GeoTiffLayout::Strips { rows: 7 }, ..WriteOptions::default() };
    let mut writer = GeoTiffWriter::create(path, cols, rows, crs, affine, options).unwrap();
    let heights: Vec<f32> = (0..cols * rows).map(|n| height(n % cols, n / cols)).collect();
    writer.write_rows(&heights).unwrap();
    writer.finish().unwrap();
}

fn source(path: &Path) -> ImportSource {
    ImportSource { path: path.to_owned(), options: OpenOptions::default() }
}

fn imported(paths: &[&Path], target: &Path) -> Result<Terrain, Error> {
    let sources: Vec<_> = paths.iter().map(|p| source(p)).collect();
    import(&sources, draft(target), &ImportOptions::default(), &mut |_| {})?;
    Terrain::open(target)
}

/// Smooth over the whole sphere.
fn globe(lat_rad: f64, lon_rad: f64) -> f64 {
    1000.0 * (lat_rad.cos() * (lon_rad + 0.3).cos() + 0.5 * lat_rad.sin())
}

#[test]
fn a_global_map_has_no_gap_at_its_cut_or_at_the_poles() {
    let dir = tempfile::tempdir().unwrap();
    let body = Body::moon();
    let radius_m = body.radius_m;
    let degrees = |lon_center_deg: f64| Projection::Geographic { lon_center_deg };
    let metres = Projection::Equirectangular {
        lat_ts_rad: 0.0,
        lat0_rad: 0.0,
        lon0_rad: 0.0,
        false_easting_m: 0.0,
        false_northing_m: 0.0,
        radius_m,
    };
    let unit = radius_m.to_radians();
    let cases = [
        ("0-360.tif", degrees(180.0), Affine::north_up(0.0, 90.0, 2.0, 2.0)),
        ("180-180.tif", degrees(0.0), Affine::north_up(-180.0, 90.0, 2.0, 2.0)),
        ("metres.tif", metres, Affine::north_up(-180.0 * unit, 90.0 * unit, 2.0 * unit, 2.0 * unit)),
    ];
    for (name, projection, affine) in cases {
        let path = dir.path().join(name);
        let crs = Crs { projection, body: body.clone() };
        let start = if name == "0-360.tif" { 0.0 } else { -180.0 };
        write(&path, &crs, &affine, 180, 90, |c, r| {
            let lon: f64 = start + 2.0 * c as f64 + 1.0;
            let lat: f64 = 89.0 - 2.0 * r as f64;
            globe(lat.to_radians(), lon.to_radians()) as f32
        });
        let terrain = imported(&[&path], &dir.path().join(format!("{name}.terrain"))).unwrap();
        for lat in [-90.0, -89.7, -45.0, 0.0, 33.0, 89.5, 90.0] {
            for n in 0..720 {
                let place = Geodetic::from_deg(lat, f64::from(n) * 0.5 - 180.0, 0.0);
                let sample = terrain.sample(&body.point(&place));
                let Some(sample) = sample else {
                    panic!("{name}: a hole at {lat}° {}°", f64::from(n) * 0.5 - 180.0)
                };
                // Bilinear over 2° cells: a step² / 8 of the curvature, 0.15 m per 1000 m; twice that on the diagonal.
                assert!(
                    (sample.height_m - globe(place.lat_rad, place.lon_rad)).abs() < 0.5,
                    "{name} {lat} {n}"
                );
            }
        }
    }
}

#[test]
fn models_are_layered_by_cell_size_whatever_their_order() {
    let dir = tempfile::tempdir().unwrap();
    let body = Body::moon();
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
    let (fine, coarse) = (dir.path().join("fine.tif"), dir.path().join("coarse.tif"));
    write(&fine, &crs, &Affine::north_up(-500.0, 500.0, 5.0, 5.0), 200, 200, |c, _| c as f32);
    write(&coarse, &crs, &Affine::north_up(-4000.0, 4000.0, 100.0, 100.0), 80, 80, |_, r| r as f32);
    let mut last = (0, 0);
    let sources = [source(&coarse), source(&fine)];
    let target = dir.path().join("t");
    let description = import(&sources, draft(&target), &ImportOptions::default(), &mut |p| {
        assert!(p.rows_done <= p.num_rows && p.num_layers == 2 && p.layer_idx >= last.0);
        last = (p.layer_idx, p.rows_done);
    })
    .unwrap();
    assert_eq!(last.0, 1);
    let names: Vec<&str> = description.layers.iter().map(|l| l.source.name.as_str()).collect();
    assert_eq!(names, ["fine.tif", "coarse.tif"]);
    assert!(
        description
            .layers
            .iter()
            .all(|l| l.source.blake3.is_some() && l.source.details["format"].is_string())
    );
    let folder = dir.path().to_str().unwrap();
    assert!(!serde_json::to_string(&description).unwrap().contains(folder));
    let bytes: u64 = description.layers.iter().map(|l| l.bytes).sum();
    assert!(bytes > 4 * 200 * 200);
}

#[test]
fn what_cannot_be_imported_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let body = Body::moon();
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
    let (empty, good, target) =
        (dir.path().join("empty.tif"), dir.path().join("good.tif"), dir.path().join("t"));
    let affine = Affine::north_up(0.0, 0.0, 10.0, 10.0);
    write(&empty, &crs, &affine, 50, 40, |_, _| f32::NAN);
    write(&good, &crs, &Affine::north_up(-900.0, 900.0, 30.0, 30.0), 60, 60, |c, r| (c * r) as f32);
    let text = imported(&[&empty], &target).map(|_| ()).unwrap_err().to_string();
    assert!(text.contains("empty.tif"), "{text}");
    assert!(imported(&[&empty, &good], &target).is_err());
    // Another body, and the Moon's older radius.
    for other in [Body::mars(), Body::sphere("Moon", 1_738_000.0, "moon_me")] {
        let radius_m = other.radius_m;
        let crs = Crs { projection: Projection::south_polar(radius_m), body: other };
        let path = dir.path().join("other.tif");
        write(&path, &crs, &affine, 50, 40, |_, _| 1.0);
        for paths in [[&path, &good], [&good, &path]] {
            let error = imported(&paths.map(PathBuf::as_path), &target).map(|_| ()).unwrap_err();
            assert!(matches!(error, Error::Geometry(_)), "{error}");
            let (found, known) =
                (format!("other.tif` lies on a sphere of {radius_m} m"), "good.tif` on one of 1737400 m");
            assert!(error.to_string().contains(&found) && error.to_string().contains(known), "{error}");
        }
    }
    assert!(matches!(imported(&[], &target), Err(Error::Grid { .. })));
    // Cut in the middle: found while reading.
    let bytes = std::fs::read(&good).unwrap();
    let cut = dir.path().join("cut.tif");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    assert!(matches!(imported(&[&cut], &target), Err(Error::Raster(_))));
    let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(!target.exists() && left.iter().all(|n| n.to_string_lossy().ends_with(".tif")), "{left:?}");
}

#[test]
fn shared_every_model_imports() {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map(PathBuf::from).map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        |root| {
            if root.is_absolute() {
                root
            } else {
                Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(root)
            }
        },
    );
    let Ok(entries) = std::fs::read_dir(root.join("data/dem")) else {
        eprintln!("SKIP shared-data: data/dem is not under {}", root.display());
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let mut count = 0;
    for path in entries.map(|e| e.unwrap().path()) {
        if !path.extension().is_some_and(|e| e == "tif" || e == "lbl" || e == "xml") {
            continue;
        }
        let target = dir.path().join(path.file_stem().unwrap());
        let terrain = imported(&[&path], &target).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let layer = &terrain.layers[0];
        println!(
            "{}: {}×{}, {:.1} m, {:?} m",
            path.display(),
            layer.grid.cols,
            layer.grid.rows,
            layer.cell_m,
            layer.height_range
        );
        assert!(layer.cell_m > 0.5 && layer.height_range.0 < layer.height_range.1);
        count += 1;
    }
    if count == 0 {
        eprintln!("SKIP shared-data: no elevation model in {}", root.join("data/dem").display());
        return;
    }
    println!("RAN shared-data: shared_every_model_imports");
}
