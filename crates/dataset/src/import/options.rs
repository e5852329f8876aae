//! How triplets are imported.

use crate::pair::ImportedSuns;
use selenograph_geometry::{Body, PixelConvention};

/// How to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// The body of the triplets, which do not name it.
    pub body: Body,
    /// Where their camera matrices put the first pixel's centre.
    pub k_convention: PixelConvention,
    /// Which Suns are recorded.
    pub suns: ImportedSuns,
    /// When the run began, for the record.
    pub started: Option<String>,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            body: Body::moon(),
            k_convention: PixelConvention::Corner,
            suns: ImportedSuns::Unknown,
            started: None,
        }
    }
}
