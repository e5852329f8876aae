//! Picture B as A would see it.

use super::field::Field;
use super::homography::Homography;
use rayon::prelude::*;
use selenograph_geometry::pixel::{center_of, sample_position};
use selenograph_geometry::{Point2, Vector2};
use selenograph_raster::Raster;

/// From pixels of A to pixels of B.
pub(super) struct Warp {
    pub(super) homography: Homography,
    pub(super) field: Field,
}

impl Warp {
    /// Where a point of A lies in B.
    #[inline]
    pub(super) fn point(&self, a: Point2<f64>) -> Option<Point2<f64>> {
        let displacement: Vector2<f64> = self.field.at(&a);
        Some(self.homography.point(&a)? + displacement)
    }

    /// `image` (of B) on the pixels of A; NaN outside.
    pub(super) fn apply(&self, image: &Raster<f32>, [width, height]: [usize; 2]) -> Raster<f32> {
        let mut out = Raster { width, height, data: vec![f32::NAN; width * height] };
        out.data.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, grey) in row.iter_mut().enumerate() {
                if let Some(b) = self.point(Point2::new(center_of(x), center_of(y))) {
                    *grey = cubic(image, sample_position(b.x), sample_position(b.y));
                }
            }
        });
        out
    }
}

/// Weights of four samples around a position `t` past the second: Keys' cubic with a = −1/2.
#[inline(always)]
pub(super) fn cubic_weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

/// Cubic interpolation between samples; NaN where its 4 × 4 samples leave the picture.
#[inline]
fn cubic(image: &Raster<f32>, x: f64, y: f64) -> f32 {
    let (left, top) = (x.floor(), y.floor());
    if !(left >= 1.0 && top >= 1.0 && left + 3.0 <= image.width as f64 && top + 3.0 <= image.height as f64) {
        return f32::NAN;
    }
    let (wx, wy) = (cubic_weights((x - left) as f32), cubic_weights((y - top) as f32));
    let first = (top as usize - 1) * image.width + left as usize - 1;
    let mut sum = 0.0;
    for (j, wy) in wy.into_iter().enumerate() {
        let from = first + j * image.width;
        let s = &image.data[from..from + 4];
        sum += wy * (wx[0] * s[0] + wx[1] * s[1] + wx[2] * s[2] + wx[3] * s[3]);
    }
    sum
}
