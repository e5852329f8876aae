//! What a method is shown, and what it says.

use super::network;
use crate::truth::TruthPair;
use selenograph_geometry::{CamA, CamB, Rigid3, Vector3};
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
    /// Unit vectors to the Suns, each in its camera's axes, where they are known: they are given to the methods that look at shading.
    pub suns: [Option<Vector3<f64>>; 2],
    /// Settings of the methods of `reconstruct`, but for what an evaluation decides itself.
    pub options: &'a pipeline::Options,
    /// The truth, for the anchors.
    pub truth: &'a TruthPair,
    /// The network at work on this pair.
    pub network: Option<&'a network::Session<'a>>,
}

/// What a method says of an item.
#[derive(Debug, Clone)]
pub struct Answer {
    /// On the full frames.
    pub prediction: Prediction,
    /// The relative pose by the reference protocol, for methods that estimate one.
    pub reference_pose: Option<Pose>,
}
