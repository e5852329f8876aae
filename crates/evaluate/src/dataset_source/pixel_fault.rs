//! Principal points that are half a pixel off, and their cure.

use selenograph_dataset::check::numbers::moved;
use selenograph_geometry::{Camera, pixel};

/// Where the principal points are measured from, and what is done about it.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelFault {
    /// Half pixels that are added to every principal point after reading: −1, 0 or 1.
    pub shift_half_pixels: i32,
    /// What has to be told, if anything.
    pub told: Option<String>,
}

impl PixelFault {
    /// The camera as it should have been told.
    pub fn mended(&self, camera: &Camera) -> Camera {
        let shift = f64::from(self.shift_half_pixels) * pixel::HALF_PIXEL;
        moved(camera, shift, shift)
    }
}
