//! What is true of a view that is learned from.

use selenograph_geometry::{BodyFixed, Cam, Camera, Point2, Rigid3, pixel};
use selenograph_raster::Raster;

/// Neighbouring pixels whose depths differ by more than this many pixels' ground are not of one surface.
const JUMP_GSDS: f64 = 20.0;

/// What is true of a view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewTruth {
    /// Distance along the optical axis, metres: NaN where it is not known, +∞ where the pixel sees sky.
    pub depth_z: Raster<f32>,
    /// The pose, metres.
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
}

impl ViewTruth {
    /// Whether any pixel sees ground at a known distance.
    pub fn has_depth(&self) -> bool {
        (0..self.depth_z.data.len()).any(|idx| self.is_valid(idx))
    }

    /// Whether a pixel sees ground at a known distance.
    pub fn is_valid(&self, idx: usize) -> bool {
        let depth_z = self.depth_z.data[idx];
        depth_z > 0.0 && depth_z.is_finite()
    }

    /// Whether a pixel sees sky.
    pub fn is_sky(&self, idx: usize) -> bool {
        self.depth_z.data[idx] == f32::INFINITY
    }

    /// Depth at a place of the picture, metres: within one surface inverse depths are interpolated (they are linear across a
    /// plane), at its rim the pixel's own is taken. `None` outside the picture and where that pixel has none.
    pub fn depth_z_at(&self, camera: &Camera, at: &Point2<f64>) -> Option<f64> {
        let column = usize::try_from(pixel::index_of(at.x)).ok()?;
        let row = usize::try_from(pixel::index_of(at.y)).ok()?;
        let own =
            self.depth_z.get(column, row).map(|z| f64::from(*z)).filter(|z| *z > 0.0 && z.is_finite())?;
        Some(self.between(camera, at).unwrap_or(own))
    }

    /// Depth between the four pixels round a place; `None` beside absent pixels and jumps.
    fn between(&self, camera: &Camera, at: &Point2<f64>) -> Option<f64> {
        let split = |value: f64, side: usize| {
            // The outer half of a border pixel goes on as its inner half began.
            let position = pixel::sample_position(value);
            let first = (position.max(0.0) as usize).min(side.saturating_sub(2));
            (first, position - first as f64)
        };
        let ((x, tx), (y, ty)) = (split(at.x, self.depth_z.width), split(at.y, self.depth_z.height));
        let z = |dx: usize, dy: usize| self.depth_z.get(x + dx, y + dy).map(|z| f64::from(*z));
        let corners = [z(0, 0)?, z(1, 0)?, z(0, 1)?, z(1, 1)?];
        if corners.iter().any(|z| !(*z > 0.0 && z.is_finite())) {
            return None;
        }
        let (near, far) = corners.iter().fold((f64::INFINITY, 0.0f64), |(a, b), z| (a.min(*z), b.max(*z)));
        if far - near > JUMP_GSDS * camera.gsd_m(near) {
            return None;
        }
        let weights = [(1.0 - tx) * (1.0 - ty), tx * (1.0 - ty), (1.0 - tx) * ty, tx * ty];
        Some(1.0 / corners.iter().zip(weights).map(|(z, weight)| weight / z).sum::<f64>())
    }
}
