//! Writes float32 GeoTIFF and BigTIFF row by row.

use super::write_keys::geo_tags;
use crate::tiff::chunk::{Compression, apply_float_predictor};
use crate::tiff::encode::{Tag, directory_bytes};
use crate::tiff::rows::Span;
use crate::tiff::tags::*;
use crate::{Affine, Error};
use rayon::prelude::*;
use selenograph_files::FileDraft;
use selenograph_geometry::proj_string::Crs;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Larger files than this need 64-bit offsets; the rest up to 4 GiB is left for tables and incompressible chunks.
pub(super) const MAX_CLASSIC_BYTES: u64 = 4_000_000_000;

/// How samples are cut into chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeoTiffLayout {
    /// Whole rows, so many at a time.
    Strips {
        /// Rows of a strip.
        rows: usize,
    },
    /// Squares.
    Tiles {
        /// Side of a tile: a multiple of 16.
        side: usize,
    },
}

/// How a GeoTIFF is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WriteOptions {
    /// Strips or tiles.
    pub layout: GeoTiffLayout,
    /// [`Compression::None`], or [`Compression::Deflate`] with the floating-point predictor.
    pub compression: Compression,
    /// The number written where absent; NaN if `None`.
    pub nodata: Option<f32>,
}

impl Default for WriteOptions {
    /// Tiles of 256, deflate.
    fn default() -> Self {
        Self { layout: GeoTiffLayout::Tiles { side: 256 }, compression: Compression::Deflate, nodata: None }
    }
}

/// A GeoTIFF of heights in metres (NaN where absent) being written from the top.
///
/// The file gets its name in [`GeoTiffWriter::finish`]; nothing is left if writing stops.
pub struct GeoTiffWriter {
    path: PathBuf,
    file: BufWriter<FileDraft>,
    big: bool,
    width: usize,
    height: usize,
    chunk_width: usize,
    chunk_height: usize,
    options: WriteOptions,
    geo_tags: Vec<Tag>,
    /// Rows not yet written: less than one row of chunks.
    pending: Vec<f32>,
    rows_done: usize,
    spans: Vec<Span>,
    position: u64,
}

impl GeoTiffWriter {
    /// Begins a file of `width × height` samples. BigTIFF is chosen where the samples need it.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for an empty raster, a size past 2³², or a tile that is no multiple of 16;
    /// [`Error::Unsupported`] for a compression that is not written; [`Error::Io`].
    pub fn create(
        path: &Path,
        width: usize,
        height: usize,
        crs: &Crs,
        map_from_pixel: &Affine,
        options: WriteOptions,
    ) -> Result<Self, Error> {
        Self::create_within(MAX_CLASSIC_BYTES, path, width, height, crs, map_from_pixel, options)
    }

