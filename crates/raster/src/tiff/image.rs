//! One band of a file with all that says which of its samples are there.

use super::directory::{Directory, TiffFile};
use super::layout::{Shape, layout, storage_text};
use super::presence::{self, Presence};
use super::rows::TiffRows;
use super::sidecar::Sidecar;
use super::tags::{GDAL_NODATA, IMAGE_WIDTH, NEW_SUBFILE_TYPE};
use super::{nodata, sidecar};
use crate::Error;
use crate::sample::{HeightLaw, SampleType};
use std::path::Path;

/// Directories looked at for overviews and masks.
const MAX_DIRECTORIES: usize = 64;

/// A band that can be read.
#[derive(Debug)]
pub(crate) struct TiffBand {
    rows: TiffRows,
    pub(crate) presence: Vec<Presence>,
    pub(crate) sample_type: SampleType,
    /// Stored numbers that mean "absent".
    pub(crate) nodata: Vec<f64>,
    /// What stands in GDAL's `.aux.xml`.
    pub(crate) sidecar: Option<Sidecar>,
    pub(crate) num_overviews: usize,
    /// How it is stored, for people.
    pub(crate) storage: String,
    pub(crate) notes: Vec<String>,
}

impl TiffBand {
    /// The band of an index from 0; `given_nodata` in place of what the file says.
    pub(crate) fn open(
        path: &Path,
        directory: &Directory,
        shape: &Shape,
        band_idx: usize,
        given_nodata: Option<f64>,
    ) -> Result<Self, Error> {
        let mut tiff = TiffFile::open(path)?;
        let layout = layout(&mut tiff, directory, shape, band_idx)?;
        let (num_overviews, mask) = companions(&mut tiff, directory, shape);
        let sidecar = sidecar::read(path, band_idx)?;
        let mut notes = Vec::new();
        let nodata = match given_nodata {
            Some(value) => vec![value],
            None => nodata_of(&mut tiff, directory, sidecar.as_ref(), &mut notes)?,
        };
        let presence = presence::sources(path, directory, shape, band_idx, mask.as_ref())?;
        let sparse = layout.spans.iter().filter(|span| span.len == 0).count();
        if sparse > 0 {
            let all = layout.spans.len();
            notes.push(format!("{sparse} of {all} strips or tiles were never written: absent"));
        }
        let storage = storage_text(&layout, shape);
        let sample_type = layout.sample_type;
        let rows = TiffRows::new(tiff, layout.with_thin_strips());
        Ok(Self { rows, presence, sample_type, nodata, sidecar, num_overviews, storage, notes })
    }

    /// Drops what is decoded: for another law.
    pub(crate) fn forget(&mut self) {
        self.rows.forget();
    }

    /// Rows `first..` into `out`, as many as it has room for.
    pub(crate) fn read(&mut self, first: usize, law: &HeightLaw, out: &mut [f32]) -> Result<(), Error> {
        self.rows.read(first, law, out)?;
        self.presence.iter_mut().try_for_each(|presence| presence.apply(first, out))
    }
}

/// The number of reduced images behind the first, and the mask of its size.
fn companions(tiff: &mut TiffFile, first: &Directory, shape: &Shape) -> (usize, Option<Directory>) {
    let (mut count, mut mask, mut next) = (0, None, first.next);
    for _ in 0..MAX_DIRECTORIES {
        // A damaged directory behind the image does not touch the image.
        let Ok(directory) = (if next == 0 { break } else { tiff.directory(next) }) else { break };
        next = directory.next;
        let mut number = |tag: u16| tiff.integer(&directory, tag).ok().flatten();
        let kind = number(NEW_SUBFILE_TYPE).unwrap_or(0);
        let width = number(IMAGE_WIDTH);
        count += usize::from(kind & 1 != 0 && kind & 4 == 0);
        if kind & 4 != 0 && width == Some(shape.width as u64) {
            mask.get_or_insert(directory);
        }
    }
    (count, mask)
}

/// The numbers of GDAL's no-data tag, or of the file beside, which GDAL believes first.
fn nodata_of(
    tiff: &mut TiffFile,
    directory: &Directory,
    sidecar: Option<&Sidecar>,
    notes: &mut Vec<String>,
) -> Result<Vec<f64>, Error> {
    let (path, text) = match sidecar {
        Some(Sidecar { path, nodata: Some(text), .. }) => {
            notes.push(format!("the no-data number {text} is that of `{}`", path.display()));
            (path.clone(), Some(text.clone()))
        }
        _ => (tiff.path.clone(), tiff.text(directory, GDAL_NODATA)?),
    };
    let Some(text) = text else { return Ok(Vec::new()) };
    nodata::numbers(&text).ok_or_else(|| Error::Unsupported {
        path,
        what: "no-data text",
        found: text.trim().to_owned(),
        supported: "a number, nan or none",
    })
}
