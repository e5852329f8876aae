//! From a pixel and its inverse depth into the other view, and the other picture brought here.

use super::level::{LevelCamera, ViewLevel};
use crate::field::filter::{self, ROWS_PER_TASK};
use rayon::prelude::*;
use selenograph_geometry::{Frame, Rigid3, pixel};
use selenograph_raster::Raster;

/// The motion from one view to the other, for points given as ray and inverse z-depth: `R ray + t ρ` is the point in the other
/// camera times `ρ`. The unit of length is the scene's typical z-depth, so that `ρ` is near 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub rotation: [[f32; 3]; 3],
    pub translation: [f32; 3],
}

/// A pixel of the other view, how far it moves for a unit of `ρ`, and the factor that turns `ρ` here into `ρ` there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Landing {
    pub x: f32,
    pub y: f32,
    pub dx: f32,
    pub dy: f32,
    /// `ρ` in the other view is `ρ` here times this.
    pub rho_factor: f32,
}

impl Motion {
    /// From a rigid motion and the unit of length.
    pub(crate) fn new<To: Frame, From: Frame>(to_from: &Rigid3<To, From>, unit: f64) -> Self {
        let (r, t) = (to_from.rotation(), to_from.origin());
        Self {
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)] as f32)),
            translation: std::array::from_fn(|i| (t[i] / unit) as f32),
        }
    }

    /// Where a ray's point with inverse z-depth `rho` is seen by `camera`; `None` behind it.
    #[inline]
    pub(crate) fn land(&self, camera: &LevelCamera, ray: [f32; 2], rho: f32) -> Option<Landing> {
        let [r0, r1, r2] = self.rotation;
        let [tx, ty, tz] = self.translation;
        let z = r2[0] * ray[0] + r2[1] * ray[1] + r2[2] + tz * rho;
        // NaN rays end here too.
        if !(z > 1e-6 && rho > 0.0) {
            return None;
        }
        let factor = 1.0 / z;
        let x = (r0[0] * ray[0] + r0[1] * ray[1] + r0[2] + tx * rho) * factor;
        let y = (r1[0] * ray[0] + r1[1] * ray[1] + r1[2] + ty * rho) * factor;
        let (dx, dy) = ((tx - x * tz) * factor, (ty - y * tz) * factor);
        let (x, y, dx, dy) = match &camera.lens {
            None => (x, y, dx, dy),
            Some(lens) => {
                // The lens model is f64 and has no public derivative: a difference along the epipolar line serves.
                const STEP: f64 = 1e-4;
                let (x, y, dx, dy) = (f64::from(x), f64::from(y), f64::from(dx), f64::from(dy));
                let (x0, y0) = lens.distort(x, y);
                let (x1, y1) = lens.distort(x + STEP * dx, y + STEP * dy);
                (x0 as f32, y0 as f32, ((x1 - x0) / STEP) as f32, ((y1 - y0) / STEP) as f32)
            }
        };
        Some(Landing {
            x: camera.fx * x + camera.cx,
            y: camera.fy * y + camera.cy,
            dx: camera.fx * dx,
            dy: camera.fy * dy,
            rho_factor: factor,
        })
    }
}

/// The other picture as seen from here, and how it changes with height.
#[derive(Debug)]
pub(crate) struct Warped {
    pub image: Raster<f32>,
    /// Derivative of `image` by the unknown (inverse depth times focal length, "pixels of height").
    pub slope: Raster<f32>,
    /// 1 where both pictures say something, else 0.
    pub mask: Raster<f32>,
}

/// Warps `there` into `here` through the inverse depths `rho`.
pub(crate) fn warp(here: &ViewLevel, there: &ViewLevel, motion: &Motion, rho: &Raster<f32>) -> Warped {
    let (width, height) = (here.width, here.height);
    let mut image = Raster::filled(width, height, 0.0f32);
    let mut slope = image.clone();
    let mut mask = image.clone();
    let rows = width * ROWS_PER_TASK;
    let (last_x, last_y) = ((there.width - 1) as f32, (there.height - 1) as f32);
    image
        .data
        .par_chunks_mut(rows)
        .zip(slope.data.par_chunks_mut(rows))
        .zip(mask.data.par_chunks_mut(rows))
        .enumerate()
        .for_each(|(task, ((image, slope), mask))| {
            let start = task * rows;
            for i in 0..image.len() {
                let at = start + i;
                if here.mask.data[at] == 0.0 {
                    continue;
                }
                let Some(landing) = motion.land(&there.camera, here.rays[at], rho.data[at]) else { continue };
                let x = landing.x - pixel::HALF_PIXEL as f32;
                let y = landing.y - pixel::HALF_PIXEL as f32;
                if !(x >= 0.0 && y >= 0.0 && x <= last_x && y <= last_y) {
                    continue;
                }
                let nearest = (y.round() as usize).min(there.height - 1) * there.width + x.round() as usize;
                if there.mask.data[nearest] == 0.0 {
                    continue;
                }
                let (value, along_x, along_y) = filter::spline_at(&there.spline, x, y);
                image[i] = value;
                slope[i] = (along_x * landing.dx + along_y * landing.dy) / here.camera.fx;
                mask[i] = 1.0;
            }
        });
    Warped { image, slope, mask }
}
