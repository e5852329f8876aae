//! Every tensor of a network: its name in the field's checkpoints, shape, part, first value and whether it is read at all.
//!
//! Weights of linear layers are `[out, in]`, of convolutions `[out, in, height, width]`, of transposed convolutions
//! `[in, out, height, width]`.

use crate::Error;
use crate::config::{IMAGE_CHANNELS, NetworkConfig, POINT_CHANNELS, Transformer};
use serde::Serialize;
use std::collections::BTreeMap;

/// What the tensors of the second decoder begin with.
pub(crate) const DECODER_2: &str = "dec_blocks2.";
/// What the tensors of the first decoder begin with.
pub(crate) const DECODER_1: &str = "dec_blocks.";

/// A part of the network, for counting and for partial checkpoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// `mask_token`: in the checkpoints, read by nothing.
    MaskToken,
    /// `stem`, where there is one.
    Stem,
    /// `patch_embed`.
    PatchEmbed,
    /// `enc_blocks`.
    Encoder,
    /// `enc_norm`.
    EncoderNorm,
    /// `decoder_embed`.
    DecoderEmbed,
    /// `dec_blocks`.
    Decoder1,
    /// `dec_blocks2`.
    Decoder2,
    /// `dec_norm`, of both decoders.
    DecoderNorm,
    /// `downstream_head1.dpt`.
    Head1Points,
    /// `downstream_head1.head_local_features`.
    Head1Descriptors,
    /// `downstream_head2.dpt`.
    Head2Points,
    /// `downstream_head2.head_local_features`.
    Head2Descriptors,
}

/// What a tensor is for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Purpose {
    /// Forward passes read it.
    Computed,
    /// It is in every checkpoint, and no forward pass reads it.
    Unused,
    /// A second name of another tensor.
    AliasOf(String),
}

/// A tensor's value in a network that has learnt nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Init {
    /// 0.
    Zeros,
    /// 1.
    Ones,
    /// Uniform between `−bound` and `bound`.
    Uniform {
        /// Largest absolute value.
        bound: f64,
    },
    /// Normal round 0.
    Normal {
        /// Standard deviation.
        sigma: f64,
    },
}

/// A tensor of a network.
#[derive(Debug, Clone, PartialEq)]
pub struct TensorSpec {
    /// Name in a checkpoint.
    pub name: String,
    /// Sizes, the slowest first.
    pub shape: Vec<usize>,
    /// Which part it belongs to.
    pub part: Part,
    /// What it is for.
    pub purpose: Purpose,
    /// Value before training.
    pub init: Init,
}

impl TensorSpec {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether it is a second name of another tensor.
    pub fn is_alias(&self) -> bool {
        matches!(self.purpose, Purpose::AliasOf(_))
    }
}

/// All tensors of a network, in the order in which a forward pass meets them.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    specs: Vec<TensorSpec>,
    by_name: BTreeMap<String, usize>,
}

impl Layout {
    /// The tensors of a network.
    ///
    /// # Errors
    /// [`Error::Config`] for dimensions that no network has.
    pub fn new(config: &NetworkConfig) -> Result<Self, Error> {
        config.check()?;
        let mut builder = Builder { specs: Vec::new() };
        builder.network(config);
        let by_name = builder.specs.iter().enumerate().map(|(idx, spec)| (spec.name.clone(), idx)).collect();
        Ok(Self { specs: builder.specs, by_name })
    }

    /// All tensors, aliases and unused ones too.
    pub fn specs(&self) -> &[TensorSpec] {
        &self.specs
    }

    /// The tensors that own their values: all but the aliases.
    pub fn owned(&self) -> impl Iterator<Item = &TensorSpec> {
        self.specs.iter().filter(|spec| !spec.is_alias())
    }

    /// The tensor of that name.
    pub fn get(&self, name: &str) -> Option<&TensorSpec> {
        Some(&self.specs[*self.by_name.get(name)?])
    }

    /// Parameters, each counted once.
    pub fn num_parameters(&self) -> usize {
        self.owned().map(TensorSpec::len).sum()
    }
}

