//! What a method is shown, and what it says.

use super::network;
use crate::dataset_source::LoadedPair;
use crate::truth::TruthPair;
use selenograph_geometry::{CamA, CamB, Rigid3};
use selenograph_reconstruct::priors::{KnownSun, SunAxes};
use selenograph_reconstruct::{NoPose, Prediction, View, pipeline};

/// A relative pose, or why there is none.
pub type Pose = Result<Rigid3<CamB, CamA>, NoPose>;

/// What a method is shown.
#[derive(Clone, Copy)]
pub struct Item<'a> {
    /// Both views.
    pub views: &'a [View; 2],
    /// The numbers of their lights: which pictures of the pair these are.
    pub lights: [u64; 2],
    /// What is known of their light: it is given to the methods that look at shading.
    pub lighting: Lighting,
    /// Settings of the methods of `reconstruct`, but for what an evaluation decides itself.
    pub options: &'a pipeline::Options,
    /// The truth, for the anchors.
    pub truth: &'a TruthPair,
    /// The network at work on this pair.
    pub network: Option<&'a network::Session<'a>>,
}

/// What is known of the light of both pictures.
#[derive(Debug, Clone, Copy)]
pub struct Lighting {
    /// Each Sun in its camera's axes, where it is known.
    pub suns: [Option<KnownSun>; 2],
    /// Whether the zero of the grey levels is unknown too.
    pub is_stretched: bool,
}

impl Lighting {
    /// Of two lights of a pair.
    pub fn of(pair: &LoadedPair, lights: [u64; 2]) -> Self {
        let sigma_rad = pair.sun_sigma_rad;
        let known = |direction| KnownSun { direction, axes: SunAxes::Own, sigma_rad };
        Self { suns: pair.suns_in_cams(lights).map(|sun| sun.map(known)), is_stretched: pair.is_stretched }
    }
}

/// What a method says of an item.
#[derive(Debug, Clone)]
pub struct Answer {
    /// On the full frames.
    pub prediction: Prediction,
    /// The relative pose by the reference protocol, for methods that estimate one.
    pub reference_pose: Option<Pose>,
}
