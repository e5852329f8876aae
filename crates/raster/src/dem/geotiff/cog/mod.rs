//! Cloud-optimised GeoTIFF: tiles, overviews, all directories before the samples.
//!
//! Written row by row with bounded memory: each level spools its compressed tiles into a temporary file beside the
//! target (about as large as its part of the result), and the file is put together when the last row is there, smallest
//! level first.
//!
//! # Source
//! OGC 21-026 "OGC Cloud Optimized GeoTIFF standard"; the ghost area (block leaders and trailers) after the documentation
//! of GDAL's COG driver.

mod header;
mod level;
mod metadata;
mod options;

pub use metadata::category_names;
pub use options::{ByteOverviews, CogBand, CogClass, CogOptions, CogPlace, CogSamples};

use super::write::{MAX_CLASSIC_BYTES, nodata_text, refuse_nodata};
use super::write_keys::{geo_tags, local_tags};
use crate::tiff::encode::{Tag, directory_bytes, directory_size};
use crate::tiff::tags::*;
use crate::{Error, Raster};
use header::GHOST_AREA;
use level::Level;
use metadata::{color_map, metadata_xml};
use selenograph_files::FileDraft;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A cloud-optimised GeoTIFF being written from the top. The file gets its name in [`CogWriter::finish`].
///
/// # Example
/// ```
/// use selenograph_raster::Affine;
/// use selenograph_raster::dem::cog::{CogOptions, CogPlace, CogWriter};
/// let dir = tempfile::tempdir()?;
/// let place = CogPlace::Local {
///     name: "local grid, metres".into(),
///     metric: true,
///     local_from_pixel: Affine::north_up(0.0, 0.0, 2.0, 2.0),
/// };
/// let options = CogOptions::float("height", "m");
/// let mut cog = CogWriter::create(&dir.path().join("dem.tif"), 100, 80, &place, options)?;
/// for _ in 0..80 {
///     cog.write_rows(&[0.0; 100])?;
/// }
/// cog.finish()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct CogWriter {
    path: PathBuf,
    options: CogOptions,
    geo_tags: Vec<Tag>,
    /// The full size first, then each half as large.
    levels: Vec<Level>,
}

impl CogWriter {
    /// Begins a file of `width × height` pixels.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for an empty raster, a side past 2³², a tile that is no multiple of 16, or no band;
    /// [`Error::Encode`] for classes of anything but one band of bytes; [`Error::Io`].
    pub fn create(
        path: &Path,
        width: usize,
        height: usize,
        place: &CogPlace,
        options: CogOptions,
    ) -> Result<Self, Error> {
        let side = options.tile_side;
        let fits = |side: usize| side > 0 && u32::try_from(side).is_ok();
        let sound = side > 0 && side.is_multiple_of(16) && side <= 4096;
        if !fits(width) || !fits(height) || !sound || options.bands.is_empty() || options.bands.len() > 64 {
            return Err(Error::SizeMismatch {
                what: "GeoTIFF",
                expected: "sides from 1 to 2³², tiles of a multiple of 16 up to 4096, 1 to 64 bands"
                    .to_owned(),
                found: format!("{width}×{height}, tiles of {side}, {} bands", options.bands.len()),
            });
        }
        let holds_classes = matches!(options.samples, CogSamples::Byte { .. }) && options.bands.len() == 1;
        if !holds_classes && !options.classes.is_empty() {
            return Err(Error::Encode {
                format: "GeoTIFF",
                what: "classes are the numbers of one band of bytes".to_owned(),
            });
        }
        let geo_tags = match place {
            CogPlace::Map { crs, map_from_pixel } => geo_tags(crs, map_from_pixel),
            CogPlace::Local { name, metric, local_from_pixel } => local_tags(name, *metric, local_from_pixel),
        };
        let mut levels = vec![Level::create(path, 0, width, height, &options)?];
        let (mut width, mut height) = (width, height);
        while width.max(height) > side {
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            levels.push(Level::create(path, levels.len(), width, height, &options)?);
        }
        Ok(Self { path: path.to_owned(), options, geo_tags, levels })
    }

    /// Appends whole rows, samples of a pixel beside each other, NaN where absent.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for a broken row or more rows than the raster has; [`Error::Encode`] for a number that
    /// a byte cannot hold or that means absent; [`Error::Io`].
    pub fn write_rows(&mut self, samples: &[f32]) -> Result<(), Error> {
        let (row_len, height) = (self.levels[0].row_len(), self.levels[0].height);
        let rows = samples.len() / row_len;
        if !samples.len().is_multiple_of(row_len) || self.levels[0].num_rows_seen() + rows > height {
            return Err(Error::SizeMismatch {
                what: "rows to write",
                expected: format!("whole rows of {row_len}, {height} in all"),
                found: format!("{} samples at row {}", samples.len(), self.levels[0].num_rows_seen()),
            });
        }
        if let CogSamples::Float32 { nodata } = self.options.samples {
            refuse_nodata(samples, nodata)?;
        }
        for row in samples.chunks_exact(row_len) {
            let mut row = std::borrow::Cow::Borrowed(row);
            for level in &mut self.levels {
                level.push(&row)?;
                match level.reduced(&row) {
                    Some(next) => row = std::borrow::Cow::Owned(next),
                    None => break,
                }
            }
        }
        Ok(())
    }

    /// Puts the file together and gives it its name. BigTIFF is chosen where the file needs it.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if rows are missing; [`Error::Io`].
    pub fn finish(self) -> Result<(), Error> {
        self.finish_within(MAX_CLASSIC_BYTES)
    }

