//! A picture with its camera: what every method starts from.

use selenograph_geometry::Camera;
use selenograph_raster::Raster;

/// A grey picture and the camera that took it.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Grey levels on any linear scale (fractions of white for 8 and 16 bit); NaN where the picture says nothing (no data, masked).
    pub image: Raster<f32>,
    /// The camera, measured from the corner, of the picture's size.
    pub camera: Camera,
}
