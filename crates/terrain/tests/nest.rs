//! Nested models: continuous at the rim, no cliff at the seam, holes filled. On synthetic nests and on the real ones.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "a test may panic and tell"
)]

use selenograph_files::{Existing, FolderDraft};
use selenograph_geometry::{Body, Projection, proj_string::Crs};
use selenograph_raster::dem::{DemReader, OpenOptions};
use selenograph_raster::georef::Affine;
use selenograph_terrain::import::{ImportOptions, ImportSource, import};
use selenograph_terrain::nest::{NestOptions, NestReport, add_nested};
use selenograph_terrain::store::{Source, TERRAIN, TerrainWriter, describe, verify};
use selenograph_terrain::{Grid, Layer, Terrain};
use std::path::{Path, PathBuf};

fn draft(target: &Path) -> FolderDraft {
    FolderDraft::claim(target, &TERRAIN, Existing::Refuse).unwrap()
}

fn south(cols: usize, rows: usize, x0: f64, y0: f64, cell: f64) -> Grid {
    let body = Body::moon();
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
    Grid::new(crs, cols, rows, Affine::north_up(x0, y0, cell, cell)).unwrap()
}

/// Heights of a function of the south polar map at the nodes of a grid on any map.
fn nodes(grid: &Grid, height: impl Fn(f64, f64) -> f64) -> Vec<f32> {
    let map = Projection::south_polar(grid.crs.body.radius_m);
    (0..grid.cols * grid.rows)
        .map(|n| {
            let point = grid.point_from_grid((n % grid.cols) as f64, (n / grid.cols) as f64, 0.0).unwrap();
            let [x, y] = map.map_from_point(&point).unwrap();
            height(x, y) as f32
        })
        .collect()
}

/// Hills of 900 m to 40 km, slopes of a few degrees.
fn hills(x: f64, y: f64) -> f64 {
    (1..7)
        .map(|k| {
            let wave = 40_000.0 / 2f64.powi(k);
            wave * 0.02
                * ((x * 0.8 + y * 0.6) / wave + f64::from(k)).sin()
                * ((y * 0.9 - x * 0.3) / wave).cos()
        })
        .sum::<f64>()
        * std::f64::consts::TAU
}

fn source() -> Source {
    Source { name: "test".into(), blake3: None, details: serde_json::Value::Null }
}

/// A terrain of a coarse grid and finer ones, coarse to fine.
fn nested(target: &Path, layers: &[(Grid, Vec<f32>)]) -> (Terrain, Vec<NestReport>) {
    let mut writer = TerrainWriter::create(draft(target), Body::moon());
    let mut reports = Vec::new();
    for (idx, (grid, heights)) in layers.iter().enumerate() {
        if idx == 0 {
            let mut layer = writer.begin_layer(grid, false).unwrap();
            layer.push_rows(heights).unwrap();
            writer.finish_layer(layer, source(), None, None).unwrap();
            continue;
        }
        let read = |first: usize, count: usize, out: &mut Vec<f32>| {
            out.clear();
            out.extend_from_slice(&heights[first * grid.cols..(first + count) * grid.cols]);
            Ok(())
        };
        let options = NestOptions::default();
        reports.push(add_nested(&mut writer, grid, source(), &options, read, &mut |_, _| {}).unwrap());
    }
    writer.finish().unwrap();
    verify(target).unwrap();
    (Terrain::open(target).unwrap(), reports)
}

fn height_at(terrain: &Terrain, grid: &Grid, c: f64, r: f64) -> Option<f64> {
    Some(terrain.sample(&grid.point_from_grid(c, r, 0.0)?)?.height_m)
}

/// Largest step of the whole surface across the rim of a layer, at its nodes: just inside against just outside.
fn step_at_rim(terrain: &Terrain, grid: &Grid) -> f64 {
    // A hundredth of a millimetre on either side: the slope's share of the difference is nothing.
    let beside = 1e-5 / grid.cell_m();
    let (last_c, last_r) = ((grid.cols - 1) as f64, (grid.rows - 1) as f64);
    let step = |inside: [f64; 2], outside: [f64; 2]| {
        let (a, b) = (
            height_at(terrain, grid, inside[0], inside[1]),
            height_at(terrain, grid, outside[0], outside[1]),
        );
        a.zip(b).map_or(0.0, |(a, b)| (a - b).abs())
    };
    let along_c = (1..grid.cols - 1).map(|c| {
        let c = c as f64;
        step([c, beside], [c, -beside]).max(step([c, last_r - beside], [c, last_r + beside]))
    });
    let along_r = (1..grid.rows - 1).map(|r| {
        let r = r as f64;
        step([beside, r], [-beside, r]).max(step([last_c - beside, r], [last_c + beside, r]))
    });
    along_c.chain(along_r).fold(0.0, f64::max)
}

