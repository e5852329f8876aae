//! Views on their way from a source to a network: size, window, roll, and what is done to their levels.
//!
//! Geometry comes first and moves picture, depth, camera and pose in one step; levels follow. Every draw is derived from
//! the seed and the sample's position, so that any sample can be made again.

pub mod crop;
pub mod photometric;
pub mod physical;
pub mod rescale;
mod warp;

pub use crop::{Turn, Windows};
pub use photometric::Photometric;
pub use physical::Physical;

use crate::Error;
use crate::correspondence::Sighted;
use crate::plan::Interval;
use crate::plan::interval::check_number;
use crate::rng::{Stream, rng};
use crate::sample::{TrainingView, ViewTruth};
use selenograph_geometry::{Camera, PixelConvention};
use selenograph_raster::Raster;
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

/// Which of a pair's lights its two views are taken under.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SunChoice {
    /// The first.
    First,
    /// One drawn for both.
    #[default]
    Shared,
    /// One drawn for each.
    Independent,
}

/// What is done to a pair. The default is nothing but what it takes to have the size asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub struct Augmentation {
    /// Whether geometry is the reference's.
    pub fidelity: Fidelity,
    /// Which part of the views is taken.
    pub windows: Windows,
    /// Probability that each view is rolled by any angle about its optical axis.
    pub roll_share: f64,
    /// Under which Suns.
    pub suns: SunChoice,
    /// The camera's part.
    pub physical: Option<Physical>,
    /// The published changes of levels.
    pub photometric: Option<Photometric>,
    /// Probability that B is a copy of A.
    pub monocular_share: f64,
    /// Depths above this quantile of a view's own are taken as not known (0.98 in the published training).
    pub far_quantile: Option<f64>,
}

impl Augmentation {
    /// The published training's.
    pub fn published() -> Self {
        Self {
            fidelity: Fidelity::Published,
            windows: Windows::Matched,
            photometric: Some(Photometric::default()),
            monocular_share: 0.005,
            far_quantile: Some(0.98),
            ..Self::default()
        }
    }

    /// Ours: every roll, any two of the pair's Suns, and cameras with faults.
    pub fn physical() -> Self {
        Self {
            windows: Windows::Matched,
            roll_share: 0.5,
            suns: SunChoice::Independent,
            physical: Some(Physical::default()),
            ..Self::default()
        }
    }

    /// Checks every value against its range; `key` names the section in messages.
    ///
    /// # Errors
    /// [`Error::Value`].
    pub fn check(&self, key: &str) -> Result<(), Error> {
        let share = Interval::new(0.0, 1.0);
        check_number(&format!("{key}.roll_share"), self.roll_share, share)?;
        check_number(&format!("{key}.monocular_share"), self.monocular_share, share)?;
        if let Some(quantile) = self.far_quantile {
            check_number(&format!("{key}.far_quantile"), quantile, share)?;
        }
        match &self.physical {
            Some(physical) => physical.check(&format!("{key}.physical")),
            None => Ok(()),
        }
    }

    /// The lights of the two views of a sample, of `num_lights`.
    pub fn lights(&self, num_lights: usize, seed: u64, position: u64) -> [usize; 2] {
        let mut stream = rng(seed, "sample", position, "suns");
        let [a, b] = [stream.index(num_lights), stream.index(num_lights)];
        match self.suns {
            SunChoice::First => [0, 0],
            SunChoice::Shared => [a, a],
            SunChoice::Independent => [a, b],
        }
    }

