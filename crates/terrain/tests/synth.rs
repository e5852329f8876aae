//! Synthetic relief: a pure function of seed and node, with the slopes of polar highland.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "a test may panic and tell"
)]

use selenograph_files::{Existing, FolderDraft};
use selenograph_geometry::{Body, Projection, proj_string::Crs};
use selenograph_raster::dem::{DemReader, OpenOptions, WriteOptions};
use selenograph_raster::georef::Affine;
use selenograph_terrain::store::{TERRAIN, verify};
use selenograph_terrain::synth::{BaseSurface, Synth, SynthSettings, south_polar_grid};
use selenograph_terrain::{Error, Grid, Terrain};

fn synth(size: usize, cell_m: f64, seed: u64) -> Synth {
    let settings = SynthSettings { seed, ..SynthSettings::default() };
    Synth::new(south_polar_grid(Body::moon(), size, cell_m).unwrap(), &settings, None).unwrap()
}

fn all(synth: &Synth, band: usize) -> Vec<f32> {
    let rows = synth.grid().rows;
    let (mut heights, mut out) = (Vec::new(), Vec::new());
    for first in (0..rows).step_by(band) {
        synth.read_rows(first, band.min(rows - first), &mut out);
        heights.extend_from_slice(&out);
    }
    heights
}

#[test]
fn heights_do_not_depend_on_bands_or_threads() {
    let synth = synth(700, 5.0, 3);
    let whole = all(&synth, 700);
    assert!(whole.iter().all(|h| h.is_finite()));
    assert_eq!(whole, all(&synth, 37));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(whole, pool.install(|| all(&synth, 256)));
}

#[test]
fn seeds_differ_and_a_window_of_a_larger_map_is_the_same_moon() {
    let (a, b) = (all(&synth(200, 20.0, 1), 64), all(&synth(200, 20.0, 2), 64));
    assert!(a.iter().zip(&b).filter(|(a, b)| a == b).count() < 10);
    // The same places on a grid three times as wide. Lattices of interpolated waves are tied to the grid, so that they
    // may differ by what interpolation loses.
    let wide = all(&synth(600, 20.0, 1), 64);
    let worst = (0..200 * 200)
        .map(|n| (a[n] - wide[(n / 200 + 200) * 600 + n % 200 + 200]).abs())
        .fold(0f32, f32::max);
    assert!(worst < 20.0, "{worst}");
}

/// Slope quantiles in degrees over a baseline of `step` nodes.
fn slopes(heights: &[f32], size: usize, cell_m: f64, step: usize) -> [f64; 2] {
    let mut slopes: Vec<f64> = (0..size - step)
        .step_by(3)
        .flat_map(|j| (0..size - step).step_by(3).map(move |i| j * size + i))
        .map(|at| {
            let along = |to: usize| f64::from(heights[to] - heights[at]) / (step as f64 * cell_m);
            along(at + step).hypot(along(at + step * size)).atan().to_degrees()
        })
        .collect();
    slopes.sort_by(f64::total_cmp);
    [slopes[slopes.len() / 2], slopes[slopes.len() * 95 / 100]]
}

#[test]
fn slopes_are_those_of_polar_highland() {
    // Two real polar sites of 16 km have medians of 10.5 and 12.2° and 95th percentiles of 18.2 and 22.4° at 5 m, hardly
    // less at 400 m (10.2 and 11.4°, 17.1 and 21.3°); the mean of several places of the synthetic Moon has to be near.
    let mut mean = [[0.0; 2]; 2];
    for seed in 0..6 {
        let heights = all(&synth(1000, 5.0, seed), 250);
        for (step, mean) in [1, 80].into_iter().zip(&mut mean) {
            let quantiles = slopes(&heights, 1000, 5.0, step);
            mean[0] += quantiles[0] / 6.0;
            mean[1] += quantiles[1] / 6.0;
        }
    }
    let [at_5m, at_400m] = mean;
    assert!((8.0..13.0).contains(&at_5m[0]) && (15.0..30.0).contains(&at_5m[1]), "5 m: {at_5m:?}");
    assert!((7.0..12.5).contains(&at_400m[0]) && (13.0..28.0).contains(&at_400m[1]), "400 m: {at_400m:?}");
}

