//! Pictures as bytes of a format that browsers read.

use crate::{Error, base64};
use selenograph_raster::Raster;
use selenograph_raster::codec::{jpeg, png};

/// Good enough that no eye sees the difference, a third of the size of PNG.
const PHOTO_QUALITY: u8 = 90;

/// An encoded picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    mime: &'static str,
    bytes: Vec<u8>,
}

impl Picture {
    /// Without loss: for maps and drawings.
    ///
    /// # Errors
    /// [`Error::Picture`] for an empty raster.
    pub fn exact(raster: &Raster<[u8; 3]>) -> Result<Self, Error> {
        let bytes = png::encode_rgb8(raster)?;
        Ok(Self { width: raster.width, height: raster.height, mime: "image/png", bytes })
    }

    /// As JPEG: for photographs.
    ///
    /// # Errors
    /// [`Error::Picture`] for an empty raster, or one with a side above 65 535.
    pub fn photo(raster: &Raster<[u8; 3]>) -> Result<Self, Error> {
        let bytes = jpeg::encode_rgb8(raster, PHOTO_QUALITY)?;
        Ok(Self { width: raster.width, height: raster.height, mime: "image/jpeg", bytes })
    }

    /// The address of the picture that holds the picture itself.
    pub(crate) fn data_uri(&self) -> String {
        format!("data:{};base64,{}", self.mime, base64::encode(&self.bytes))
    }
}
