//! One size of the picture: rows come in, compressed tiles go into a temporary file.

use super::options::{ByteOverviews, CogOptions, CogSamples};
use crate::Error;
use crate::tiff::chunk::apply_float_predictor;
use rayon::prelude::*;
use selenograph_files::FileDraft;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes before and after the samples of a tile: its size, and its last four bytes again.
const MARGIN_BYTES: u64 = 4;

/// Deflate's effort: above this the time doubles for a percent.
const DEFLATE_EFFORT: u32 = 6;

pub(super) struct Level {
    pub(super) width: usize,
    pub(super) height: usize,
    num_bands: usize,
    side: usize,
    samples: CogSamples,
    target: PathBuf,
    /// A draft that never becomes a file.
    spool: BufWriter<FileDraft>,
    /// Bytes of each tile, without its margins.
    sizes: Vec<u64>,
    /// Rows not yet spooled: less than one row of tiles.
    pending: Vec<f32>,
    rows_spooled: usize,
    /// The upper row of two that become one row of the next level.
    upper: Option<Vec<f32>>,
}

impl Level {
    pub(super) fn create(
        target: &Path,
        idx: usize,
        width: usize,
        height: usize,
        options: &CogOptions,
    ) -> Result<Self, Error> {
        let mut name = target.file_name().unwrap_or_default().to_owned();
        name.push(format!(".level{idx}"));
        let spool = BufWriter::with_capacity(1 << 18, FileDraft::new(&target.with_file_name(name))?);
        Ok(Self {
            width,
            height,
            num_bands: options.bands.len(),
            side: options.tile_side,
            samples: options.samples,
            target: target.to_owned(),
            spool,
            sizes: Vec::new(),
            pending: Vec::new(),
            rows_spooled: 0,
            upper: None,
        })
    }

    pub(super) fn row_len(&self) -> usize {
        self.width * self.num_bands
    }

    pub(super) fn num_rows_seen(&self) -> usize {
        self.rows_spooled + self.pending.len() / self.row_len()
    }

    /// Takes one row.
    pub(super) fn push(&mut self, row: &[f32]) -> Result<(), Error> {
        if let CogSamples::Byte { .. } = self.samples {
            let sound = |v: &f32| v.is_nan() || (v.fract() == 0.0 && (0.0..=255.0).contains(v));
            if let Some(found) = row.iter().find(|v| !sound(v)) {
                let what = format!("a sample of {found} does not fit into a byte");
                return Err(Error::Encode { format: "GeoTIFF", what });
            }
        }
        self.pending.extend_from_slice(row);
        let rows = self.pending.len() / self.row_len();
        if rows == self.side || self.rows_spooled + rows == self.height {
            self.spool_tiles(rows).map_err(selenograph_files::Error::io("write", &self.target))?;
        }
        Ok(())
    }

    fn spool_tiles(&mut self, rows: usize) -> std::io::Result<()> {
        let across = self.width.div_ceil(self.side);
        let tiles: Vec<std::io::Result<Vec<u8>>> =
            (0..across).into_par_iter().map(|idx| self.encode(idx * self.side, rows)).collect();
        for tile in tiles {
            let tile = tile?;
            let size = u32::try_from(tile.len()).map_err(std::io::Error::other)?;
            self.spool.write_all(&size.to_le_bytes())?;
            self.spool.write_all(&tile)?;
            self.spool.write_all(&tile[tile.len().saturating_sub(MARGIN_BYTES as usize)..])?;
            self.sizes.push(u64::from(size));
        }
        self.rows_spooled += rows;
        self.pending.clear();
        Ok(())
    }

