//! How a network is run and matched.

use crate::Executor;
use selenograph_network::input::{Border, Rule};
use serde::{Deserialize, Serialize};

/// Longest side of an input unless another is asked for: what networks of the family are trained on.
const MAX_SIDE: usize = 512;

/// How many matches are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Density {
    /// From a grid of starts: for a pose.
    #[default]
    Published,
    /// Of every pixel as well: for points.
    Dense,
}

/// Which ways a pair is decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Passes {
    /// Both views in the frame of A.
    #[default]
    Forward,
    /// Also both in the frame of B; matches of both ways. Each view is encoded once.
    Symmetric,
}

/// How a network is run and matched.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PredictOptions {
    /// What runs the network.
    pub executor: Executor,
    /// How a picture becomes an input.
    pub input: Rule,
    /// Starts of the matching: every so many pixels along each axis of A's input.
    pub subsample_px: usize,
    /// Matches nearer to a border of an input are left out.
    pub border_px: usize,
    /// How many matches are made.
    pub density: Density,
    /// Which ways a pair is decoded.
    pub passes: Passes,
}

impl Default for PredictOptions {
    /// The whole picture; matches as published (a start every 8 pixels, 3 pixels of border).
    fn default() -> Self {
        Self {
            executor: Executor::Cpu,
            input: Rule::Whole { max_side: Some(MAX_SIDE), border: Border::Pad },
            subsample_px: 8,
            border_px: 3,
            density: Density::Published,
            passes: Passes::Forward,
        }
    }
}