/// A quantile of slopes in degrees over a baseline, at points spread over a frame round a layer's rim: between `from_m`
/// and `to_m` inside it (negative: outside).
fn slope_quantile(
    terrain: &Terrain,
    grid: &Grid,
    base_m: f64,
    from_m: f64,
    to_m: f64,
    quantile: f64,
) -> Option<f64> {
    let cell = grid.cell_m();
    let (last_c, last_r) = ((grid.cols - 1) as f64, (grid.rows - 1) as f64);
    let (base, from, to) = (base_m / cell, from_m / cell, to_m / cell);
    let mut slopes = Vec::new();
    let depths = 12;
    for d in 0..depths {
        let depth = from + (to - from) * (f64::from(d) + 0.5) / f64::from(depths);
        for n in 0..400 {
            let t = (f64::from(n) + 0.5) / 400.0;
            let (c, r) = (depth + t * (last_c - 2.0 * depth), depth + t * (last_r - 2.0 * depth));
            for [c, r] in [[c, depth], [c, last_r - depth], [depth, r], [last_c - depth, r]] {
                let half = 0.5 * base;
                let h = |dc: f64, dr: f64| height_at(terrain, grid, c + dc, r + dr);
                let Some((((w, e), n), s)) =
                    h(-half, 0.0).zip(h(half, 0.0)).zip(h(0.0, -half)).zip(h(0.0, half))
                else {
                    continue;
                };
                slopes.push(((e - w) / base_m).hypot((n - s) / base_m).atan().to_degrees());
            }
        }
    }
    slopes.sort_by(f64::total_cmp);
    let count = slopes.len();
    (count > 1000).then(|| slopes[((count - 1) as f64 * quantile) as usize])
}

#[test]
fn a_fine_model_with_an_offset_and_a_tilt_meets_the_coarse_one_without_a_cliff() {
    let dir = tempfile::tempdir().unwrap();
    let coarse = south(80, 80, -31_600.0, 31_600.0, 800.0);
    let fine = south(401, 361, -7_000.0, 9_000.0, 40.0);
    // 60 m too high, tilted by 20 m over its width: what two real maps differ by.
    let wrong = |x: f64, y: f64| hills(x, y) + 60.0 + x / 800.0;
    let layers = [(coarse.clone(), nodes(&coarse, hills)), (fine.clone(), nodes(&fine, wrong))];
    let (terrain, reports) = nested(&dir.path().join("t"), &layers);
    let report = reports[0];
    assert!(report.widths.left_m >= 1600.0 && report.step_p99_m > 60.0, "{report:?}");
    assert!(report.rim_residual_m < 1e-3, "{report:?}");
    let step = step_at_rim(&terrain, &fine);
    assert!(step < 1e-3, "a step of {step} m at the rim");
    // In the middle nothing is changed.
    let middle = height_at(&terrain, &fine, 200.0, 180.0).unwrap();
    assert!((middle - f64::from(layers[1].1[180 * 401 + 200])).abs() < 1e-3);
    // The seam is as steep as its surroundings, plus at most what the options allow.
    let q = |from: f64, to: f64| slope_quantile(&terrain, &fine, 200.0, from, to, 0.99).unwrap();
    let (seam, inside, outside) =
        (q(0.0, report.widths.max_m()), q(report.widths.max_m() + 200.0, 7000.0), q(-3000.0, -200.0));
    assert!(seam < inside.max(outside) + 3.0, "seam {seam}°, inside {inside}°, outside {outside}°");
}

