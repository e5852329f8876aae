//! A point per pixel: dense stereo, and shading where it joins.

use super::given::Start;
use super::{Incomplete, Options, Stage, shading};
use crate::evidence::Warning;
use crate::matching::Match;
use crate::priors::{self, Priors};
use crate::shading::Shaded;
use crate::stereo::{self, Completion, StereoOptions};
use crate::{Error, PredictedView, View};
use serde::{Deserialize, Serialize};

/// Whether shading joins dense stereo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum ShadingUse {
    /// Where both Suns are known and the surface explains the pictures; else the answer is stereo's
    Auto,
    /// It must: both Suns are needed, and under two of them there is no other answer
    On,
    /// Stereo alone
    #[default]
    Off,
}

impl ShadingUse {
    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::On => "on",
            Self::Off => "off",
        }
    }
}

/// What shading did.
#[derive(Debug, Clone)]
pub enum ShadingOutcome {
    /// It took no part.
    NotAsked,
    /// It was tried and left out: the points, where there are any, are stereo's.
    LeftOut(Warning),
    /// The points are those of its surface.
    Used(Box<ShadedSurface>),
}

impl ShadingOutcome {
    /// The surface, where its points are the answer.
    pub fn used(&self) -> Option<&ShadedSurface> {
        match self {
            Self::Used(surface) => Some(surface),
            Self::NotAsked | Self::LeftOut(_) => None,
        }
    }
}

/// The surface that shading found.
#[derive(Debug, Clone)]
pub struct ShadedSurface {
    /// It, and how it explains the pictures.
    pub shaded: Shaded,
    /// Stereo's answer that it began with, completed everywhere; `None` under two Suns.
    pub before: Option<[PredictedView; 2]>,
}

/// The points of both views, where there are any, and whose they are.
pub(super) struct Found {
    pub(super) views: Option<[PredictedView; 2]>,
    pub(super) shading: ShadingOutcome,
    /// What must be said beside it.
    pub(super) doubts: Vec<Warning>,
}

/// A point per pixel.
///
/// # Errors
/// Those of dense stereo, and [`Error::NotShaded`], unless incomplete answers are kept.
pub(super) fn points(
    [a, b]: [&View; 2],
    start: &Start,
    priors: &Priors,
    options: &Options,
    progress: &mut impl FnMut(Stage),
) -> Result<Found, Error> {
    let keeps = options.incomplete == Incomplete::Keep;
    let by_stereo = |stereo: &StereoOptions| match dense(a, b, start, stereo) {
        Ok(views) => Ok(Some(views)),
        // The pose stands; its pixels have no answer and count as such.
        Err(_) if keeps => Ok(None),
        Err(why) => Err(why),
    };
    let how = options.shading_use(priors);
    if how == ShadingUse::Off {
        progress(Stage::Dense);
        return Ok(Found {
            views: by_stereo(&options.stereo)?,
            shading: ShadingOutcome::NotAsked,
            doubts: Vec::new(),
        });
    }
    let same_sun = priors::same_sun(&priors.suns, &start.cam_b_from_cam_a);
    let mut before = None;
    if same_sun {
        progress(Stage::Dense);
        // The surface goes on beyond what stereo measures, and must start near the ground there.
        let everywhere = StereoOptions { completion: Completion::Everywhere, ..options.stereo.clone() };
        before = by_stereo(&everywhere)?;
    }
    progress(Stage::Shading);
    match shading::shaded([a, b], start, before.as_ref(), priors, &options.shading) {
        Ok((shaded, doubts)) => {
            let views = Some([shaded.view(0, a), shaded.view(1, b)]);
            let surface = ShadedSurface { shaded, before };
            Ok(Found { views, shading: ShadingOutcome::Used(Box::new(surface)), doubts })
        }
        Err(why) => {
            let views = match how {
                // What stereo makes of two Suns was not asked for.
                ShadingUse::On if !same_sun && keeps => None,
                ShadingUse::On if !same_sun => return Err(Error::NotShaded(why)),
                _ => by_stereo(&options.stereo)?,
            };
            Ok(Found { views, shading: ShadingOutcome::LeftOut(why), doubts: Vec::new() })
        }
    }
}

fn dense(
    a: &View,
    b: &View,
    start: &Start,
    options: &StereoOptions,
) -> Result<[PredictedView; 2], stereo::Error> {
    let inliers = start.matches.iter().filter(|m| m.inlier);
    let seeds: Vec<Match> = inliers.map(|m| Match { a: m.a, b: m.b, score: 0.0 }).collect();
    Ok(stereo::dense(a, b, &start.cam_b_from_cam_a, &seeds, options)?.to_points(a, b))
}
