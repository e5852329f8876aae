//! Distinct points of a picture and what their surroundings look like.

pub mod blur;
pub mod intensity;
pub mod orb;
pub mod sift;
mod spread;

use selenograph_geometry::Point2;
use selenograph_geometry::pixel::PixelConvention;

/// A distinct point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Where, pixels of the picture measured from its corner.
    pub at: Point2<f64>,
    /// Standard deviation of the Gaussian at which it stands out, pixels of the picture.
    pub sigma_px: f32,
    /// Direction of its surroundings, radians in `[0, 2π)`, from the column axis to the row axis.
    pub angle_rad: f32,
    /// How much it stands out; only the order is used.
    pub response: f32,
}

/// Keypoints with a descriptor each.
#[derive(Debug, Clone, PartialEq)]
pub struct Features<D> {
    /// The points.
    pub keypoints: Vec<Keypoint>,
    /// What each looks like, in the same order.
    pub descriptors: Vec<D>,
}

impl<D> Default for Features<D> {
    fn default() -> Self {
        Self { keypoints: Vec::new(), descriptors: Vec::new() }
    }
}

/// The continuous coordinate of a position between samples (0 at the first sample's centre).
pub(crate) fn coordinate_of(position: f64) -> f64 {
    position + PixelConvention::Center.to_corner_offset()
}