#[test]
fn holes_are_filled_from_below_and_fade_out() {
    let dir = tempfile::tempdir().unwrap();
    let coarse = south(80, 80, -31_600.0, 31_600.0, 800.0);
    let fine = south(601, 601, -12_000.0, 12_000.0, 40.0);
    let mut heights = nodes(&fine, |x, y| hills(x, y) + 25.0);
    for r in 295..310 {
        for c in 280..330 {
            heights[r * 601 + c] = f32::NAN;
        }
    }
    let (terrain, reports) =
        nested(&dir.path().join("t"), &[(coarse.clone(), nodes(&coarse, hills)), (fine.clone(), heights)]);
    assert_eq!(reports[0].num_filled, 15 * 50);
    let layer = &terrain.layers[0];
    assert!(layer.nodes().iter().all(|h| h.is_finite()));
    // Beside the hole the fine model is gone; away from it and from the rim it is itself.
    let under = |c: f64, r: f64| {
        let point = fine.point_from_grid(c, r, 0.0).unwrap();
        terrain.layers[1].bilinear(coarse.grid_from_point(&point).unwrap()).unwrap().0
    };
    for (c, r) in [(279.0, 300.0), (305.0, 294.0), (300.0, 302.0), (330.0, 310.0)] {
        assert!((height_at(&terrain, &fine, c, r).unwrap() - under(c, r)).abs() < 1e-3);
    }
    // Effective cells tell where the heights are the coarse model's.
    let cell_at = |c: f64, r: f64| layer.effective_cell_m([c, r]);
    assert!(cell_at(300.0, 300.0) > 700.0 && cell_at(3.0, 300.0) > 700.0);
    assert!(cell_at(150.0, 150.0) < 41.0);
}

#[test]
fn a_model_in_another_projection_fits_too() {
    let dir = tempfile::tempdir().unwrap();
    let coarse = south(100, 100, 20_000.0, -20_000.0, 500.0);
    let body = Body::moon();
    let centre = Projection::south_polar(body.radius_m).place_from_map(45_000.0, -45_000.0).unwrap();
    let projection = Projection::Orthographic {
        lat0_rad: centre.lat_rad,
        lon0_rad: centre.lon_rad,
        false_easting_m: 0.0,
        false_northing_m: 0.0,
        radius_m: body.radius_m,
    };
    let fine = Grid::new(Crs { projection, body }, 301, 301, Affine::north_up(-7_500.0, 7_500.0, 50.0, 50.0))
        .unwrap();
    let layers =
        [(coarse.clone(), nodes(&coarse, hills)), (fine.clone(), nodes(&fine, |x, y| hills(x, y) + 30.0))];
    let (terrain, reports) = nested(&dir.path().join("t"), &layers);
    assert!(reports[0].rim_residual_m < 1e-3);
    let step = step_at_rim(&terrain, &fine);
    assert!(step < 1e-3, "{step}");
    let expected = f64::from(layers[1].1[150 * 301 + 150]);
    assert!((height_at(&terrain, &fine, 150.0, 150.0).unwrap() - expected).abs() < 1e-3);
}

#[test]
fn a_model_that_sticks_out_keeps_its_heights_there() {
    let dir = tempfile::tempdir().unwrap();
    let coarse = south(40, 40, -31_200.0, 31_200.0, 800.0);
    // Its right half lies beyond the coarse model, which ends at x = 0.
    let fine = south(501, 301, -10_000.0, 12_000.0, 40.0);
    let layers =
        [(coarse.clone(), nodes(&coarse, hills)), (fine.clone(), nodes(&fine, |x, y| hills(x, y) + 20.0))];
    let (terrain, _) = nested(&dir.path().join("t"), &layers);
    let written: &Layer = &terrain.layers[0];
    for (i, j) in [(500, 0), (480, 150), (400, 300)] {
        assert_eq!(written.node(i, j), layers[1].1[j * 501 + i]);
    }
    // Neighbouring nodes never differ by more than the relief does.
    let steepest = written
        .nodes()
        .chunks_exact(501)
        .flat_map(|row| row.windows(2))
        .fold(0f32, |m, w| m.max((w[1] - w[0]).abs()));
    assert!(steepest < 40.0 * 0.5, "{steepest}");
}

/// The shared data's folder, or a message that it is not there.
fn shared(name: &str) -> Option<PathBuf> {
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
    let path = root.join(name);
    if !path.exists() {
        eprintln!("SKIP shared-data: {} is not there", path.display());
        return None;
    }
    Some(path)
}

