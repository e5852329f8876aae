//! One front for pictures of every format: recognised by content, grey in memory, NaN where the file says nothing.

mod compressed;
mod found;
pub(crate) mod isis;
mod raw;
mod tiff;

pub use found::{GreyUnit, PictureFile, PictureFormat};

use crate::Error;
use crate::beside::label_beside;
use crate::content::{Content, content_of};
use std::path::{Path, PathBuf};

const FORMATS: &str = "PNG, JPEG, TIFF, PGM, a PDS3 label or image, a PDS4 label or an ISIS cube";

/// Reads a picture of any format that is read here, recognised by its content; a raw image finds the label beside it.
///
/// # Shapes and units
/// Levels are fractions of white where samples are plain integers, else as the file has them ([`GreyUnit`]).
/// # Errors
/// [`Error::Io`], [`Error::UnknownFormat`], [`Error::Truncated`], [`Error::Malformed`], [`Error::MissingFile`];
/// [`Error::Unsupported`] for variants that are not read and for more than 268 million pixels; [`Error::AllNodata`]
/// if not one sample is valid.
pub fn read_picture(path: &Path) -> Result<PictureFile, Error> {
    let (described, content) = described_by(path)?;
    let described = described.as_path();
    let file = match content {
        Content::Png => compressed::read(described, PictureFormat::Png),
        Content::Jpeg => compressed::read(described, PictureFormat::Jpeg),
        Content::Pgm => compressed::read(described, PictureFormat::Pgm),
        Content::Tiff => tiff::read(described),
        Content::Pds3 => raw::read_pds3(described),
        Content::Xml => raw::read_pds4(described),
        Content::Isis => isis::read(described),
        other => {
            let (path, found) = (described.to_owned(), other.name());
            Err(Error::UnknownFormat { path, expected: FORMATS, found })
        }
    }?;
    if file.grey.data.iter().all(|level| level.is_nan()) {
        let num_samples = file.grey.data.len() as u64;
        return Err(Error::AllNodata { path: file.data_path, num_samples });
    }
    Ok(PictureFile { path: path.to_owned(), ..file })
}

/// The file that says what a picture is, the picture itself or the label beside it, and what that file holds.
pub(crate) fn described_by(path: &Path) -> Result<(PathBuf, Content), Error> {
    let content = content_of(path)?;
    let label = if content.is_raw() { label_beside(path) } else { None };
    Ok(match label {
        Some(label) => (label.clone(), content_of(&label)?),
        None => (path.to_owned(), content),
    })
}