    /// Size, window, roll and copies, and whether B is a copy of A; levels stay as they are. Views that are shaped already
    /// keep size, window and roll.
    ///
    /// # Errors
    /// [`Error::Geometry`] for sizes and cameras that cannot be.
    pub fn reshape(
        &self,
        mut drafts: [Draft; 2],
        is_shaped: bool,
        target: [usize; 2],
        seed: u64,
        position: u64,
    ) -> Result<([Draft; 2], bool), Error> {
        if let Some(quantile) = self.far_quantile {
            drafts.iter_mut().for_each(|draft| draft.drop_far(quantile));
        }
        let is_copy = rng(seed, "sample", position, "monocular").unit() < self.monocular_share;
        if !is_shaped {
            let mut stream = rng(seed, "sample", position, "windows");
            let windows = match self.windows {
                Windows::Matched => crop::choose([&drafts[0], &drafts[1]], target, &mut stream).map(Some),
                Windows::Middle => [None; 2],
            };
            let shape = |draft, view: usize, purpose| {
                self.reshape_view(draft, windows[view], target, rng(seed, "sample", position, purpose))
            };
            let [a, b] = drafts;
            let a = shape(a, 0, "roll a")?;
            drafts = [a, if is_copy { b } else { shape(b, 1, "roll b")? }];
        }
        if is_copy {
            drafts[1] = drafts[0].clone();
        }
        Ok((drafts, is_copy))
    }

    fn reshape_view(
        &self,
        draft: Draft,
        window: Option<[f64; 4]>,
        target: [usize; 2],
        mut stream: Stream,
    ) -> Result<Draft, Error> {
        let roll_rad = self.roll_rad(&mut stream);
        if window.is_none() && roll_rad.is_none() {
            return rescale::middle(&rescale::cover(draft, target, self.fidelity)?, target);
        }
        let window = window.unwrap_or_else(|| draft.middle_window(target));
        let turn = Turn::onto(&draft.camera, window, target, self.fidelity)?;
        let turn = match roll_rad {
            Some(angle) => turn.rolled(&draft.camera, angle)?,
            None => turn,
        };
        Ok(turn.apply(&draft))
    }

    /// The angle that a view is rolled by, if it is.
    pub(crate) fn roll_rad(&self, stream: &mut Stream) -> Option<f64> {
        let (coin, turn) = (stream.unit(), stream.unit());
        (coin < self.roll_share).then_some(turn * std::f64::consts::TAU)
    }

    /// The levels of a finished view as a network is given them; `which` names the view's draws.
    pub fn develop(&self, draft: Draft, seed: u64, position: u64, which: &str) -> TrainingView {
        let mut levels = draft.levels;
        if let Some(physical) = &self.physical {
            levels = physical.apply(&levels, &mut rng(seed, "sample", position, &format!("camera {which}")));
        }
        // The conversion stays within a byte, and takes NaN for black.
        let mut bytes = levels.map(|level| level.round() as u8);
        if let Some(photometric) = &self.photometric {
            bytes = photometric.apply(bytes, &mut rng(seed, "sample", position, &format!("levels {which}")));
        }
        TrainingView { rgb: bytes.map(|level| [*level; 3]), camera: draft.camera, truth: draft.truth }
    }
}

/// A view on its way.
#[derive(Debug, Clone, PartialEq)]
pub struct Draft {
    /// Grey levels, 255 at full scale; not yet whole, and above full scale where a picture clips.
    pub levels: Raster<f32>,
    /// The camera of these pixels, without lens distortion.
    pub camera: Camera,
    /// Depth and pose, where they are known.
    pub truth: Option<ViewTruth>,
}

impl Draft {
    /// Camera and truth, where there is one.
    pub fn sighted(&self) -> Option<Sighted<'_>> {
        self.truth.as_ref().map(|truth| Sighted { camera: &self.camera, truth })
    }

    /// Takes depths above a quantile of them as not known.
    fn drop_far(&mut self, quantile: f64) {
        let Some(truth) = &mut self.truth else { return };
        let depths = truth.depth_z.data.iter().map(|z| f64::from(*z));
        if let Some([far]) = selenograph_raster::statistics::quantiles(depths, [quantile]) {
            for z in truth.depth_z.data.iter_mut().filter(|z| z.is_finite() && f64::from(**z) > far) {
                *z = f32::NAN;
            }
        }
    }

    /// The largest window of a target's proportions, in the middle.
    fn middle_window(&self, target: [usize; 2]) -> [f64; 4] {
        let (width, height) = (self.camera.width as f64, self.camera.height as f64);
        let fit = (width / target[0] as f64).min(height / target[1] as f64);
        let [w, h] = target.map(|side| side as f64 * fit);
        let (left, top) = ((width - w) / 2.0, (height - h) / 2.0);
        [left, top, left + w, top + h]
    }
}

#[cfg(test)]
mod tests;