/// The models under `data/dem` that lie inside a coarser one on the same map, each such coarse model with its fine ones.
fn nested_models() -> Vec<Vec<ImportSource>> {
    let Some(folder) = shared("data/dem") else { return Vec::new() };
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|e| e == "tif" || e == "lbl" || e == "xml"));
    paths.sort();
    let grid = |path: &PathBuf| {
        let reader = DemReader::open(path, &OpenOptions::default()).unwrap();
        let info = reader.info();
        Grid::new(info.crs.clone(), info.width, info.height, info.map_from_pixel.grid_from_pixel()).unwrap()
    };
    let models: Vec<(PathBuf, Grid)> = paths.into_iter().map(|path| (path.clone(), grid(&path))).collect();
    let lies_inside = |fine: &Grid, coarse: &Grid| {
        let corners = [0, fine.cols - 1].map(|c| [0, fine.rows - 1].map(|r| [c as f64, r as f64]));
        fine.crs == coarse.crs
            && fine.cell_m() < coarse.cell_m()
            && corners.as_flattened().iter().all(|[c, r]| {
                let [x, y] = fine.map_from_grid().apply(*c, *r);
                coarse.contains(coarse.grid_from_map().apply(x, y))
            })
    };
    let source = |path: &PathBuf| ImportSource { path: path.clone(), options: OpenOptions::default() };
    let outermost = models.iter().filter(|(_, own)| !models.iter().any(|(_, other)| lies_inside(own, other)));
    outermost
        .map(|(path, coarse)| {
            let fine =
                models.iter().filter(|(_, grid)| lies_inside(grid, coarse)).map(|(path, _)| source(path));
            fine.chain([source(path)]).collect::<Vec<_>>()
        })
        .filter(|nest| nest.len() > 1)
        .collect()
}

#[test]
fn shared_real_models_make_one_surface_without_cliffs() {
    let nests = nested_models();
    for sources in &nests {
        check_nest(sources);
    }
    if !nests.is_empty() {
        println!("RAN shared-data: shared_real_models_make_one_surface_without_cliffs");
    }
}

fn check_nest(sources: &[ImportSource]) {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("terrain");
    import(sources, draft(&target), &ImportOptions::default(), &mut |_| {}).unwrap();
    let terrain = Terrain::open(&target).unwrap();
    let description = describe(&target).unwrap();
    assert_eq!(terrain.layers.len(), sources.len());
    for (layer, described) in terrain.layers.iter().zip(&description.layers) {
        let Some(report) = described.nest else { continue };
        let name = &described.source.name;
        // Slopes over twice the finer cell see a cliff of one cell; 400 m sees what fading adds.
        for base_m in [2.0 * layer.cell_m, 400.0] {
            let q = |from: f64, to: f64, quantile: f64| {
                slope_quantile(&terrain, &layer.grid, base_m, from, to, quantile).unwrap()
            };
            let width = report.widths.max_m();
            let line = |quantile: f64| {
                [
                    q(0.0, width, quantile),
                    q(width, 2.0 * width, quantile),
                    q(-width, 0.0, quantile),
                    q(-2.0 * base_m, 2.0 * base_m, quantile),
                ]
            };
            let [seam, inside, outside, rim] = line(0.99);
            println!(
                "{name} base {base_m:.0} m, width {width:.0} m: p99 seam {seam:.1}°, inside {inside:.1}°, outside {outside:.1}°, rim {rim:.1}°; medians {:?}; {report:?}",
                line(0.5).map(|v| (v * 10.0).round() / 10.0)
            );
            // The seam may add what the options allow a residual of the 99th percentile (2.9°) and as much again for
            // the waves that the coarse model does not have.
            assert!(
                seam < inside.max(outside) + 6.0,
                "{name}: seam {seam}°, inside {inside}°, outside {outside}°"
            );
            assert!(rim < inside.max(outside) + 3.0, "{name}: rim {rim}°");
        }
        assert!(report.rim_residual_m < 1e-3, "{name}: {report:?}");
        let step = step_at_rim(&terrain, &layer.grid);
        assert!(step < 1e-3, "{name}: a step of {step} m");
        // In the middle the model is unchanged.
        let path = sources.iter().find(|s| s.path.ends_with(name)).unwrap();
        let mut reader = DemReader::open(&path.path, &path.options).unwrap();
        let (row, mut rows) = (layer.grid.rows / 2, Vec::new());
        reader.read_rows(row, 1, &mut rows).unwrap();
        let col = layer.grid.cols / 2;
        assert!((rows[col] - layer.node(col, row)).abs() < 1e-3);
    }
}
