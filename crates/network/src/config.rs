//! Dimensions of a network of the MASt3R family.

use serde::{Deserialize, Serialize};

/// A transformer's width, depth and heads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transformer {
    /// Channels of a token.
    pub dim: usize,
    /// Blocks.
    pub num_blocks: usize,
    /// Attention heads.
    pub num_heads: usize,
    /// Hidden channels of a block's MLP.
    pub mlp_dim: usize,
}

/// How the raw head output becomes a distance from the origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthMode {
    /// As it is.
    Linear,
    /// Direction times squared length.
    Square,
    /// Direction times `expm1` of the length.
    Exp,
}

/// How a raw channel becomes a confidence between two limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ConfidenceMode {
    /// `min + min(exp(x), max − min)`.
    Exp {
        /// Smallest confidence.
        min: f64,
        /// Largest confidence, may be infinite.
        max: f64,
    },
    /// `(max − min) σ(x) + min`.
    Sigmoid {
        /// Smallest confidence.
        min: f64,
        /// Largest confidence.
        max: f64,
    },
}

/// Everything that fixes the network's function but its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// Side of a patch, pixels.
    pub patch_px: usize,
    /// The encoder, shared by both views.
    pub encoder: Transformer,
    /// Each of the two decoders.
    pub decoder: Transformer,
    /// Base of the rotary position encoding's frequencies.
    pub rope_base: f64,
    /// Channels of the four levels of the DPT heads.
    pub dpt_dims: [usize; 4],
    /// Channels where the DPT heads fuse their levels.
    pub dpt_fusion_dim: usize,
    /// Channels of the last convolutions of the DPT heads.
    pub dpt_last_dim: usize,
    /// Channels of a descriptor; `None` for a network without descriptor heads (DUSt3R).
    pub descriptor_dim: Option<usize>,
    /// Distance from the origin.
    pub depth_mode: DepthMode,
    /// Confidence of the points.
    pub confidence: ConfidenceMode,
    /// Confidence of the descriptors; `None` if the points' is used for both.
    pub descriptor_confidence: Option<ConfidenceMode>,
}