#[test]
fn a_base_gives_the_long_waves() {
    let body = Body::moon();
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body: body.clone() };
    let coarse =
        Grid::new(crs, 40, 40, Affine::north_up(-19.5 * 1600.0, 19.5 * 1600.0, 1600.0, 1600.0)).unwrap();
    let target = south_polar_grid(body, 300, 40.0).unwrap();
    let base = BaseSurface::read(coarse, &target, |first, count, out| {
        out.clear();
        out.extend(
            (first..first + count)
                .flat_map(|r| (0..40).map(move |c| 3000.0 + 80.0 * c as f32 - 50.0 * r as f32)),
        );
        Ok(())
    })
    .unwrap();
    let synth = Synth::new(target, &SynthSettings::default(), Some(base)).unwrap();
    let heights = all(&synth, 100);
    let plane = |c: f64, r: f64| 3000.0 + 80.0 * c - 50.0 * r;
    let mut off: Vec<f64> = (0..90_000)
        .map(|n| {
            let (x, y) = (((n % 300) as f64 - 149.5) * 40.0, (149.5 - (n / 300) as f64) * 40.0);
            f64::from(heights[n]) - plane(x / 1600.0 + 19.5, 19.5 - y / 1600.0)
        })
        .collect();
    off.sort_by(f64::total_cmp);
    // Waves below 3.5 km and craters below 4 km are added: tens of metres, on average nothing.
    assert!(off[45_000].abs() < 40.0, "median {}", off[45_000]);
    assert!(off[85_500] - off[4500] > 20.0 && off[85_500] - off[4500] < 500.0);
}

#[test]
fn absurd_settings_and_maps_in_degrees_are_refused() {
    let grid = south_polar_grid(Body::moon(), 16, 5.0).unwrap();
    let settings = SynthSettings { crater_density: 7.0, ..SynthSettings::default() };
    let refused = Synth::new(grid.clone(), &settings, None).unwrap_err();
    assert!(matches!(refused, Error::Settings { name: "crater_density", .. }));
    let crs = Crs { projection: Projection::Geographic { lon_center_deg: 0.0 }, body: Body::moon() };
    let degrees = Grid::new(crs, 16, 16, Affine::north_up(0.0, 0.0, 0.1, 0.1)).unwrap();
    assert!(matches!(Synth::new(degrees, &SynthSettings::default(), None), Err(Error::Grid { .. })));
}

#[test]
fn geotiff_and_terrain_hold_the_same_heights() {
    let dir = tempfile::tempdir().unwrap();
    let synth = synth(300, 5.0, 9);
    let (tiff, folder) = (dir.path().join("synth.tif"), dir.path().join("terrain"));
    let mut calls = 0;
    synth
        .write_geotiff(&tiff, WriteOptions::default(), &mut |done, total| {
            assert!(done <= total);
            calls += 1;
        })
        .unwrap();
    assert!(calls > 1);
    let draft = FolderDraft::claim(&folder, &TERRAIN, Existing::Refuse).unwrap();
    synth.write_terrain(draft, &mut |_, _| {}).unwrap();
    verify(&folder).unwrap();
    let terrain = Terrain::open(&folder).unwrap();
    let mut reader = DemReader::open(&tiff, &OpenOptions::default()).unwrap();
    let raster = reader.read_all().unwrap();
    assert_eq!(raster.data, terrain.layers[0].nodes());
    assert_eq!(raster.data, all(&synth, 41));
    // The layout of LOLA's caps: col = (x + half) / cell, measured from the corner.
    let [x, y] = reader.info().map_from_pixel.apply(0.0, 0.0);
    assert!((x + 750.0).abs() < 1e-9 && (y - 750.0).abs() < 1e-9);
}
