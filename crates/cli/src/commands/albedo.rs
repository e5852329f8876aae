//! Albedo maps from georeferenced rasters.

use crate::args::render::AlbedoChoice;
use crate::exit::refuse;
use crate::ui::Ui;
use selenograph_geometry::Body;
use selenograph_raster::dem::{DemReader, OpenOptions};
use selenograph_raster::{Raster, statistics};
use selenograph_render::{Albedo, AlbedoMap};
use selenograph_terrain::Grid;
use serde::Serialize;
use std::sync::Arc;

/// Rows read at once.
const BAND_ROWS: usize = 256;

/// What the record says about the map.
#[derive(Serialize)]
pub struct AlbedoRecord {
    file: String,
    band: usize,
    mean: f64,
    elsewhere: f64,
}

/// Reads the map that the command line names; without one, albedo is 1 everywhere.
///
/// # Errors
/// A file that cannot be read, lies on another sphere or holds values below 0.
pub fn read(choice: &AlbedoChoice, body: &Body, ui: &Ui) -> anyhow::Result<(Albedo, Option<AlbedoRecord>)> {
    let Some(path) = &choice.albedo else { return Ok((Albedo::Constant(1.0), None)) };
    let options = OpenOptions { band: choice.albedo_band, ..OpenOptions::default() };
    let mut reader = DemReader::open(path, &options)?;
    let info = reader.info().clone();
    let name = format!("`{}`", path.display());
    info.body().same_sphere(name, body, "the terrain").map_err(|other| {
        let radius_m = body.radius_m;
        refuse(
            other.to_string(),
            format!(
                "if it is of the terrain's body, `gdalwarp -t_srs \"+proj=… +R={radius_m}\" in.tif out.tif` brings it onto the terrain's sphere"
            ),
        )
    })?;
    let grid = Grid::new(info.crs.clone(), info.width, info.height, info.map_from_pixel.grid_from_pixel())?;
    let mut data = Vec::with_capacity(info.width * info.height);
    let mut rows = Vec::new();
    let bar = ui.bar(info.height as u64, "rows");
    for first in (0..info.height).step_by(BAND_ROWS) {
        let count = BAND_ROWS.min(info.height - first);
        reader.read_rows(first, count, &mut rows)?;
        data.append(&mut rows);
        bar.inc(count as u64);
    }
    bar.finish_and_clear();
    let Some(summary) = statistics::summary(data.iter().map(|value| f64::from(*value))) else {
        return Err(refuse(format!("`{}` holds no albedo", path.display()), "choose another --albedo-band"));
    };
    if summary.min < 0.0 {
        return Err(refuse(
            format!("band {} of `{}` goes down to {}: no albedo", info.band, path.display(), summary.min),
            "`selenograph dem info FILE --band N` tells what a band holds; choose with --albedo-band",
        ));
    }
    let elsewhere = choice.albedo_elsewhere.unwrap_or(summary.mean);
    if !(elsewhere.is_finite() && elsewhere >= 0.0) {
        return Err(refuse(format!("--albedo-elsewhere {elsewhere}"), "an albedo is a number of at least 0"));
    }
    let record = AlbedoRecord {
        file: path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(),
        band: info.band,
        mean: summary.mean,
        elsewhere,
    };
    let values = Raster::new(info.width, info.height, data)?;
    Ok((Albedo::Map(Arc::new(AlbedoMap { grid, values, elsewhere })), Some(record)))
}