struct Builder {
    specs: Vec<TensorSpec>,
}

impl Builder {
    fn add(&mut self, part: Part, name: String, shape: &[usize], init: Init) {
        self.specs.push(TensorSpec { name, shape: shape.to_vec(), part, purpose: Purpose::Computed, init });
    }

    fn network(&mut self, config: &NetworkConfig) {
        let (encoder, decoder) = (&config.encoder, &config.decoder);
        self.add(Part::MaskToken, "mask_token".into(), &[1, 1, decoder.dim], Init::Normal { sigma: 0.02 });
        self.mark_last_unused();
        if let Some(dims) = config.stem_dims {
            self.stem(dims);
        }
        let [inputs, side] = config.token_input();
        let shape = [encoder.dim, inputs, side, side];
        self.weight_and_bias(Part::PatchEmbed, "patch_embed.proj", &shape, Scheme::Xavier);
        for block in 0..encoder.num_blocks {
            self.encoder_block(&format!("enc_blocks.{block}"), encoder);
        }
        self.norm(Part::EncoderNorm, "enc_norm", encoder.dim);
        let shape = [decoder.dim, encoder.dim];
        self.weight_and_bias(Part::DecoderEmbed, "decoder_embed", &shape, Scheme::Xavier);
        for (part, prefix) in [(Part::Decoder1, DECODER_1), (Part::Decoder2, DECODER_2)] {
            for block in 0..decoder.num_blocks {
                self.decoder_block(part, &format!("{prefix}{block}"), decoder);
            }
        }
        self.norm(Part::DecoderNorm, "dec_norm", decoder.dim);
        let heads = [
            (Part::Head1Points, Part::Head1Descriptors, "downstream_head1"),
            (Part::Head2Points, Part::Head2Descriptors, "downstream_head2"),
        ];
        for (points, descriptors, prefix) in heads {
            self.dpt(points, &format!("{prefix}.dpt"), config);
            if let Some(channels) = config.descriptor_channels() {
                let name = format!("{prefix}.head_local_features");
                if config.stem_dims.is_some() {
                    let shape = [channels, config.dpt_last_dim, 1, 1];
                    self.weight_and_bias(descriptors, &name, &shape, Scheme::FanIn);
                    continue;
                }
                let (input, hidden) = (config.descriptor_input_dim(), config.descriptor_hidden_dim());
                let output = channels * config.patch_area();
                self.weight_and_bias(descriptors, &format!("{name}.fc1"), &[hidden, input], Scheme::FanIn);
                self.weight_and_bias(descriptors, &format!("{name}.fc2"), &[output, hidden], Scheme::FanIn);
            }
        }
    }

    fn stem(&mut self, dims: [usize; 3]) {
        let mut inputs = IMAGE_CHANNELS;
        for (level, dim) in dims.into_iter().enumerate() {
            let name = format!("stem.{level}");
            // Drawn so that the signal keeps its strength on its way to the tokens.
            self.weight_and_bias(Part::Stem, &format!("{name}.down"), &[dim, inputs, 3, 3], Scheme::Xavier);
            for conv in ["conv1", "conv2"] {
                self.weight_and_bias(Part::Stem, &format!("{name}.{conv}"), &[dim, dim, 3, 3], Scheme::FanIn);
            }
            inputs = dim;
        }
    }

    fn encoder_block(&mut self, name: &str, size: &Transformer) {
        self.norm(Part::Encoder, &format!("{name}.norm1"), size.dim);
        self.self_attention(Part::Encoder, name, size.dim);
        self.norm(Part::Encoder, &format!("{name}.norm2"), size.dim);
        self.mlp(Part::Encoder, name, size);
    }

    fn decoder_block(&mut self, part: Part, name: &str, size: &Transformer) {
        self.norm(part, &format!("{name}.norm1"), size.dim);
        self.self_attention(part, name, size.dim);
        for projection in ["projq", "projk", "projv", "proj"] {
            let name = format!("{name}.cross_attn.{projection}");
            self.weight_and_bias(part, &name, &[size.dim, size.dim], Scheme::Xavier);
        }
        for norm in ["norm2", "norm3"] {
            self.norm(part, &format!("{name}.{norm}"), size.dim);
        }
        self.mlp(part, name, size);
        self.norm(part, &format!("{name}.norm_y"), size.dim);
    }

