//! TIFF 6 and BigTIFF: directories, chunks and rows, in and out; what they mean on a map is [`crate::dem::geotiff`]'s.

pub(crate) mod bands;
pub(crate) mod chunk;
pub(crate) mod directory;
pub(crate) mod encode;
pub(crate) mod image;
pub(crate) mod layout;
pub(crate) mod nodata;
mod places;
pub(crate) mod presence;
pub(crate) mod rows;
pub(crate) mod sidecar;
pub(crate) mod tags;
