//! A picture at every size, and where the ground's cells lie in it.

use super::Picture;
use super::patch::Patch;
use crate::field::filter;
use crate::stereo::level::LevelCamera;
use selenograph_raster::Raster;

/// A picture at one size.
#[derive(Debug)]
pub(super) struct PictureLevel {
    pub(super) width: usize,
    pub(super) height: usize,
    /// B-spline coefficients of the grey levels.
    spline: Raster<f32>,
    /// 1 where the picture tells how the ground is lit, else 0.
    mask: Raster<f32>,
    pub(super) camera: LevelCamera,
}

/// A picture in all its sizes, the finest first.
#[derive(Debug)]
pub(super) struct PicturePyramid {
    pub(super) levels: Vec<PictureLevel>,
    /// Mean grey level of what is lit: the unit of residuals.
    pub(super) mean: f32,
    /// Share of the pixels that are lit, neither dark nor saturated.
    pub(super) lit_share: f32,
}

/// Grey levels below this share of the lit mean are shadow.
const DARK: f32 = 0.03;
/// As many pixels at the very highest grey level are saturated and not a peak.
const SATURATED_PIXELS: usize = 24;
/// Share of a coarser pixel that must be told by the finer ones.
const LEAST_SHARE: f32 = 0.7;

impl PicturePyramid {
    pub(super) fn new(picture: &Picture<'_>, num_levels: usize) -> Self {
        let image = &picture.view.image;
        let there: Vec<f32> = image.data.iter().copied().filter(|v| v.is_finite()).collect();
        let mean_of = |least: f32| {
            let lit = there.iter().filter(|v| **v > least);
            let (sum, count) = lit.fold((0.0, 0usize), |(s, n), v| (s + f64::from(*v), n + 1));
            (sum / count.max(1) as f64) as f32
        };
        let overall = mean_of(f32::NEG_INFINITY);
        let mean = mean_of(DARK * overall);
        let top = there.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let saturated = there.iter().filter(|v| **v == top).count() >= SATURATED_PIXELS;
        let told = |v: &f32| v.is_finite() && *v > DARK * mean && !(saturated && *v >= top);
        let mut mask = eroded(&image.map(|v| if told(v) { 1.0f32 } else { 0.0 }));
        let lit_share = filter_share(&mask);
        let mut image = image.map(|&v| if v.is_finite() { v } else { mean });
        let mut levels = Vec::with_capacity(num_levels);
        for level_idx in 0..num_levels {
            if level_idx > 0 {
                image = halve(&image);
                mask = halve(&mask);
            }
            let least = if level_idx == 0 { 0.99 } else { LEAST_SHARE };
            levels.push(PictureLevel {
                width: image.width,
                height: image.height,
                spline: filter::spline_coefficients(&image),
                mask: mask.map(|&share| if share > least { 1.0 } else { 0.0 }),
                camera: LevelCamera::new(&picture.view.camera, level_idx),
            });
            if image.width.min(image.height) < 8 {
                break;
            }
        }
        Self { levels, mean, lit_share }
    }
}

fn filter_share(mask: &Raster<f32>) -> f32 {
    crate::field::conjugate::mean_of(&mask.data)
}

/// Without the pixels beside one that tells nothing: penumbra and the optics' blur reach there.
fn eroded(mask: &Raster<f32>) -> Raster<f32> {
    let near = |i: usize, count: usize| i.saturating_sub(1)..(i + 2).min(count);
    Raster::from_fn(mask.width, mask.height, |x, y| {
        let all = near(y, mask.height).all(|j| near(x, mask.width).all(|i| mask[(i, j)] > 0.0));
        if all { 1.0 } else { 0.0 }
    })
}

/// Half the size by means of two by two; an odd last row or column is cut. The spline between samples then shows what a central
/// difference of the surface on the same grid explains.
fn halve(image: &Raster<f32>) -> Raster<f32> {
    Raster::from_fn(image.width / 2, image.height / 2, |x, y| {
        let (upper, lower) = (&image.row(2 * y)[2 * x..2 * x + 2], &image.row(2 * y + 1)[2 * x..2 * x + 2]);
        0.25 * (upper[0] + upper[1] + lower[0] + lower[1])
    })
}

/// What a picture shows of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Grey level.
    pub(super) grey: f32,
    /// Its derivatives by `x/z` and `y/z` in the camera.
    pub(super) by_ray: [f32; 2],
    /// The cell in the camera's axes, in cells.
    pub(super) at: [f32; 3],
}

impl PictureLevel {
    /// The grey level where a point of the camera's axes is seen; `None` outside the picture, behind it, or where it tells nothing.
    #[inline]
    pub(super) fn sample(&self, at: [f32; 3]) -> Option<Sample> {
        if at[2] <= 1e-6 || at[2].is_nan() {
            return None;
        }
        let inverse = 1.0 / at[2];
        let pixel = self.camera.pixel(at[0] * inverse, at[1] * inverse);
        let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
        if !(x >= 0.0 && y >= 0.0 && x <= (self.width - 1) as f32 && y <= (self.height - 1) as f32) {
            return None;
        }
        let (ix, iy) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let around = iy * self.width + ix;
        let (upper, lower) = (
            &self.mask.data[around..around + 2],
            &self.mask.data[around + self.width..around + self.width + 2],
        );
        if upper[0] * upper[1] * lower[0] * lower[1] == 0.0 {
            return None;
        }
        let (grey, gx, gy) = filter::spline_at(&self.spline, x, y);
        let [[xx, xy], [yx, yy]] = pixel.by_ray;
        Some(Sample { grey, by_ray: [gx * xx + gy * yx, gx * xy + gy * yy], at })
    }
}

/// Where the grid lies in a camera: `x_in_cam = rotation · (column, row, height) + translation`, in cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) rotation: [[f32; 3]; 3],
    pub(super) translation: [f32; 3],
    /// The camera's place over the grid, in cells.
    pub(super) eye: [f32; 3],
    /// Towards the Sun, along the grid's axes.
    pub(super) sun: [f32; 3],
}

impl Placed {
    pub(super) fn new(picture: &Picture<'_>, patch: &Patch) -> Self {
        let pose = &picture.cam_from_scene;
        let columns = patch.axes.map(|axis| pose.vector(&axis));
        let corner = pose.point(&patch.corner.into()).coords / patch.cell;
        let eye = patch.position(&pose.inverse().origin().coords);
        Self {
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i] as f32)),
            translation: std::array::from_fn(|i| corner[i] as f32),
            eye: eye.map(|c| c as f32),
            sun: patch.direction(&picture.sun).map(|c| c as f32),
        }
    }

    /// A position over the grid in the camera's axes.
    #[inline]
    pub(super) fn in_cam(&self, p: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| {
            let r = &self.rotation[i];
            r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + self.translation[i]
        })
    }
}
