//! `dem synth`: a synthetic Moon as a GeoTIFF, row by row.

use super::reading;
use crate::args::dem::{Reading, Synth};
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_files::FileKind;
use selenograph_geometry::Body;
use selenograph_raster::dem::{GeoTiffWriter, WriteOptions};
use selenograph_terrain::Grid;
use selenograph_terrain::synth::{self, BaseSurface, SynthSettings};
use serde::Serialize;
use std::path::Path;

/// Rows made and written at a time: one row of the file's tiles.
const BAND_ROWS: usize = 256;

/// What was made.
#[derive(Serialize)]
struct Summary {
    width: usize,
    height: usize,
    cell_m: f64,
    seed: u64,
}

/// Makes the relief and writes it.
///
/// # Errors
/// Sizes that make no map, a base that does not cover it, a target that cannot be written.
pub fn run(args: &Synth, ui: &Ui) -> anyhow::Result<Outcome> {
    let target = args.target.file(&FileKind::tiff("dem synth"))?;
    let grid = synth::south_polar_grid(Body::moon(), args.size, args.cell_m)?;
    let defaults = SynthSettings::default();
    let settings = SynthSettings {
        seed: args.seed,
        relief: args.relief,
        crater_density: args.crater_density.unwrap_or(defaults.crater_density),
        ..defaults
    };
    let base = args.base.as_deref().map(|path| read_base(path, &grid)).transpose()?;
    let relief = synth::Synth::new(grid.clone(), &settings, base)?;
    let map_from_pixel = grid.map_from_grid().pixel_from_grid();
    let mut writer = GeoTiffWriter::create(
        target.path(),
        grid.cols,
        grid.rows,
        &grid.crs,
        &map_from_pixel,
        WriteOptions { nodata: args.nodata, ..WriteOptions::default() },
    )?;
    let bar = ui.bar(grid.rows as u64, "rows");
    let mut band = Vec::new();
    for first in (0..grid.rows).step_by(BAND_ROWS) {
        let count = BAND_ROWS.min(grid.rows - first);
        relief.read_rows(first, count, &mut band);
        writer.write_rows(&band)?;
        bar.inc(count as u64);
    }
    writer.finish()?;
    bar.finish_and_clear();
    if ui.json {
        let (width, height) = (grid.cols, grid.rows);
        ui.data_json(&Summary { width, height, cell_m: args.cell_m, seed: args.seed })?;
    }
    let side_km = args.size as f64 * args.cell_m / 1000.0;
    ui.note(&format!(
        "{side_km} km round the south pole, {} m cells: {}",
        args.cell_m,
        args.target.out.display()
    ));
    Ok(Outcome::Done)
}

fn read_base(path: &Path, target: &Grid) -> anyhow::Result<BaseSurface> {
    let mut reader = reading::open(path, &Reading::default())?;
    let info = reader.info();
    let grid = Grid::new(info.crs.clone(), info.width, info.height, info.map_from_pixel.grid_from_pixel())?;
    Ok(BaseSurface::read(grid, target, |first, count, out| Ok(reader.read_rows(first, count, out)?))?)
}
