//! Where the first pixel's centre is: the only place in the project that knows about half a pixel.
//!
//! Inside, continuous pixel coordinates put the centre of the first pixel at (0.5, 0.5), as COLMAP and GDAL have it;
//! the image covers `[0, width] × [0, height]` and resizing is a pure scale.

use crate::{Camera, Error};
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

/// The camera of a window cut out of an image.
///
/// # Errors
/// [`Error::Camera`] if the window is empty or leaves the image.
pub fn crop(camera: &Camera, left: usize, top: usize, width: usize, height: usize) -> Result<Camera, Error> {
    if width == 0 || height == 0 || left + width > camera.width || top + height > camera.height {
        return Err(Error::Camera {
            what: "a crop window inside the image",
            found: format!("{width}×{height} at ({left}, {top}) of {}×{}", camera.width, camera.height),
        });
    }
    Ok(Camera { width, height, cx: camera.cx - left as f64, cy: camera.cy - top as f64, ..camera.clone() })
}

/// The camera of an image resized to `width × height`.
///
/// # Errors
/// [`Error::Camera`] if a side is zero.
pub fn resize(camera: &Camera, width: usize, height: usize) -> Result<Camera, Error> {
    if width == 0 || height == 0 {
        return Err(Error::Camera { what: "a size of at least 1×1", found: format!("{width}×{height}") });
    }
    let sx = width as f64 / camera.width as f64;
    let sy = height as f64 / camera.height as f64;
    Ok(Camera {
        width,
        height,
        fx: camera.fx * sx,
        cx: camera.cx * sx,
        fy: camera.fy * sy,
        cy: camera.cy * sy,
        ..camera.clone()
    })
}