    fn self_attention(&mut self, part: Part, name: &str, dim: usize) {
        self.weight_and_bias(part, &format!("{name}.attn.qkv"), &[3 * dim, dim], Scheme::Xavier);
        self.weight_and_bias(part, &format!("{name}.attn.proj"), &[dim, dim], Scheme::Xavier);
    }

    fn mlp(&mut self, part: Part, name: &str, size: &Transformer) {
        self.weight_and_bias(part, &format!("{name}.mlp.fc1"), &[size.mlp_dim, size.dim], Scheme::Xavier);
        self.weight_and_bias(part, &format!("{name}.mlp.fc2"), &[size.dim, size.mlp_dim], Scheme::Xavier);
    }

    fn dpt(&mut self, part: Part, name: &str, config: &NetworkConfig) {
        let (dims, fusion) = (config.dpt_dims, config.dpt_fusion_dim);
        for (level, &dim) in dims.iter().enumerate() {
            let tokens = if level == 0 { config.encoder.dim } else { config.decoder.dim };
            let name = format!("{name}.act_postprocess.{level}");
            self.weight_and_bias(part, &format!("{name}.0"), &[dim, tokens, 1, 1], Scheme::FanIn);
            // Levels 0 and 1 grow by a transposed convolution, 3 shrinks by a strided one, 2 stays.
            let side = [4, 2, 0, 3][level];
            if side > 0 {
                self.weight_and_bias(part, &format!("{name}.1"), &[dim, dim, side, side], Scheme::FanIn);
            }
        }
        for (level, &dim) in dims.iter().enumerate() {
            let layer = format!("{name}.scratch.layer{}_rn.weight", level + 1);
            let shape = [fusion, dim, 3, 3];
            let init = Init::Uniform { bound: fan_in_bound(&shape) };
            self.add(part, layer.clone(), &shape, init);
            self.add(part, format!("{name}.scratch.layer_rn.{level}.weight"), &shape, init);
            if let Some(alias) = self.specs.last_mut() {
                alias.purpose = Purpose::AliasOf(layer);
            }
        }
        for (level, dim) in config.stem_dims.iter().flat_map(|dims| dims[..2].iter().enumerate()) {
            let name = format!("{name}.scratch.stem{level}_rn");
            self.weight_and_bias(part, &name, &[fusion, *dim, 1, 1], Scheme::FanIn);
        }
        for level in (1..=4).rev() {
            let name = format!("{name}.scratch.refinenet{level}");
            for unit in [1, 2] {
                for conv in [1, 2] {
                    let name = format!("{name}.resConfUnit{unit}.conv{conv}");
                    self.weight_and_bias(part, &name, &[fusion, fusion, 3, 3], Scheme::FanIn);
                    // The coarsest level has nothing below it to fuse with.
                    if (level, unit) == (4, 1) {
                        self.mark_last_unused();
                        let weight = self.specs.len() - 2;
                        self.specs[weight].purpose = Purpose::Unused;
                    }
                }
            }
            self.weight_and_bias(part, &format!("{name}.out_conv"), &[fusion, fusion, 1, 1], Scheme::FanIn);
        }
        let (half, last) = (config.dpt_half_dim(), config.dpt_last_dim);
        self.weight_and_bias(part, &format!("{name}.head.0"), &[half, fusion, 3, 3], Scheme::FanIn);
        self.weight_and_bias(part, &format!("{name}.head.2"), &[last, half, 3, 3], Scheme::FanIn);
        self.weight_and_bias(part, &format!("{name}.head.4"), &[POINT_CHANNELS, last, 1, 1], Scheme::FanIn);
    }

    fn norm(&mut self, part: Part, name: &str, dim: usize) {
        self.add(part, format!("{name}.weight"), &[dim], Init::Ones);
        self.add(part, format!("{name}.bias"), &[dim], Init::Zeros);
    }

