//! What reading a picture gives, and how samples become grey levels.

use crate::sample::SampleType;
use crate::{Error, Raster};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Larger pictures are refused before memory is taken for them: a whole NAC strip has 264 million pixels.
pub(super) const MAX_PIXELS: u64 = 1 << 28;

/// The kinds of pictures read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PictureFormat {
    /// Portable network graphics.
    Png,
    /// JPEG.
    Jpeg,
    /// TIFF, GeoTIFF, BigTIFF.
    Tiff,
    /// Portable grey map.
    Pgm,
    /// Planetary Data System, version 3.
    Pds3,
    /// Planetary Data System, version 4.
    Pds4,
    /// A cube of ISIS 3.
    Isis,
}

impl PictureFormat {
    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tiff => "TIFF",
            Self::Pgm => "PGM",
            Self::Pds3 => "PDS3",
            Self::Pds4 => "PDS4",
            Self::Isis => "ISIS cube",
        }
    }
}

/// What a grey level of 1 means.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GreyUnit {
    /// White: levels are stored numbers divided by this one.
    White(f64),
    /// One unit of the file (radiance, I/F …): levels are as the file has them, with its own factor and summand applied.
    AsStored,
}

/// A picture read from a file, and what the file said.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PictureFile {
    /// The file that was opened.
    pub path: PathBuf,
    /// The file with the samples: another one where a label is detached.
    pub data_path: PathBuf,
    /// Its format.
    pub format: PictureFormat,
    /// Grey levels; NaN where the file says nothing.
    #[serde(skip)]
    pub grey: Raster<f32>,
    /// What a level of 1 means.
    pub unit: GreyUnit,
    /// Bits of a stored sample (of one channel).
    pub bits: u32,
    /// Whether it was colour, made grey by the luma of ITU-R BT.601.
    pub was_colour: bool,
    /// What had to be decided while reading, in sentences.
    pub notes: Vec<String>,
}

/// Refuses sizes that would take more memory than a picture should.
pub(super) fn checked_size(path: &Path, width: u64, height: u64) -> Result<(), Error> {
    match width.checked_mul(height) {
        Some(pixels) if pixels <= MAX_PIXELS => Ok(()),
        _ => Err(Error::Unsupported {
            path: path.to_owned(),
            what: "picture size",
            found: format!("{width}×{height}"),
            supported: "up to 268 million pixels; cut a window out of it",
        }),
    }
}

/// The luma of ITU-R BT.601.
pub(super) fn luma(red: f32, green: f32, blue: f32) -> f32 {
    0.299 * red + 0.587 * green + 0.114 * blue
}

/// One band, or red, green and blue, as one grey picture; whether it was colour, and what is to be said.
pub(super) fn grey_of_bands(
    mut bands: Vec<Raster<f32>>,
    num_bands: usize,
    notes: &mut Vec<String>,
) -> (Raster<f32>, bool) {
    if let [red, green, blue] = bands.as_slice() {
        let levels = red.data.iter().zip(&green.data).zip(&blue.data);
        let data = levels.map(|((r, g), b)| luma(*r, *g, *b)).collect();
        notes.push("colour, made grey by the luma of BT.601".to_owned());
        return (Raster { width: red.width, height: red.height, data }, true);
    }
    if num_bands > 1 {
        notes.push(format!("band 1 of {num_bands} is read"));
    }
    (bands.swap_remove(0), false)
}

/// The level of white of plain integers; `None` for floats.
///
/// Integers of 32 bits hold counts of fewer bits as a rule: their white is the smallest 2ⁿ − 1 that holds the picture,
/// which is said.
pub(super) fn white_of(sample_type: SampleType, grey: &Raster<f32>, notes: &mut Vec<String>) -> Option<f64> {
    match sample_type {
        SampleType::U8 => Some(255.0),
        SampleType::I8 => Some(127.0),
        SampleType::U16 => Some(65_535.0),
        SampleType::I16 => Some(32_767.0),
        SampleType::U32 | SampleType::I32 => {
            let largest = f64::from(grey.data.iter().copied().fold(1.0, f32::max));
            let white = (1u64 << (largest.log2().floor() as u32 + 1).clamp(8, 32)) as f64 - 1.0;
            notes.push(format!("32-bit samples: white is {white}, the smallest 2ⁿ − 1 that holds them"));
            Some(white)
        }
        SampleType::F32 | SampleType::F64 => None,
    }
}

/// Divides by white where there is one.
pub(super) fn scaled_to_white(grey: &mut Raster<f32>, white: Option<f64>) -> GreyUnit {
    let Some(white) = white else { return GreyUnit::AsStored };
    // In f64: a level of white must be 1 exactly.
    grey.data.iter_mut().for_each(|level| *level = (f64::from(*level) / white) as f32);
    GreyUnit::White(white)
}
