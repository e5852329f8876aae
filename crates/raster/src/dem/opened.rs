//! What opening a file of any format gives.

use super::info::DemInfo;
use super::raw::RawRows;
use crate::Error;
use crate::sample::HeightLaw;
use crate::tiff::image::TiffBand;

/// Where rows come from.
pub(super) enum RowSource {
    Tiff(Box<TiffBand>),
    Raw(RawRows),
}

/// What opening a file of any format gives.
pub(super) struct Opened {
    pub(super) info: DemInfo,
    pub(super) law: HeightLaw,
    pub(super) rows: RowSource,
}

impl RowSource {
    /// Rows `first..` into `out`, as many as it has room for.
    pub(super) fn read(&mut self, first: usize, law: &HeightLaw, out: &mut [f32]) -> Result<(), Error> {
        match self {
            Self::Tiff(band) => band.read(first, law, out),
            Self::Raw(rows) => rows.read(first, law, out),
        }
    }
}
