//! The pictures and the model's pictures, both on the ground's cells.

use super::globals::Globals;
use super::linearise::{Surface, see};
use super::run::Problem;
use rayon::prelude::*;
use selenograph_raster::Raster;

/// A picture and what the model makes of it, cell by cell, in the picture's lit mean; NaN where the picture tells nothing.
#[derive(Debug, Clone)]
pub struct Compared {
    /// The picture.
    pub picture: Raster<f32>,
    /// The model's.
    pub model: Raster<f32>,
}

impl Compared {
    /// Picture less model.
    pub fn residual(&self) -> Raster<f32> {
        let data = self.picture.data.iter().zip(&self.model.data).map(|(p, m)| p - m).collect();
        Raster { width: self.picture.width, height: self.picture.height, data }
    }

    /// Correlation of the two over the cells that enough pictures show; NaN where there are none.
    pub(super) fn correlation(&self, num_seen: &Raster<u8>, enough: usize) -> f64 {
        let mut sums = [0.0f64; 6];
        for ((picture, model), seen) in self.picture.data.iter().zip(&self.model.data).zip(&num_seen.data) {
            if picture.is_finite() && model.is_finite() && usize::from(*seen) >= enough {
                let [x, y] = [picture, model].map(|v| f64::from(v.clamp(-BRIGHTEST, BRIGHTEST)));
                for (sum, v) in sums.iter_mut().zip([1.0, x, y, x * x, y * y, x * y]) {
                    *sum += v;
                }
            }
        }
        let [count, x, y, xx, yy, xy] = sums;
        let [x, y, xx, yy, xy] = [x, y, xx, yy, xy].map(|sum| sum / count);
        (xy - x * y) / ((xx - x * x) * (yy - y * y)).sqrt().max(1e-30)
    }
}

/// Grey levels beyond this many lit means are not told apart: where nothing holds the surface a handful of cells may be as bright as
/// the Sun, and counts as wrong, not for all others.
const BRIGHTEST: f32 = 4.0;

impl Problem<'_> {
    /// Every picture beside its model at a level.
    pub(super) fn compared(&self, surface: &Surface, globals: &Globals, level_idx: usize) -> Vec<Compared> {
        let (width, height) = (surface.width, surface.height);
        let shown = self.shown(level_idx);
        let compared = |(shot, shown)| {
            let mut both = vec![[f32::NAN; 2]; width * height];
            both.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                for (x, out) in row.iter_mut().enumerate() {
                    let albedo = surface.albedo[y * width + x];
                    if let Some(seen) = see(&self.law, globals, shot, shown, surface.ground(x, y), albedo) {
                        let model = seen.model + shot.offset;
                        *out = [model + seen.residual, model];
                    }
                }
            });
            let raster = |k: usize| Raster { width, height, data: both.iter().map(|b| b[k]).collect() };
            Compared { picture: raster(0), model: raster(1) }
        };
        globals.shots.iter().zip(&shown).map(compared).collect()
    }
}
