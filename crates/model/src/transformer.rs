//! Blocks of the encoder and of the decoders.

use burn_tensor::Tensor;

use crate::attention::{Rope, cross_attention, self_attention};
use crate::scope::Scope;

/// `enc_blocks.i`.
pub(crate) fn encoder_block(at: &Scope<'_>, x: Tensor<3>, rope: &Rope) -> Tensor<3> {
    let x = x.clone() + self_attention(&at.under("attn"), at.norm("norm1", x), rope);
    x.clone() + at.mlp("mlp", at.norm("norm2", x))
}

/// `dec_blocks.i`: the tokens of one view and, from the previous level, those of the other; the encodings of their places in
/// that order.
pub(crate) fn decoder_block(at: &Scope<'_>, x: Tensor<3>, other: Tensor<3>, ropes: [&Rope; 2]) -> Tensor<3> {
    let x = x.clone() + self_attention(&at.under("attn"), at.norm("norm1", x), ropes[0]);
    let other = at.norm("norm_y", other);
    let x = x.clone() + cross_attention(&at.under("cross_attn"), at.norm("norm2", x), other, ropes);
    x.clone() + at.mlp("mlp", at.norm("norm3", x))
}