    fn weight_and_bias(&mut self, part: Part, name: &str, shape: &[usize], scheme: Scheme) {
        // A transposed convolution of this architecture has as many outputs as inputs: its bias is as long as its first side.
        let (weight, bias) = match scheme {
            Scheme::Xavier => (Init::Uniform { bound: xavier_bound(shape) }, Init::Zeros),
            Scheme::FanIn => {
                let init = Init::Uniform { bound: fan_in_bound(shape) };
                (init, init)
            }
        };
        self.add(part, format!("{name}.weight"), shape, weight);
        self.add(part, format!("{name}.bias"), &shape[..1], bias);
    }

    fn mark_last_unused(&mut self) {
        if let Some(spec) = self.specs.last_mut() {
            spec.purpose = Purpose::Unused;
        }
    }
}

/// How a layer's first weights are drawn.
#[derive(Clone, Copy)]
enum Scheme {
    /// Uniform, by inputs and outputs, no bias: the transformers.
    Xavier,
    /// Uniform, by inputs, weight and bias alike: the heads.
    FanIn,
}

/// Glorot and Bengio 2010, eq. 16; a patch convolution counts as the linear layer that it is.
fn xavier_bound(shape: &[usize]) -> f64 {
    let fan_in: usize = shape[1..].iter().product();
    (6.0 / (fan_in + shape[0]) as f64).sqrt()
}

/// The bound that keeps the variance of inputs, up to a factor of 3 (LeCun et al. 1998, "Efficient BackProp", §4.6).
fn fan_in_bound(shape: &[usize]) -> f64 {
    let fan_in: usize = shape[1..].iter().product();
    (1.0 / fan_in as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    #[test]
    fn a_stem_brings_its_convolutions_and_replaces_the_descriptors_mlp() {
        let layout = Layout::new(&Preset::Hybrid.config()).unwrap();
        let shape = |name: &str| layout.get(name).unwrap_or_else(|| panic!("no `{name}`")).shape.clone();
        for (level, (inputs, dim)) in [(3, 24), (24, 48), (48, 96)].into_iter().enumerate() {
            for (conv, inputs) in [("down", inputs), ("conv1", dim), ("conv2", dim)] {
                assert_eq!(shape(&format!("stem.{level}.{conv}.weight")), [dim, inputs, 3, 3]);
                assert_eq!(shape(&format!("stem.{level}.{conv}.bias")), [dim]);
            }
        }
        assert_eq!(shape("patch_embed.proj.weight"), [192, 96, 2, 2]);
        for head in ["downstream_head1", "downstream_head2"] {
            assert_eq!(shape(&format!("{head}.dpt.scratch.stem0_rn.weight")), [48, 24, 1, 1]);
            assert_eq!(shape(&format!("{head}.dpt.scratch.stem1_rn.weight")), [48, 48, 1, 1]);
            assert_eq!(shape(&format!("{head}.head_local_features.weight")), [25, 48, 1, 1]);
            assert!(layout.get(&format!("{head}.head_local_features.fc1.weight")).is_none());
        }
        // Nine taps of inputs, and a bias, for each output of each convolution.
        let level = |inputs: usize, dim: usize| dim * (9 * inputs + 1) + 2 * dim * (9 * dim + 1);
        let mut counts = BTreeMap::new();
        for spec in layout.owned() {
            *counts.entry(spec.part).or_insert(0) += spec.len();
        }
        assert_eq!(counts[&Part::Stem], level(3, 24) + level(24, 48) + level(48, 96));
        assert_eq!(counts[&Part::Head1Descriptors], 25 * (48 + 1));
        assert!(
            layout.specs().iter().all(|spec| spec.part != Part::Stem || spec.purpose == Purpose::Computed)
        );
    }

    #[test]
    fn without_a_stem_nothing_is_named_after_one() {
        let layout = Layout::new(&Preset::Tiny.config()).unwrap();
        assert!(layout.specs().iter().all(|spec| !spec.name.contains("stem") && spec.part != Part::Stem));
    }
}
