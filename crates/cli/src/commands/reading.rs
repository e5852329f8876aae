//! Opening elevation models as the command line says.

use crate::args::dem::{HeightUnit, Reading};
use selenograph_raster::dem::{self, DemReader, OpenOptions};
use std::path::Path;

/// Opens a file.
///
/// # Errors
/// Those of the reader.
pub fn open(path: &Path, reading: &Reading) -> anyhow::Result<DemReader> {
    Ok(DemReader::open(path, &options(reading))?)
}

/// The reader's options.
pub fn options(reading: &Reading) -> OpenOptions {
    OpenOptions {
        band: reading.band,
        crs: reading.crs.clone(),
        nodata: reading.nodata,
        height_unit: reading.height_unit.map(|unit| match unit {
            HeightUnit::M => dem::HeightUnit::Metre,
            HeightUnit::Km => dem::HeightUnit::Kilometre,
        }),
    }
}
