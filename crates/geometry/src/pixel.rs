//! Where the first pixel's centre is: the only place in the project that knows about half a pixel.
//!
//! Inside, continuous pixel coordinates put the centre of the first pixel at (0.5, 0.5), as COLMAP and GDAL have it;
//! the image covers `[0, width] × [0, height]` and resizing is a pure scale.

mod window;

pub use window::{crop, resize};

use serde::{Deserialize, Serialize};

/// Distance from a pixel's corner to its centre.
pub const HALF_PIXEL: f64 = 0.5;

/// Where a file or library puts the centre of the first pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelConvention {
    /// (0.5, 0.5): ours, COLMAP, GDAL, SurRender. Coordinates are measured from the image's corner.
    Corner,
    /// (0, 0): OpenCV, DUSt3R, MASt3R. Coordinates are measured from the first pixel's centre.
    Center,
}

impl PixelConvention {
    /// What to add to a coordinate of this convention to have it measured from the corner.
    pub fn to_corner_offset(self) -> f64 {
        match self {
            Self::Corner => 0.0,
            Self::Center => HALF_PIXEL,
        }
    }
}

/// Continuous coordinate of the centre of pixel number `index`.
pub fn center_of(index: usize) -> f64 {
    index as f64 + HALF_PIXEL
}

/// Number of the pixel that holds a continuous coordinate (may lie outside the image).
pub fn index_of(coordinate: f64) -> i64 {
    coordinate.floor() as i64
}

/// Position of a continuous coordinate between pixel centres: 0 at the first centre, 1 at the second.
pub fn sample_position(coordinate: f64) -> f64 {
    coordinate - HALF_PIXEL
}