    /// The tile whose first column is `left`, of the pending rows; filled up with "absent".
    fn encode(&self, left: usize, rows: usize) -> std::io::Result<Vec<u8>> {
        let tile_len = self.side * self.num_bands;
        let columns = self.side.min(self.width - left) * self.num_bands;
        let mut bytes = Vec::with_capacity(self.side * tile_len * 4);
        let mut row = vec![f32::NAN; tile_len];
        for y in 0..self.side {
            if y < rows {
                let start = y * self.row_len() + left * self.num_bands;
                row[..columns].copy_from_slice(&self.pending[start..][..columns]);
                row[columns..].fill(f32::NAN);
            } else {
                row.fill(f32::NAN);
            }
            match self.samples {
                CogSamples::Float32 { nodata } => {
                    if let Some(nodata) = nodata {
                        row.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = nodata);
                    }
                    apply_float_predictor(&row, self.num_bands, &mut bytes);
                }
                CogSamples::Byte { nodata, .. } => {
                    bytes.extend(row.iter().map(|v| if v.is_nan() { nodata } else { *v as u8 }));
                }
            }
        }
        let effort = flate2::Compression::new(DEFLATE_EFFORT);
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), effort);
        encoder.write_all(&bytes)?;
        encoder.finish()
    }

    /// After [`Level::push`] of the same row: the row of the next level that it completes.
    pub(super) fn reduced(&mut self, row: &[f32]) -> Option<Vec<f32>> {
        match self.upper.take() {
            Some(upper) => Some(self.halved(&upper, row)),
            // A last row without a partner stands for itself.
            None if self.num_rows_seen() == self.height => Some(self.halved(row, &[])),
            None => {
                self.upper = Some(row.to_vec());
                None
            }
        }
    }

    fn halved(&self, upper: &[f32], lower: &[f32]) -> Vec<f32> {
        let bands = self.num_bands;
        let mut out = Vec::with_capacity(self.width.div_ceil(2) * bands);
        for column in (0..self.width).step_by(2) {
            for band in 0..bands {
                let at = column * bands + band;
                let beside = if column + 1 < self.width { at + bands } else { usize::MAX };
                let cells = [upper.get(at), upper.get(beside), lower.get(at), lower.get(beside)];
                out.push(self.one_of(cells.map(|cell| cell.copied().unwrap_or(f32::NAN))));
            }
        }
        out
    }

    /// What stands for four cells, absent ones left out.
    fn one_of(&self, cells: [f32; 4]) -> f32 {
        let there = || cells.iter().copied().filter(|v| !v.is_nan());
        match self.samples {
            CogSamples::Float32 { .. } => {
                let (sum, count) = there().fold((0.0f64, 0u32), |(sum, n), v| (sum + f64::from(v), n + 1));
                // 0 / 0 is NaN: nothing is there.
                (sum / f64::from(count)) as f32
            }
            CogSamples::Byte { overviews: ByteOverviews::Largest, .. } => there().fold(f32::NAN, f32::max),
            CogSamples::Byte { overviews: ByteOverviews::Mode, .. } => {
                let votes = |value: f32| there().filter(|v| *v == value).count();
                there().fold((f32::NAN, 0), |best, v| if votes(v) > best.1 { (v, votes(v)) } else { best }).0
            }
        }
    }

    pub(super) fn sizes(&self) -> impl Iterator<Item = u64> {
        let num_tiles = self.width.div_ceil(self.side) * self.height.div_ceil(self.side);
        // Before the last row is there, only the number of tiles counts.
        self.sizes.iter().copied().chain(std::iter::repeat(0)).take(num_tiles)
    }

    /// Where the tiles lie if the level begins at `start`.
    pub(super) fn offsets(&self, start: u64) -> impl Iterator<Item = u64> {
        let mut at = start;
        self.sizes().map(move |size| {
            let place = at + MARGIN_BYTES;
            at = place + size + MARGIN_BYTES;
            place
        })
    }

    pub(super) fn spooled_bytes(&self) -> u64 {
        self.sizes.iter().map(|size| size + 2 * MARGIN_BYTES).sum()
    }

    pub(super) fn copy_into(&mut self, out: &mut impl Write) -> std::io::Result<()> {
        let spooled_bytes = self.spooled_bytes();
        // What is buffered is written first.
        self.spool.seek(SeekFrom::Start(0))?;
        let mut reader = BufReader::with_capacity(1 << 20, self.spool.get_mut()).take(spooled_bytes);
        let copied = std::io::copy(&mut reader, out)?;
        if copied == spooled_bytes {
            Ok(())
        } else {
            Err(std::io::Error::other("the spooled tiles were changed"))
        }
    }
}