    /// The same with another limit for 32-bit offsets.
    fn create_within(
        max_classic_bytes: u64,
        path: &Path,
        width: usize,
        height: usize,
        crs: &Crs,
        map_from_pixel: &Affine,
        options: WriteOptions,
    ) -> Result<Self, Error> {
        let (chunk_width, chunk_height, sound) = match options.layout {
            GeoTiffLayout::Strips { rows } => (width, rows.min(height), rows > 0),
            GeoTiffLayout::Tiles { side } => (side, side, side > 0 && side.is_multiple_of(16)),
        };
        let fits = |side: usize| side > 0 && u32::try_from(side).is_ok();
        if !sound || !fits(width) || !fits(height) {
            return Err(Error::SizeMismatch {
                what: "GeoTIFF",
                expected: "sides from 1 to 2³², strips of at least 1 row, tiles of a multiple of 16"
                    .to_owned(),
                found: format!("{width}×{height}, {:?}", options.layout),
            });
        }
        if !matches!(options.compression, Compression::None | Compression::Deflate) {
            return Err(Error::Unsupported {
                path: path.to_owned(),
                what: "compression for writing",
                found: format!("{:?}", options.compression),
                supported: "none, deflate",
            });
        }
        let padded = (width.div_ceil(chunk_width) * chunk_width) as u64
            * (height.div_ceil(chunk_height) * chunk_height) as u64;
        let big = padded * 4 > max_classic_bytes;
        let file = FileDraft::new(path)?;
        let mut writer = Self {
            path: path.to_owned(),
            file: BufWriter::with_capacity(1 << 20, file),
            big,
            width,
            height,
            chunk_width,
            chunk_height,
            options,
            geo_tags: geo_tags(crs, map_from_pixel),
            pending: Vec::new(),
            rows_done: 0,
            spans: Vec::new(),
            position: 0,
        };
        // The place of the directory is filled in at the end.
        writer.put(if big {
            &[73, 73, 43, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
        } else {
            &[73, 73, 42, 0, 0, 0, 0, 0]
        })?;
        Ok(writer)
    }

    /// Whether the file has 64-bit offsets.
    pub fn is_big(&self) -> bool {
        self.big
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.file.write_all(bytes).map_err(selenograph_files::Error::io("write", &self.path))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Appends whole rows.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for a broken row or more rows than the raster has; [`Error::Encode`] for a height that is
    /// the no-data number; [`Error::Io`].
    pub fn write_rows(&mut self, heights: &[f32]) -> Result<(), Error> {
        let rows = heights.len() / self.width;
        let pending = self.pending.len() / self.width;
        if !heights.len().is_multiple_of(self.width) || self.rows_done + pending + rows > self.height {
            return Err(Error::SizeMismatch {
                what: "rows to write",
                expected: format!("whole rows of {}, {} in all", self.width, self.height),
                found: format!("{} samples at row {}", heights.len(), self.rows_done + pending),
            });
        }
        refuse_nodata(heights, self.options.nodata)?;
        let mut rest = heights;
        while !rest.is_empty() {
            let band = self.chunk_height.min(self.height - self.rows_done) * self.width;
            let (now, later) = rest.split_at(rest.len().min(band - self.pending.len()));
            self.pending.extend_from_slice(now);
            rest = later;
            if self.pending.len() == band {
                self.flush_band()?;
            }
        }
        Ok(())
    }

    fn flush_band(&mut self) -> Result<(), Error> {
        let rows = self.pending.len() / self.width;
        let across = self.width.div_ceil(self.chunk_width);
        let chunks: Vec<std::io::Result<Vec<u8>>> =
            (0..across).into_par_iter().map(|idx| self.encode(idx * self.chunk_width, rows)).collect();
        for chunk in chunks {
            let bytes = chunk.map_err(Error::io("write", &self.path))?;
            self.spans.push(Span { offset: self.position, len: bytes.len() as u64 });
            self.put(&bytes)?;
        }
        self.rows_done += rows;
        self.pending.clear();
        Ok(())
    }

    /// The chunk whose first column is `left`, of the pending rows; tiles are filled up with "absent".
    fn encode(&self, left: usize, rows: usize) -> std::io::Result<Vec<u8>> {
        let tiled = matches!(self.options.layout, GeoTiffLayout::Tiles { .. });
        let columns = self.chunk_width.min(self.width - left);
        let stored_rows = if tiled { self.chunk_height } else { rows };
        let mut bytes = Vec::with_capacity(stored_rows * self.chunk_width * 4);
        let absent = self.options.nodata.unwrap_or(f32::NAN);
        let mut row = vec![absent; self.chunk_width];
        for y in 0..stored_rows {
            if y < rows {
                row[..columns].copy_from_slice(&self.pending[y * self.width + left..][..columns]);
            } else {
                row.fill(absent);
            }
            row[..columns].iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = absent);
            match self.options.compression {
                Compression::Deflate => apply_float_predictor(&row, 1, &mut bytes),
                _ => bytes.extend(row.iter().flat_map(|v| v.to_le_bytes())),
            }
        }
        if self.options.compression == Compression::None {
            return Ok(bytes);
        }
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(5));
        encoder.write_all(&bytes)?;
        encoder.finish()
    }

    /// Writes the directory and gives the file its name.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if rows are missing; [`Error::Io`].
    pub fn finish(mut self) -> Result<(), Error> {
        if self.rows_done != self.height {
            return Err(Error::SizeMismatch {
                what: "rows written",
                expected: self.height.to_string(),
                found: format!("{} and {} samples", self.rows_done, self.pending.len()),
            });
        }
        let tags = self.tags();
        // A directory begins at a word's border.
        self.put(&[0; 8][..self.position.next_multiple_of(8) as usize - self.position as usize])?;
        let directory = self.position;
        let bytes = directory_bytes(tags, directory, 0, self.big);
        if !self.big && directory + bytes.len() as u64 > u64::from(u32::MAX) {
            let source = std::io::Error::other("incompressible samples: the file needs more than 4 GiB");
            return Err(Error::Io { action: "write", path: self.path.clone(), source });
        }
        self.put(&bytes)?;
        let (place, width) = if self.big { (8, 8) } else { (4, 4) };
        self.file
            .seek(SeekFrom::Start(place))
            .and_then(|_| self.file.write_all(&directory.to_le_bytes()[..width]))
            .map_err(selenograph_files::Error::io("write", &self.path))?;
        match self.file.into_inner() {
            Ok(draft) => Ok(draft.commit()?),
            Err(error) => Err(selenograph_files::Error::io("write", &self.path)(error.into_error()).into()),
        }
    }

