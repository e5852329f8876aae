//! A view at one size: picture, mask, rays and spline, ready to be warped.

use crate::View;
use crate::field::filter;
use rayon::prelude::*;
use selenograph_geometry::{Camera, Distortion, Point2, pixel};
use selenograph_raster::Raster;

/// A camera at one size, in the precision of the pixels.
#[derive(Debug, Clone)]
pub(crate) struct LevelCamera {
    pub fx: f32,
    pub fy: f32,
    pub cx: f32,
    pub cy: f32,
    /// `None` for an ideal pinhole.
    pub lens: Option<Distortion>,
}

/// A pixel and its derivatives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelOfRay {
    pub x: f32,
    pub y: f32,
    /// Rows: the derivatives of `x` and of `y` by the ray's two coordinates.
    pub by_ray: [[f32; 2]; 2],
}

impl LevelCamera {
    /// A camera whose picture was halved `level_idx` times.
    pub(crate) fn new(camera: &Camera, level_idx: usize) -> Self {
        let scale = f64::from(1u32 << level_idx);
        Self {
            fx: (camera.fx / scale) as f32,
            fy: (camera.fy / scale) as f32,
            cx: (camera.cx / scale) as f32,
            cy: (camera.cy / scale) as f32,
            lens: (!camera.distortion.is_none()).then_some(camera.distortion),
        }
    }

    /// Where a ray `x/z`, `y/z` meets the picture.
    #[inline]
    pub(crate) fn pixel(&self, x: f32, y: f32) -> PixelOfRay {
        let Some(lens) = &self.lens else {
            let (px, py) = (self.fx * x + self.cx, self.fy * y + self.cy);
            return PixelOfRay { x: px, y: py, by_ray: [[self.fx, 0.0], [0.0, self.fy]] };
        };
        // The lens model is f64 and has no public derivative: differences serve.
        const STEP: f64 = 1e-4;
        let (x, y) = (f64::from(x), f64::from(y));
        let (x0, y0) = lens.distort(x, y);
        let (x1, y1) = lens.distort(x + STEP, y);
        let (x2, y2) = lens.distort(x, y + STEP);
        let by = |f: f32, d: f64| f * (d / STEP) as f32;
        PixelOfRay {
            x: self.fx * x0 as f32 + self.cx,
            y: self.fy * y0 as f32 + self.cy,
            by_ray: [
                [by(self.fx, x1 - x0), by(self.fx, x2 - x0)],
                [by(self.fy, y1 - y0), by(self.fy, y2 - y0)],
            ],
        }
    }
}

/// One view at one size.
#[derive(Debug, Clone)]
pub(crate) struct ViewLevel {
    pub width: usize,
    pub height: usize,
    pub image: Raster<f32>,
    /// 1 where the picture says something, else 0.
    pub mask: Raster<f32>,
    pub spline: Raster<f32>,
    /// `x/z` and `y/z` of each pixel's ray; NaN outside the lens model.
    pub rays: Vec<[f32; 2]>,
    pub camera: LevelCamera,
    /// Standard deviation of the picture at full size: the unit of its contrasts.
    pub amplitude: f32,
}

/// The view at its own size and halved again and again, the finest first.
pub(crate) fn pyramid(view: &View, num_levels: usize, presmooth_px: f32) -> Vec<ViewLevel> {
    let mask = view.image.map(|v| if v.is_finite() { 1.0f32 } else { 0.0 });
    let (mean, amplitude) = statistics(&view.image);
    let image = view.image.map(|&v| if v.is_finite() { v } else { mean });
    let mut levels: Vec<ViewLevel> = Vec::with_capacity(num_levels);
    for level_idx in 0..num_levels {
        let (image, mask) = match levels.last() {
            None => (presmoothed(&image, presmooth_px), mask.clone()),
            // Each smaller picture is made from the larger one as it came, so that smoothing does not add up.
            Some(finer) => {
                let source = if level_idx == 1 { &image } else { &finer.image };
                let (mut image, mask) = filter::halve(source, &finer.mask);
                for (v, &m) in image.data.iter_mut().zip(&mask.data) {
                    if m == 0.0 {
                        *v = mean;
                    }
                }
                (image, mask)
            }
        };
        levels.push(one_level(&view.camera, image, mask, level_idx, amplitude));
    }
    levels
}

/// A Gaussian, with the rim kept by weights.
fn presmoothed(image: &Raster<f32>, sigma_px: f32) -> Raster<f32> {
    if sigma_px <= 0.0 {
        return image.clone();
    }
    let ones = Raster::filled(image.width, image.height, 1.0f32);
    let mut out = filter::gaussian(image, sigma_px);
    for (v, &w) in out.data.iter_mut().zip(&filter::gaussian(&ones, sigma_px).data) {
        *v /= w;
    }
    out
}

fn one_level(
    camera: &Camera,
    image: Raster<f32>,
    mask: Raster<f32>,
    level_idx: usize,
    amplitude: f32,
) -> ViewLevel {
    let scale = f64::from(1u32 << level_idx);
    let (width, height) = (image.width, image.height);
    let mut rays = vec![[f32::NAN; 2]; width * height];
    rays.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, ray) in row.iter_mut().enumerate() {
            let at = Point2::new(pixel::center_of(x) * scale, pixel::center_of(y) * scale);
            if let Some(direction) = camera.ray_z1(&at) {
                *ray = [direction.x as f32, direction.y as f32];
            }
        }
    });
    ViewLevel {
        width,
        height,
        spline: filter::spline_coefficients(&image),
        image,
        mask,
        rays,
        camera: LevelCamera::new(camera, level_idx),
        amplitude,
    }
}

/// Mean and standard deviation of the finite samples; (0, 0) without any.
fn statistics(image: &Raster<f32>) -> (f32, f32) {
    let (mut sum, mut square, mut count) = (0.0f64, 0.0f64, 0.0f64);
    for v in image.data.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v)) {
        sum += v;
        square += v * v;
        count += 1.0;
    }
    if count == 0.0 {
        return (0.0, 0.0);
    }
    let mean = sum / count;
    (mean as f32, (square / count - mean * mean).max(0.0).sqrt() as f32)
}
