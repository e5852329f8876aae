//! Synthetic relief into files.

use super::Synth;
use crate::Error;
use crate::import::{BAND_ROWS, add_plain};
use crate::store::{Description, Source, TerrainWriter};
use selenograph_files::FolderDraft;
use selenograph_raster::dem::{GeoTiffWriter, WriteOptions};
use std::path::Path;

impl Synth {
    /// Writes the relief as a GeoTIFF, band by band; `progress(rows done, rows to do)`.
    ///
    /// # Errors
    /// [`Error::Raster`] if the file cannot be written; nothing is left of it then.
    pub fn write_geotiff(
        &self,
        path: &Path,
        options: WriteOptions,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<(), Error> {
        let grid = self.grid();
        let map_from_pixel = grid.map_from_grid().pixel_from_grid();
        let mut writer =
            GeoTiffWriter::create(path, grid.cols, grid.rows, &grid.crs, &map_from_pixel, options)?;
        let mut band = Vec::new();
        for first in (0..grid.rows).step_by(BAND_ROWS) {
            let count = BAND_ROWS.min(grid.rows - first);
            self.read_rows(first, count, &mut band);
            writer.write_rows(&band)?;
            progress(first + count, grid.rows);
        }
        Ok(writer.finish()?)
    }

    /// Writes the relief as a terrain, without a file between; `progress(rows done, rows to do)`.
    ///
    /// # Errors
    /// [`Error::Files`], [`Error::Io`].
    pub fn write_terrain(
        &self,
        folder: FolderDraft,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<Description, Error> {
        let mut writer = TerrainWriter::create(folder, self.grid().crs.body.clone());
        let source = Source {
            name: "synthetic relief".into(),
            blake3: None,
            details: serde_json::to_value(&self.settings).unwrap_or_default(),
        };
        let read = |first: usize, count: usize, out: &mut Vec<f32>| {
            self.read_rows(first, count, out);
            Ok(())
        };
        add_plain(&mut writer, self.grid(), source, read, progress)?;
        writer.finish()
    }
}
