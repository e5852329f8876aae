//! One front for pictures of every format: recognised by content, grey in memory, NaN where the file says nothing.

mod compressed;
mod isis;
mod raw;
mod tiff;

use crate::dem::label_beside;
use crate::dem::sample::SampleType;
use crate::{Error, Raster};
use serde::Serialize;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes that tell the format of a file.
const SNIFF_BYTES: u64 = 4096;

/// Larger pictures are refused before memory is taken for them: a whole NAC strip has 264 million pixels.
const MAX_PIXELS: u64 = 1 << 28;

const FORMATS: &str = "PNG, JPEG, TIFF, PGM, a PDS3 label or image, a PDS4 label or an ISIS cube";

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

/// Reads a picture of any format that is read here, recognised by its content; a raw image finds the label beside it.
///
/// # Shapes and units
/// Levels are fractions of white where samples are plain integers, else as the file has them ([`GreyUnit`]).
/// # Errors
/// [`Error::Io`], [`Error::UnknownFormat`], [`Error::Truncated`], [`Error::Malformed`], [`Error::MissingFile`];
/// [`Error::Unsupported`] for variants that are not read and for more than 268 million pixels; [`Error::AllNodata`]
/// if not one sample is valid.
pub fn read_picture(path: &Path) -> Result<PictureFile, Error> {
    let file = match sniff(path)? {
        Content::Bytes(format) => compressed::read(path, format),
        Content::Tiff => tiff::read(path),
        Content::Pds3 => raw::read_pds3(path),
        Content::Xml => raw::read_pds4(path),
        Content::Isis => isis::read(path),
        Content::Other(found) => match label_beside(path) {
            Some(label) => match sniff(&label)? {
                Content::Xml => raw::read_pds4(&label),
                Content::Isis => isis::read(&label),
                _ => raw::read_pds3(&label),
            },
            None => Err(Error::UnknownFormat { path: path.to_owned(), expected: FORMATS, found }),
        },
    }?;
    if file.grey.data.iter().all(|level| level.is_nan()) {
        let num_samples = file.grey.data.len() as u64;
        return Err(Error::AllNodata { path: file.data_path, num_samples });
    }
    Ok(PictureFile { path: path.to_owned(), ..file })
}

/// What a file looks like from its first bytes.
enum Content {
    /// Decoded from its bytes as a whole.
    Bytes(PictureFormat),
    Tiff,
    Pds3,
    Xml,
    Isis,
    Other(String),
}

fn sniff(path: &Path) -> Result<Content, Error> {
    let mut head = Vec::new();
    let file = File::open(path).map_err(Error::io("open", path))?;
    file.take(SNIFF_BYTES).read_to_end(&mut head).map_err(Error::io("read", path))?;
    let other = |what: &str| Content::Other(what.to_owned());
    Ok(match head.as_slice() {
        [] => other("an empty file"),
        [0x89, b'P', b'N', b'G', ..] => Content::Bytes(PictureFormat::Png),
        [0xFF, 0xD8, 0xFF, ..] => Content::Bytes(PictureFormat::Jpeg),
        [b'P', b'2' | b'5', blank, ..] if blank.is_ascii_whitespace() => Content::Bytes(PictureFormat::Pgm),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Content::Tiff,
        [b'P', b'1' | b'4', blank, ..] if blank.is_ascii_whitespace() => other("a PBM picture"),
        [b'P', b'3' | b'6', blank, ..] if blank.is_ascii_whitespace() => other("a PPM picture"),
        [b'G', b'I', b'F', b'8', ..] => other("a GIF picture"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => other("a WebP picture"),
        [0, 0, 0, 12, b'j', b'P', ..] => other("a JPEG 2000 picture"),
        [0x76, 0x2F, 0x31, 0x01, ..] => other("an OpenEXR picture"),
        [0x89, b'H', b'D', b'F', ..] => other("an HDF5 file"),
        [b'%', b'P', b'D', b'F', ..] => other("a PDF document"),
        _ => sniff_text(&head),
    })
}

fn sniff_text(head: &[u8]) -> Content {
    let text = String::from_utf8_lossy(head);
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with('<') {
        Content::Xml
    } else if isis::is_label(start) {
        Content::Isis
    } else if text.contains("PDS_VERSION_ID") {
        Content::Pds3
    } else if start.starts_with("LBLSIZE=") {
        Content::Other("a VICAR picture".to_owned())
    } else if start.starts_with("SIMPLE  =") {
        Content::Other("a FITS file".to_owned())
    } else {
        let bytes: Vec<String> = head.iter().take(4).map(|b| format!("{b:02x}")).collect();
        Content::Other(format!("bytes {}", bytes.join(" ")))
    }
}

/// Refuses sizes that would take more memory than a picture should.
fn checked_size(path: &Path, width: u64, height: u64) -> Result<(), Error> {
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
fn luma(red: f32, green: f32, blue: f32) -> f32 {
    0.299 * red + 0.587 * green + 0.114 * blue
}

/// One band, or red, green and blue, as one grey picture; whether it was colour, and what is to be said.
fn grey_of_bands(
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
fn white_of(sample_type: SampleType) -> Option<f64> {
    match sample_type {
        SampleType::U8 => Some(255.0),
        SampleType::I8 => Some(127.0),
        SampleType::U16 => Some(65_535.0),
        SampleType::I16 => Some(32_767.0),
        SampleType::U32 => Some(f64::from(u32::MAX)),
        SampleType::I32 => Some(f64::from(i32::MAX)),
        SampleType::F32 | SampleType::F64 => None,
    }
}

/// Divides by white where there is one.
fn scaled_to_white(grey: &mut Raster<f32>, white: Option<f64>) -> GreyUnit {
    let Some(white) = white else { return GreyUnit::AsStored };
    // In f64: a level of white must be 1 exactly.
    grey.data.iter_mut().for_each(|level| *level = (f64::from(*level) / white) as f32);
    GreyUnit::White(white)
}
