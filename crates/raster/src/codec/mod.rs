//! Pictures and arrays in files: each format encodes to bytes and decodes from bytes.
//!
//! Writing bytes to a file, whole or not at all, is the caller's job; `read` is only a convenience that names the
//! file in its errors.

pub mod exr;
pub mod jpeg;
pub mod npz;
pub mod pgm;
pub mod picture;
pub mod png;

use crate::{Error, Raster};
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

/// The bytes of a file, with its path in the error.
fn bytes_of(path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(Error::io("read", path))
}

/// A file that is not what its format says.
fn malformed(format: &'static str, origin: &Path, what: impl ToString) -> Error {
    Error::Malformed {
        path: origin.to_owned(),
        what: format.to_owned(),
        expected: "a whole and well-formed file".to_owned(),
        found: what.to_string(),
    }
}

/// A picture or array that a format cannot hold.
fn cannot_encode(format: &'static str, what: impl ToString) -> Error {
    Error::Encode { format, what: what.to_string() }
}
