//! A view on its way from a source to a network, and how faithfully it is carried.

use crate::correspondence::Sighted;
use crate::sample::ViewTruth;
use selenograph_geometry::{Camera, PixelConvention};
use selenograph_raster::{Raster, statistics};
use serde::{Deserialize, Serialize};

/// Whether geometry is the reference's, or right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fidelity {
    /// As the published networks were trained: nearest depths, bytes between steps, windows half a pixel off.
    Published,
    /// Pixels, depths and cameras agree to a fraction of a pixel.
    #[default]
    Exact,
}

impl Fidelity {
    /// Where a window's principal point is measured from.
    pub(crate) fn convention(self) -> PixelConvention {
        match self {
            Self::Published => PixelConvention::Center,
            Self::Exact => PixelConvention::Corner,
        }
    }
}

/// A view before its levels are made into what a network is given ([`super::Augmentation::develop`]).
#[derive(Debug, Clone, PartialEq)]
pub struct UndevelopedView {
    /// Grey levels, 255 at full scale; not yet whole, and above full scale where a picture clips.
    pub levels: Raster<f32>,
    /// The camera of these pixels, without lens distortion.
    pub camera: Camera,
    /// Depth and pose; depth is NaN throughout where only the pose is known.
    pub truth: ViewTruth,
}

impl UndevelopedView {
    /// Camera and truth.
    pub fn sighted(&self) -> Sighted<'_> {
        Sighted { camera: &self.camera, truth: &self.truth }
    }

    /// Takes depths above a quantile of them as not known.
    pub(super) fn drop_far(&mut self, quantile: f64) {
        let depths = self.truth.depth_z.data.iter().map(|z| f64::from(*z));
        if let Some([far]) = statistics::quantiles(depths, [quantile]) {
            for z in self.truth.depth_z.data.iter_mut().filter(|z| z.is_finite() && f64::from(**z) > far) {
                *z = f32::NAN;
            }
        }
    }

    /// The largest window of a target's proportions, in the middle.
    pub(super) fn middle_window(&self, target: [usize; 2]) -> [f64; 4] {
        let (width, height) = (self.camera.width as f64, self.camera.height as f64);
        let fit = (width / target[0] as f64).min(height / target[1] as f64);
        let [w, h] = target.map(|side| side as f64 * fit);
        let (left, top) = ((width - w) / 2.0, (height - h) / 2.0);
        [left, top, left + w, top + h]
    }
}