    fn tags(&mut self) -> Vec<Tag> {
        let tiled = matches!(self.options.layout, GeoTiffLayout::Tiles { .. });
        let deflate = self.options.compression == Compression::Deflate;
        let mut tags = vec![
            Tag::long(IMAGE_WIDTH, self.width as u32),
            Tag::long(IMAGE_LENGTH, self.height as u32),
            Tag::shorts(BITS_PER_SAMPLE, &[32]),
            Tag::shorts(COMPRESSION, &[if deflate { 8 } else { 1 }]),
            // Black is zero.
            Tag::shorts(PHOTOMETRIC, &[1]),
            Tag::shorts(SAMPLES_PER_PIXEL, &[1]),
            Tag::shorts(PLANAR_CONFIGURATION, &[1]),
            Tag::shorts(SAMPLE_FORMAT, &[3]),
            Tag::text(GDAL_NODATA, &nodata_text(self.options.nodata)),
        ];
        if deflate {
            tags.push(Tag::shorts(PREDICTOR, &[3]));
        }
        let (offsets, counts) = if tiled {
            tags.push(Tag::long(TILE_WIDTH, self.chunk_width as u32));
            tags.push(Tag::long(TILE_LENGTH, self.chunk_height as u32));
            (TILE_OFFSETS, TILE_BYTE_COUNTS)
        } else {
            tags.push(Tag::long(ROWS_PER_STRIP, self.chunk_height as u32));
            (STRIP_OFFSETS, STRIP_BYTE_COUNTS)
        };
        tags.push(Tag::places(offsets, self.spans.iter().map(|s| s.offset), self.big));
        tags.push(Tag::places(counts, self.spans.iter().map(|s| s.len), self.big));
        tags.append(&mut self.geo_tags);
        tags.sort_by_key(|tag| tag.0);
        tags
    }
}

/// The text of GDAL's no-data tag.
pub(super) fn nodata_text(nodata: Option<f32>) -> String {
    nodata.map_or_else(|| "nan".to_owned(), |value| value.to_string())
}

/// Refuses samples that would be taken for absent.
pub(super) fn refuse_nodata(samples: &[f32], nodata: Option<f32>) -> Result<(), Error> {
    match nodata {
        Some(nodata) if samples.contains(&nodata) => Err(Error::Encode {
            format: "GeoTIFF",
            what: format!("a sample is {nodata}, the number that means absent; choose another"),
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dem::{DemFormat, DemReader, OpenOptions};
    use selenograph_geometry::proj_string;

    #[test]
    fn files_past_the_limit_have_64_bit_offsets() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        let crs = proj_string::parse("IAU_2015:30135").unwrap();
        let affine = Affine::north_up(0.0, 0.0, 5.0, 5.0);
        let heights: Vec<f32> = (0..40 * 30).map(|i| i as f32).collect();
        for (limit, big) in [(48 * 32 * 4, false), (48 * 32 * 4 - 1, true)] {
            let options = WriteOptions {
                layout: GeoTiffLayout::Tiles { side: 16 },
                compression: Compression::None,
                nodata: None,
            };
            let mut writer =
                GeoTiffWriter::create_within(limit, &path, 40, 30, &crs, &affine, options).unwrap();
            assert_eq!(writer.is_big(), big);
            writer.write_rows(&heights).unwrap();
            writer.finish().unwrap();
            let mut dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
            assert_eq!(dem.info().format == DemFormat::BigTiff, big);
            assert_eq!(dem.read_all().unwrap().data, heights);
        }
    }

    #[test]
    fn a_no_data_number_stands_where_heights_are_absent() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        let crs = proj_string::parse("IAU_2015:30135").unwrap();
        let affine = Affine::north_up(0.0, 0.0, 5.0, 5.0);
        for compression in [Compression::None, Compression::Deflate] {
            let layout = GeoTiffLayout::Strips { rows: 2 };
            let options = WriteOptions { layout, compression, nodata: Some(-32_768.0) };
            let mut writer = GeoTiffWriter::create(&path, 3, 1, &crs, &affine, options).unwrap();
            assert!(matches!(writer.write_rows(&[1.0, -32_768.0, 2.0]), Err(Error::Encode { .. })));
            writer.write_rows(&[1.0, f32::NAN, 3.0]).unwrap();
            writer.finish().unwrap();
            let mut dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
            assert_eq!(dem.info().nodata, [-32_768.0]);
            let heights = dem.read_all().unwrap().data;
            assert!(heights[1].is_nan() && heights[0] == 1.0 && heights[2] == 3.0);
            // The number itself is in the file: programs that do not know NaN see it.
            let other = OpenOptions { nodata: Some(3.0), ..OpenOptions::default() };
            assert_eq!(DemReader::open(&path, &other).unwrap().read_all().unwrap().data[1], -32_768.0);
        }
    }
}
