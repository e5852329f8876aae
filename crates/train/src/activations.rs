//! What a network of crate `model` keeps while it learns from a pair: an estimate from the inputs of its layers.

use crate::Frozen;
use selenograph_model::SavedActivations;
use selenograph_network::{NetworkConfig, Transformer};

/// Rows of a block's width per token: norms, queries, keys, values, products, four of the hidden layer before and after its
/// activation, sums.
const ROWS_SELF: usize = 20;
/// The same with cross-attention.
const ROWS_CROSS: usize = 28;
/// Maps of scores of an attention: their exponentials, and on the way back two more of one block at a time.
const SCORES: usize = 1;
const SCORES_BACK: usize = 2;
/// Maps per convolution of a residual unit: what goes in, with its border, and after the activation.
const RESIDUAL_MAPS: usize = 4;
/// Maps of the dense head's last layers at the pictures' size.
const LAST_MAPS: usize = 3;
/// The same, of the pictures of one head, on the way back.
const LAST_MAPS_BACK: usize = 6;
/// Copies of the descriptors: raw, in their order, squares, units, and of the losses.
const DESCRIPTOR_MAPS: usize = 6;
/// Copies of the hidden layer of the descriptors' MLP.
const HIDDEN_ROWS: usize = 3;

/// Numbers kept of both pictures of a pair of `size` (rows, columns), each pair both ways, and what comes and goes beside
/// them.
pub(crate) fn floats(
    config: &NetworkConfig,
    frozen: Frozen,
    keep: SavedActivations,
    size: [usize; 2],
) -> u64 {
    let num_pixels = size[0] * size[1];
    let tokens = num_pixels / config.patch_area();
    let encoder = match frozen {
        Frozen::Encoder => 0,
        Frozen::None => {
            2 * (blocks(&config.encoder, tokens, [ROWS_SELF, 1], keep) + stem(config, num_pixels))
        }
    };
    // Both views of both orders.
    let decoders = 4 * blocks(&config.decoder, tokens, [ROWS_CROSS, 2], keep);
    (encoder
        + decoders
        + 4 * head(config, num_pixels)
        + 2 * LAST_MAPS_BACK * config.dpt_last_dim * num_pixels) as u64
}

/// Of one picture in the blocks of a transformer, each of `rows` per token and `attentions`.
fn blocks(
    shape: &Transformer,
    tokens: usize,
    [rows, attentions]: [usize; 2],
    keep: SavedActivations,
) -> usize {
    let maps = attentions * shape.num_heads * tokens * tokens;
    let kept = tokens * shape.dim * rows + SCORES * maps;
    let passing = SCORES_BACK * maps;
    match keep {
        SavedActivations::Everything => shape.num_blocks * kept + passing,
        SavedActivations::BlockInputs => shape.num_blocks * tokens * shape.dim + kept + passing,
    }
}

/// Of one picture in a convolutional stem.
fn stem(config: &NetworkConfig, num_pixels: usize) -> usize {
    let maps = config.stem_dims.unwrap_or_default().into_iter().zip([4, 16, 64]);
    maps.map(|(channels, share)| 2 * RESIDUAL_MAPS * channels * num_pixels / share).sum()
}

/// Of one picture in one head.
fn head(config: &NetworkConfig, num_pixels: usize) -> usize {
    let fusion = config.dpt_fusion_dim * num_pixels;
    // Two residual units at each level, and the enlarged maps between them.
    let levels: usize =
        [16, 64, 256].map(|share| 2 * RESIDUAL_MAPS * fusion / share + 2 * fusion * 4 / share).iter().sum();
    let descriptors = DESCRIPTOR_MAPS * config.descriptor_channels().unwrap_or(0) * num_pixels;
    let hidden = HIDDEN_ROWS * config.descriptor_hidden_dim() * num_pixels / config.patch_area();
    levels + LAST_MAPS * config.dpt_last_dim * num_pixels + descriptors + hidden
}
