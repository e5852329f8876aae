//! Cameras of windows and of resized images.

use crate::{Camera, Error};

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
