//! Writes float32 GeoTIFF and BigTIFF row by row.

use super::chunk::{Compression, apply_float_predictor};
use super::write_keys::geo_tags;
use super::*;
use crate::Affine;
use rayon::prelude::*;
use selenograph_files::FileDraft;
use selenograph_geometry::proj_string::Crs;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::PathBuf;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteOptions {
    /// Strips or tiles.
    pub layout: GeoTiffLayout,
    /// [`Compression::None`], or [`Compression::Deflate`] with the floating-point predictor.
    pub compression: Compression,
}

impl Default for WriteOptions {
    /// Tiles of 256, deflate.
    fn default() -> Self {
        Self { layout: GeoTiffLayout::Tiles { side: 256 }, compression: Compression::Deflate }
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

/// A tag of the directory: number, type, count and value bytes.
pub(super) struct Tag(pub(super) u16, pub(super) u16, pub(super) u64, pub(super) Vec<u8>);

impl Tag {
    pub(super) fn shorts(number: u16, values: &[u16]) -> Self {
        Self(number, 3, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }
    pub(super) fn long(number: u16, value: u32) -> Self {
        Self(number, 4, 1, value.to_le_bytes().to_vec())
    }
    pub(super) fn doubles(number: u16, values: &[f64]) -> Self {
        Self(number, 12, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }
    pub(super) fn text(number: u16, text: &str) -> Self {
        let bytes = [text.as_bytes(), b"\0"].concat();
        Self(number, 2, bytes.len() as u64, bytes)
    }
    /// Offsets or sizes: 64 bits in a BigTIFF, else 32.
    pub(super) fn places(number: u16, values: impl Iterator<Item = u64>, big: bool) -> Self {
        let mut bytes = Vec::new();
        let mut count = 0;
        for value in values {
            count += 1;
            bytes.extend_from_slice(&value.to_le_bytes()[..if big { 8 } else { 4 }]);
        }
        Self(number, if big { 16 } else { 4 }, count, bytes)
    }
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
    /// [`Error::SizeMismatch`] for a broken row or more rows than the raster has; [`Error::Io`].
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

    /// The chunk whose first column is `left`, of the pending rows; tiles are filled up with NaN.
    fn encode(&self, left: usize, rows: usize) -> std::io::Result<Vec<u8>> {
        let tiled = matches!(self.options.layout, GeoTiffLayout::Tiles { .. });
        let columns = self.chunk_width.min(self.width - left);
        let stored_rows = if tiled { self.chunk_height } else { rows };
        let mut bytes = Vec::with_capacity(stored_rows * self.chunk_width * 4);
        let mut row = vec![f32::NAN; self.chunk_width];
        for y in 0..stored_rows {
            if y < rows {
                row[..columns].copy_from_slice(&self.pending[y * self.width + left..][..columns]);
            } else {
                row.fill(f32::NAN);
            }
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
        let directory = self.put_directory(tags)?;
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
            Tag::text(GDAL_NODATA, "nan"),
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

    /// Values that do not fit into their entry, then the directory; returns its place.
    fn put_directory(&mut self, tags: Vec<Tag>) -> Result<u64, Error> {
        let field = if self.big { 8 } else { 4 };
        let mut table = Vec::new();
        let number = |value: u64| value.to_le_bytes()[..field].to_vec();
        for Tag(tag, kind, count, mut bytes) in tags.iter().map(|t| Tag(t.0, t.1, t.2, t.3.clone())) {
            if bytes.len() <= field {
                bytes.resize(field, 0);
            } else {
                // Values begin at a word's border.
                if self.position % 2 == 1 {
                    self.put(&[0])?;
                }
                let place = number(self.position);
                self.put(&bytes)?;
                bytes = place;
            }
            table.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &number(count), &bytes].concat());
        }
        if self.position % 2 == 1 {
            self.put(&[0])?;
        }
        let place = self.position;
        if !self.big && place > u64::from(u32::MAX) - (table.len() as u64) {
            let source = std::io::Error::other("incompressible samples: the file needs more than 4 GiB");
            return Err(Error::Io { action: "write", path: self.path.clone(), source });
        }
        let count = (tags.len() as u64).to_le_bytes();
        self.put(&count[..if self.big { 8 } else { 2 }])?;
        self.put(&table)?;
        self.put(&number(0))?;
        Ok(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dem::{DemReader, OpenOptions};
    use selenograph_geometry::proj_string;

    #[test]
    fn files_past_the_limit_have_64_bit_offsets() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        let crs = proj_string::parse("IAU_2015:30135").unwrap();
        let affine = Affine::north_up(0.0, 0.0, 5.0, 5.0);
        let heights: Vec<f32> = (0..40 * 30).map(|i| i as f32).collect();
        for (limit, big) in [(48 * 32 * 4, false), (48 * 32 * 4 - 1, true)] {
            let options =
                WriteOptions { layout: GeoTiffLayout::Tiles { side: 16 }, compression: Compression::None };
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
}