    fn finish_within(mut self, max_classic_bytes: u64) -> Result<(), Error> {
        let first = &self.levels[0];
        if first.num_rows_seen() != first.height {
            return Err(Error::SizeMismatch {
                what: "rows written",
                expected: first.height.to_string(),
                found: first.num_rows_seen().to_string(),
            });
        }
        let data: u64 = self.levels.iter().map(Level::spooled_bytes).sum();
        let big = self.directories_end(false) + data > max_classic_bytes;
        let mut draft = FileDraft::new(&self.path)?;
        self.assemble(&mut draft, big).map_err(selenograph_files::Error::io("write", &self.path))?;
        Ok(draft.commit()?)
    }

    /// Where the samples begin.
    fn directories_end(&self, big: bool) -> u64 {
        let mut end = header::first_place(big);
        for idx in 0..self.levels.len() {
            end += directory_size(&self.tags(idx, 0, big), big);
        }
        end
    }

    fn assemble(&mut self, draft: &mut FileDraft, big: bool) -> std::io::Result<()> {
        let mut file = BufWriter::with_capacity(1 << 20, draft);
        let first = header::first_place(big);
        file.write_all(&header::header(big))?;
        file.write_all(GHOST_AREA.as_bytes())?;
        file.write_all(&vec![0; first as usize - header::header(big).len() - GHOST_AREA.len()])?;
        // Samples follow from the smallest level to the full size.
        let mut starts = vec![0; self.levels.len()];
        let mut at = self.directories_end(big);
        for (start, level) in starts.iter_mut().zip(&self.levels).rev() {
            *start = at;
            at += level.spooled_bytes();
        }
        let mut place = first;
        for (idx, start) in starts.iter().enumerate() {
            let tags = self.tags(idx, *start, big);
            let end = place + directory_size(&tags, big);
            let next = if idx + 1 < starts.len() { end } else { 0 };
            file.write_all(&directory_bytes(tags, place, next, big))?;
            place = end;
        }
        for level in self.levels.iter_mut().rev() {
            level.copy_into(&mut file)?;
        }
        file.flush()
    }

    /// The tags of a level whose samples begin at `start`.
    fn tags(&self, idx: usize, start: u64, big: bool) -> Vec<Tag> {
        let level = &self.levels[idx];
        let num_bands = self.options.bands.len();
        let side = self.options.tile_side as u32;
        let repeated = |value: u16| vec![value; num_bands];
        let (bits, format, predictor, nodata) = match self.options.samples {
            CogSamples::Float32 { nodata } => (32, 3, 3, nodata_text(nodata)),
            CogSamples::Byte { nodata, .. } => (8, 1, 1, nodata.to_string()),
        };
        let has_colors = !self.options.classes.is_empty();
        // A palette, or black is zero.
        let photometric = if has_colors { 3 } else { 1 };
        let mut tags = vec![
            Tag::long(NEW_SUBFILE_TYPE, u32::from(idx > 0)),
            Tag::long(IMAGE_WIDTH, level.width as u32),
            Tag::long(IMAGE_LENGTH, level.height as u32),
            Tag::shorts(BITS_PER_SAMPLE, &repeated(bits)),
            Tag::shorts(COMPRESSION, &[8]),
            Tag::shorts(PHOTOMETRIC, &[photometric]),
            Tag::shorts(SAMPLES_PER_PIXEL, &[num_bands as u16]),
            Tag::shorts(PLANAR_CONFIGURATION, &[1]),
            Tag::shorts(PREDICTOR, &[predictor]),
            Tag::long(TILE_WIDTH, side),
            Tag::long(TILE_LENGTH, side),
            Tag::places(TILE_OFFSETS, level.offsets(start), big),
            Tag::places(TILE_BYTE_COUNTS, level.sizes(), big),
            Tag::shorts(SAMPLE_FORMAT, &repeated(format)),
            Tag::text(GDAL_NODATA, &nodata),
        ];
        if num_bands > 1 {
            // Extra samples of no special meaning.
            tags.push(Tag::shorts(EXTRA_SAMPLES, &vec![0; num_bands - 1]));
        }
        if has_colors {
            tags.push(Tag::shorts(COLOR_MAP, &color_map(&self.options.classes)));
        }
        if idx == 0 {
            let text = metadata_xml(&self.options.bands, &self.options.classes);
            tags.push(Tag::text(GDAL_METADATA, &text));
            tags.extend(self.geo_tags.iter().map(|tag| Tag(tag.0, tag.1, tag.2, tag.3.clone())));
        }
        tags.sort_by_key(|tag| tag.0);
        tags
    }
}

/// Writes a whole raster of one band.
///
/// # Errors
/// As [`CogWriter`].
pub fn write(path: &Path, raster: &Raster<f32>, place: &CogPlace, options: CogOptions) -> Result<(), Error> {
    let mut writer = CogWriter::create(path, raster.width, raster.height, place, options)?;
    writer.write_rows(&raster.data)?;
    writer.finish()
}

/// Writes a whole raster of classes; those equal to the options' no-data number are absent.
///
/// # Errors
/// As [`CogWriter`].
pub fn write_classes(
    path: &Path,
    raster: &Raster<u8>,
    place: &CogPlace,
    options: CogOptions,
) -> Result<(), Error> {
    let absent = match options.samples {
        CogSamples::Byte { nodata, .. } => Some(nodata),
        CogSamples::Float32 { .. } => None,
    };
    let mut writer = CogWriter::create(path, raster.width, raster.height, place, options)?;
    let mut row_of_floats = Vec::with_capacity(raster.width);
    for row in raster.rows() {
        row_of_floats.clear();
        row_of_floats.extend(row.iter().map(
            |&class| {
                if absent == Some(class) { f32::NAN } else { f32::from(class) }
            },
        ));
        writer.write_rows(&row_of_floats)?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests;
