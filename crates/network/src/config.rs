//! Dimensions of a network of the MASt3R family.

use crate::Error;
use serde::{Deserialize, Serialize};

/// Most blocks, channels and heads that are believed: beyond them a file is damaged or hostile, and sizes could overflow.
const MAX_BLOCKS: usize = 256;
const MAX_DIM: usize = 1 << 14;
/// RGB.
pub const IMAGE_CHANNELS: usize = 3;
/// Channels of a point head: x, y, z, confidence.
pub(crate) const POINT_CHANNELS: usize = 4;
/// Added to the variance of a picture, in units of its values from −1 to 1, where a stem standardises it: noise of an empty
/// picture stays small.
pub const STEM_VARIANCE_FLOOR: f64 = 1e-4;
/// Pixels along a side of what one pixel of the stem's last map sees at least.
pub(crate) const STEM_STRIDE_PX: usize = 8;
/// The patch size at which a stem's maps meet those of the dense heads.
const STEM_PATCH_PX: usize = 16;
/// Hidden channels of the descriptor MLP for each of its input channels.
const DESCRIPTOR_MLP_RATIO: usize = 4;
/// Epsilon of every layer norm.
pub const NORM_EPSILON: f64 = 1e-6;

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

impl Transformer {
    /// Channels of an attention head.
    pub fn head_dim(&self) -> usize {
        self.dim / self.num_heads
    }

    fn check(&self, which: &'static str) -> Result<(), Error> {
        let refuse =
            |expected: &'static str, found: usize| Err(Error::Config { what: which, expected, found });
        if !(1..=MAX_DIM).contains(&self.dim) {
            return refuse("1 to 16384 channels", self.dim);
        }
        if !(1..=MAX_BLOCKS).contains(&self.num_blocks) {
            return refuse("1 to 256 blocks", self.num_blocks);
        }
        if !(1..=MAX_DIM * 8).contains(&self.mlp_dim) {
            return refuse("1 to 131072 channels in the MLP", self.mlp_dim);
        }
        if self.num_heads == 0 || !self.dim.is_multiple_of(self.num_heads) {
            return refuse("a number of heads that divides the channels", self.num_heads);
        }
        if !self.head_dim().is_multiple_of(4) {
            return refuse(
                "a multiple of 4 channels in a head, as the rotary encoding needs",
                self.head_dim(),
            );
        }
        Ok(())
    }
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
        #[serde(with = "limit")]
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
    /// Channels of the maps of a convolutional stem, at a half, a quarter and an eighth of the picture's size; `None` for the
    /// published networks, whose tokens are linear in the pixels. The stem sees pictures standardised, each to
    /// mean 0 and variance 1: lunar ground is often of low contrast. With a stem the finer maps also enter the dense heads, whose
    /// last layers work at half the picture's size, and descriptors come from their last features instead of from an MLP on
    /// tokens.
    ///
    /// # Source
    /// Xiao et al. 2021, "Early Convolutions Help Transformers See Better"; the joining of fine maps is that of Ronneberger
    /// et al. 2015, "U-Net".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stem_dims: Option<[usize; 3]>,
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

impl NetworkConfig {
    /// Which of the decoder's levels each level of the DPT heads reads: 0 is the encoder's output, `l` the output of the
    /// decoder's block `l − 1`; the last one passes through `dec_norm`.
    pub fn hooks(&self) -> [usize; 4] {
        let blocks = self.decoder.num_blocks;
        [0, blocks * 2 / 4, blocks * 3 / 4, blocks]
    }

    /// Pixels of a patch.
    pub fn patch_area(&self) -> usize {
        self.patch_px * self.patch_px
    }

    /// Channels of the first convolution of the DPT heads' last stage.
    pub fn dpt_half_dim(&self) -> usize {
        self.dpt_fusion_dim / 2
    }

    /// Channels and side of what each token is a linear function of: colours of a patch's pixels, or the stem's last map.
    pub fn token_input(&self) -> [usize; 2] {
        match self.stem_dims {
            None => [IMAGE_CHANNELS, self.patch_px],
            Some([_, _, dim]) => [dim, self.patch_px / STEM_STRIDE_PX],
        }
    }

    /// Input channels of the descriptor MLP: encoder and decoder side by side.
    pub(crate) fn descriptor_input_dim(&self) -> usize {
        self.encoder.dim + self.decoder.dim
    }

    /// Hidden channels of the descriptor MLP.
    pub fn descriptor_hidden_dim(&self) -> usize {
        DESCRIPTOR_MLP_RATIO * self.descriptor_input_dim()
    }

    /// Channels per pixel that the descriptor MLP gives: the descriptor and, with
    /// [`NetworkConfig::descriptor_confidence`], its confidence after it. `None` without descriptors.
    pub fn descriptor_channels(&self) -> Option<usize> {
        Some(self.descriptor_dim? + usize::from(self.descriptor_confidence.is_some()))
    }

    /// Finds dimensions that no network has, before anything is computed from them.
    ///
    /// # Errors
    /// [`Error::Config`] names the dimension.
    pub fn check(&self) -> Result<(), Error> {
        let refuse = |what, expected, found| Err(Error::Config { what, expected, found });
        self.encoder.check("encoder")?;
        self.decoder.check("decoder")?;
        if !(1..=64).contains(&self.patch_px) {
            return refuse("patch size", "1 to 64 pixels", self.patch_px);
        }
        if let Some(dims) = self.stem_dims {
            if self.patch_px != STEM_PATCH_PX {
                return refuse("patch size", "16 pixels, with a convolutional stem", self.patch_px);
            }
            if let Some(&dim) = dims.iter().find(|dim| !(1..=MAX_DIM).contains(*dim)) {
                return refuse("stem width", "1 to 16384 channels", dim);
            }
        }
        if !(2..=MAX_DIM).contains(&self.dpt_fusion_dim) || !self.dpt_fusion_dim.is_multiple_of(2) {
            return refuse("DPT fusion width", "an even number up to 16384", self.dpt_fusion_dim);
        }
        for dim in self.dpt_dims.into_iter().chain([self.dpt_last_dim]) {
            if !(1..=MAX_DIM).contains(&dim) {
                return refuse("DPT width", "1 to 16384 channels", dim);
            }
        }
        match self.descriptor_dim {
            Some(dim) if !(1..=1024).contains(&dim) => refuse("descriptor", "1 to 1024 channels", dim),
            _ => Ok(()),
        }
    }
}

/// An upper limit that may be infinite, which JSON has no number for.
mod limit {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Serialize, Deserialize)]
    #[serde(untagged)]
    enum Limit {
        Number(f64),
        Word(String),
    }

    pub fn serialize<S: Serializer>(limit: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        if *limit == f64::INFINITY {
            Limit::Word("inf".into()).serialize(serializer)
        } else {
            Limit::Number(*limit).serialize(serializer)
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        match Limit::deserialize(deserializer)? {
            Limit::Number(limit) => Ok(limit),
            Limit::Word(word) if word == "inf" => Ok(f64::INFINITY),
            Limit::Word(word) => {
                Err(serde::de::Error::custom(format!("expected a number or `inf`, found `{word}`")))
            }
        }
    }
}
