//! Views on their way from a source to a network: size, window, roll, and what is done to their levels.
//!
//! Geometry comes first and moves picture, depth, camera and pose in one step; levels follow. Every draw is derived from
//! the seed and the sample's position, so that any sample can be made again.

mod crop;
mod photometric;
mod physical;
pub mod rescale;
mod view;
mod warp;

pub use crop::{Turn, Windows};
pub use photometric::Photometric;
pub use physical::Physical;
pub use view::{Fidelity, UndevelopedView};

use crate::Error;
use crate::plan::Interval;
use crate::plan::interval::check_number;
use crate::rng::{Stream, rng};
use crate::sample::TrainingView;
use serde::{Deserialize, Serialize};

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
        mut views: [UndevelopedView; 2],
        is_shaped: bool,
        target: [usize; 2],
        seed: u64,
        position: u64,
    ) -> Result<([UndevelopedView; 2], bool), Error> {
        if let Some(quantile) = self.far_quantile {
            views.iter_mut().for_each(|view| view.drop_far(quantile));
        }
        let is_copy = rng(seed, "sample", position, "monocular").unit() < self.monocular_share;
        if !is_shaped {
            let mut stream = rng(seed, "sample", position, "windows");
            let windows = match self.windows {
                Windows::Matched => crop::choose([&views[0], &views[1]], target, &mut stream).map(Some),
                Windows::Middle => [None; 2],
            };
            let shape = |view, n: usize, purpose| {
                self.reshape_view(view, windows[n], target, rng(seed, "sample", position, purpose))
            };
            let [a, b] = views;
            let a = shape(a, 0, "roll a")?;
            views = [a, if is_copy { b } else { shape(b, 1, "roll b")? }];
        }
        if is_copy {
            views[1] = views[0].clone();
        }
        Ok((views, is_copy))
    }

    fn reshape_view(
        &self,
        view: UndevelopedView,
        window: Option<[f64; 4]>,
        target: [usize; 2],
        mut stream: Stream,
    ) -> Result<UndevelopedView, Error> {
        let roll_rad = self.roll_rad(&mut stream);
        if window.is_none() && roll_rad.is_none() {
            return rescale::middle(&rescale::cover(view, target, self.fidelity)?, target);
        }
        let window = window.unwrap_or_else(|| view.middle_window(target));
        let turn = Turn::onto(&view.camera, window, target, self.fidelity)?;
        let turn = match roll_rad {
            Some(angle) => turn.rolled(&view.camera, angle)?,
            None => turn,
        };
        Ok(turn.apply(&view))
    }

    /// The angle that a view is rolled by, if it is.
    pub(crate) fn roll_rad(&self, stream: &mut Stream) -> Option<f64> {
        let (coin, turn) = (stream.unit(), stream.unit());
        (coin < self.roll_share).then_some(turn * std::f64::consts::TAU)
    }

    /// The levels of a finished view as a network is given them; `which` names the view's draws.
    pub fn develop(&self, view: UndevelopedView, seed: u64, position: u64, which: &str) -> TrainingView {
        let mut levels = view.levels;
        if let Some(physical) = &self.physical {
            levels = physical.apply(&levels, &mut rng(seed, "sample", position, &format!("camera {which}")));
        }
        // The conversion stays within a byte, and takes NaN for black.
        let mut bytes = levels.map(|level| level.round() as u8);
        if let Some(photometric) = &self.photometric {
            bytes = photometric.apply(bytes, &mut rng(seed, "sample", position, &format!("levels {which}")));
        }
        TrainingView { rgb: bytes.map(|level| [*level; 3]), camera: view.camera, truth: view.truth }
    }
}

#[cfg(test)]
mod tests;
