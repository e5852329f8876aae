//! Which pixels are there: by an alpha band, a mask in the file, or GDAL's `.msk` beside it.

use super::directory::{Directory, TiffFile};
use super::layout::{Shape, layout, layout_of_bits, shape};
use super::rows::TiffRows;
use super::sidecar;
use super::tags::{BITS_PER_SAMPLE, EXTRA_SAMPLES};
use crate::Error;
use crate::sample::HeightLaw;
use std::path::Path;

/// One source of it: pixels where it is 0 are absent.
#[derive(Debug)]
pub(crate) struct Presence {
    rows: TiffRows,
    /// Whether a sample of `rows` holds eight pixels, the first uppermost.
    packed: bool,
    width: usize,
    /// For people: `alpha` …
    pub(crate) name: &'static str,
    /// Pixels found absent so far.
    pub(crate) num_clear: u64,
}

/// The alpha band, as an index from 0; `None` if there is none.
pub(crate) fn alpha_idx(
    tiff: &mut TiffFile,
    directory: &Directory,
    shape: &Shape,
) -> Result<Option<usize>, Error> {
    let extra = tiff.integers(directory, EXTRA_SAMPLES)?.unwrap_or_default();
    let first_extra = shape.num_bands.saturating_sub(extra.len());
    // 1: colours are multiplied by it; 2: they are not.
    Ok(extra
        .iter()
        .position(|kind| matches!(kind, 1 | 2))
        .map(|idx| first_extra + idx)
        .filter(|idx| *idx > 0))
}

/// All that is said of the pixels of a band: alpha unless it is the band itself, the mask of `mask`, the file beside.
pub(crate) fn sources(
    path: &Path,
    directory: &Directory,
    shape: &Shape,
    band_idx: usize,
    mask: Option<&Directory>,
) -> Result<Vec<Presence>, Error> {
    let mut sources = Vec::new();
    let mut tiff = TiffFile::open(path)?;
    if let Some(alpha) = alpha_idx(&mut tiff, directory, shape)?.filter(|alpha| *alpha != band_idx) {
        let layout = layout(&mut tiff, directory, shape, alpha)?;
        sources.push(Presence::new(
            TiffRows::new(tiff, layout.with_thin_strips()),
            false,
            shape.width,
            "alpha",
        ));
    }
    if let Some(mask) = mask {
        sources.push(of_mask(TiffFile::open(path)?, mask, shape, band_idx, "a mask in the file")?);
    }
    if let Some(beside) = sidecar::beside(path, ".msk") {
        let mut tiff = TiffFile::open(&beside)?;
        let mask = tiff.directory(tiff.first_directory)?;
        sources.push(of_mask(tiff, &mask, shape, band_idx, "a mask beside the file")?);
    }
    Ok(sources)
}

fn of_mask(
    mut tiff: TiffFile,
    mask: &Directory,
    image: &Shape,
    band_idx: usize,
    name: &'static str,
) -> Result<Presence, Error> {
    let own = shape(&mut tiff, mask)?;
    if (own.width, own.height) != (image.width, image.height) {
        let [wanted, found] = [image, &own].map(|s| format!("{}×{}", s.width, s.height));
        return Err(tiff.malformed("size of the mask", wanted, found));
    }
    let packed = tiff.integer(mask, BITS_PER_SAMPLE)?.unwrap_or(1) == 1;
    let layout = if packed && own.num_bands == 1 {
        layout_of_bits(&mut tiff, mask, &own)?
    } else {
        layout(&mut tiff, mask, &own, band_idx.min(own.num_bands - 1))?
    };
    Ok(Presence::new(TiffRows::new(tiff, layout.with_thin_strips()), packed, own.width, name))
}

impl Presence {
    fn new(rows: TiffRows, packed: bool, width: usize, name: &'static str) -> Self {
        Self { rows, packed, width, name, num_clear: 0 }
    }

    /// Makes absent what this source says is not there, in whole rows from row `first` on.
    pub(crate) fn apply(&mut self, first: usize, samples: &mut [f32]) -> Result<(), Error> {
        let law = HeightLaw::new(1.0, 0.0, 1.0, f64::INFINITY, &[]);
        let per_row = if self.packed { self.width.div_ceil(8) } else { self.width };
        let mut marks = vec![f32::NAN; samples.len() / self.width * per_row];
        self.rows.read(first, &law, &mut marks)?;
        for (row, marks) in samples.chunks_exact_mut(self.width).zip(marks.chunks_exact(per_row)) {
            for (x, sample) in row.iter_mut().enumerate() {
                let there = if self.packed {
                    // A chunk that was never written is NaN, and 0 as a byte: absent.
                    (marks[x / 8] as u8) >> (7 - x % 8) & 1 == 1
                } else {
                    marks[x] != 0.0 && !marks[x].is_nan()
                };
                if !there {
                    self.num_clear += 1;
                    *sample = f32::NAN;
                }
            }
        }
        Ok(())
    }
}
