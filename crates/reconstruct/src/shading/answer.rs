//! From the ground's cells back into each view's pixels.

use super::patch::Patch;
use super::picture::Placed;
use crate::field::filter;
use rayon::prelude::*;
use selenograph_geometry::{Cam, Camera, Point2, PredA, Rigid3, pixel};
use selenograph_raster::Raster;

/// The surface as a smooth function of position.
pub(super) struct Ground<'a> {
    pub(super) patch: &'a Patch,
    heights: &'a Raster<f32>,
    spline: Raster<f32>,
    highest: f32,
    lowest: f32,
}

/// Where a ray meets the ground: a place.
pub(super) type Met = [f32; 3];

/// Steps with which a crossing is polished.
const POLISH: usize = 4;

/// Where a column and a row lie among the cells' middles; `None` outside.
pub(super) fn inside(cells: &Raster<f32>, x: f32, y: f32) -> Option<(f32, f32)> {
    let (x, y) = (x - 0.5, y - 0.5);
    let inside = x >= 0.0 && y >= 0.0 && x <= (cells.width - 1) as f32 && y <= (cells.height - 1) as f32;
    inside.then_some((x, y))
}

impl<'a> Ground<'a> {
    pub(super) fn new(patch: &'a Patch, heights: &'a Raster<f32>) -> Self {
        let (mut lowest, mut highest) = (f32::INFINITY, f32::NEG_INFINITY);
        for &h in &heights.data {
            (lowest, highest) = (lowest.min(h), highest.max(h));
        }
        Self { patch, heights, spline: filter::spline_coefficients(heights), highest, lowest }
    }

    fn height(&self, x: f32, y: f32) -> Option<f32> {
        crate::stereo::estimate::bilinear(self.heights, x - 0.5, y - 0.5)
    }

    /// Height and slopes of the smooth surface.
    fn smooth(&self, x: f32, y: f32) -> Option<(f32, f32, f32)> {
        let (x, y) = inside(&self.spline, x, y)?;
        Some(filter::spline_at(&self.spline, x, y))
    }

    /// The first ground along a ray from above, all in cells. The ray comes down in steps of a cell across.
    fn meet(&self, eye: [f32; 3], direction: [f32; 3]) -> Option<Met> {
        if direction[2] >= -1e-6 || direction[2].is_nan() {
            return None;
        }
        let margin = 1.0;
        let start = ((self.highest + margin - eye[2]) / direction[2]).max(0.0);
        let end = (self.lowest - margin - eye[2]) / direction[2];
        // The camera that the lines meet at sees every place straight: only what lies across them has to be walked.
        let place = |t: f32| self.patch.sight.place(std::array::from_fn(|i| eye[i] + t * direction[i]));
        let (first, last) = (place(start), place(end));
        let across = (last[0] - first[0]).hypot(last[1] - first[1]);
        let step = (end - start) / across.max(4.0).ceil();
        let sight = self.patch.sight;
        let at = |t: f32| sight.place(std::array::from_fn(|i| eye[i] + t * direction[i]));
        let above = |t: f32| {
            let p = at(t);
            self.height(p[0], p[1]).map(|h| p[2] - h)
        };
        let mut before: Option<(f32, f32)> = None;
        let mut t = start;
        let crossing = loop {
            if t > end + step {
                return None;
            }
            match (before, above(t)) {
                (_, None) => before = None,
                (Some((t0, gap0)), Some(gap)) if gap <= 0.0 => break t0 + (t - t0) * gap0 / (gap0 - gap),
                // The ray comes in under the ground at the grid's edge.
                (None, Some(gap)) if gap <= 0.0 => return None,
                (_, Some(gap)) => before = Some((t, gap)),
            }
            t += step;
        };
        let mut t = crossing;
        for _ in 0..POLISH {
            let p = at(t);
            let (h, by_x, by_y) = self.smooth(p[0], p[1])?;
            // How the place moves along the ray.
            let across = |x: f32, towards: f32, d: f32| {
                (d - towards * direction[2] + sight.inverse * x * direction[2]) / sight.narrowing(p[2])
            };
            let (dx, dy) = (across(p[0], sight.x, direction[0]), across(p[1], sight.y, direction[1]));
            let approach = direction[2] - by_x * dx - by_y * dy;
            // Ground that turns away from the ray has no crossing near here to polish.
            if approach > -1e-3 {
                break;
            }
            t -= ((p[2] - h) / approach).clamp(-step, step);
        }
        Some(at(t))
    }

    /// Where each pixel of a camera meets the ground, in cells; NaN where it does not.
    pub(super) fn pixels(
        &self,
        camera: &Camera,
        cam_from_scene: &Rigid3<Cam, PredA>,
        placed: &Placed,
    ) -> Raster<Met> {
        let (width, height) = (camera.width, camera.height);
        let mut out = Raster::filled(width, height, [f32::NAN; 3]);
        let scene_from_cam = cam_from_scene.inverse();
        out.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
                let Some(ray) = camera.ray_z1(&at) else { continue };
                let direction = self.patch.direction(&scene_from_cam.vector(&ray)).map(|c| c as f32);
                if let Some(met) = self.meet(placed.eye, direction) {
                    *out = met;
                }
            }
        });
        out
    }
}
