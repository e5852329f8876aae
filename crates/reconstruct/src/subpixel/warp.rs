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

    /// `image` (of B) on every `step`-th pixel of every `step`-th row of A; NaN outside.
    pub(super) fn apply(&self, image: &Raster<f32>, size: [usize; 2], step: usize) -> Raster<f32> {
        let [width, height] = size.map(|side| side.div_ceil(step));
        let mut out = Raster { width, height, data: vec![f32::NAN; width * height] };
        let room = || (vec![0.0; size[0]], vec![0.0; size[0]]);
        out.data.par_chunks_mut(width.max(1)).enumerate().for_each_init(room, |(bx, by), (y, row)| {
            self.homography.row(center_of(step * y), bx, by);
            self.field.add_row(center_of(step * y), bx, by);
            for (grey, (x, y)) in row.iter_mut().zip(bx.iter().zip(by.iter()).step_by(step)) {
                *grey = cubic(image, sample_position(*x), sample_position(*y));
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
    if !(x >= 1.0 && y >= 1.0 && x < image.width as f64 - 2.0 && y < image.height as f64 - 2.0) {
        return f32::NAN;
    }
    // Truncation is the floor of what is positive.
    let (left, top) = (x as usize, y as usize);
    let (wx, wy) = (cubic_weights((x - left as f64) as f32), cubic_weights((y - top as f64) as f32));
    let first = (top - 1) * image.width + left - 1;
    let mut sum = 0.0;
    for (j, wy) in wy.into_iter().enumerate() {
        let from = first + j * image.width;
        let s = &image.data[from..from + 4];
        sum += wy * (wx[0] * s[0] + wx[1] * s[1] + wx[2] * s[2] + wx[3] * s[3]);
    }
    sum
}
