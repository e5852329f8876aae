//! A decoded picture, and what every codec says when it cannot.

use crate::{Error, Raster};
use selenograph_files::regular;
use std::path::Path;

/// A decoded picture in the sample type of its file.
#[derive(Debug, Clone, PartialEq)]
pub enum Picture {
    /// 8-bit grey.
    Grey8(Raster<u8>),
    /// 16-bit grey.
    Grey16(Raster<u16>),
    /// 8-bit colour.
    Rgb8(Raster<[u8; 3]>),
}

impl Picture {
    /// Width and height, pixels.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Grey8(r) => (r.width, r.height),
            Self::Grey16(r) => (r.width, r.height),
            Self::Rgb8(r) => (r.width, r.height),
        }
    }

    /// Grey levels as fractions of white in `[0, 1]`; colours by the luma of ITU-R BT.601.
    pub fn to_unit_grey(&self) -> Raster<f32> {
        let (width, height) = self.size();
        let data = match self {
            Self::Grey8(r) => r.data.iter().map(|&v| f32::from(v) / 255.0).collect(),
            Self::Grey16(r) => r.data.iter().map(|&v| f32::from(v) / 65_535.0).collect(),
            Self::Rgb8(r) => r
                .data
                .iter()
                .map(|&[red, green, blue]| {
                    (0.299 * f32::from(red) + 0.587 * f32::from(green) + 0.114 * f32::from(blue)) / 255.0
                })
                .collect(),
        };
        Raster { width, height, data }
    }
}

/// Longer files are none of pictures and arrays that are read here: twice an uncompressed f64 of the largest picture.
const MAX_FILE_BYTES: u64 = 4 << 30;

/// The bytes of a file, with its path in the error.
pub(super) fn bytes_of(path: &Path) -> Result<Vec<u8>, Error> {
    regular::read(path, MAX_FILE_BYTES).map_err(Error::io("read", path))
}

/// A file that is not what its format says.
pub(super) fn malformed(format: &'static str, origin: &Path, what: impl ToString) -> Error {
    Error::Malformed {
        path: origin.to_owned(),
        what: format.to_owned(),
        expected: "a whole and well-formed file".to_owned(),
        found: what.to_string(),
    }
}

/// A picture or array that a format cannot hold.
pub(super) fn cannot_encode(format: &'static str, what: impl ToString) -> Error {
    Error::Encode { format, what: what.to_string() }
}
