//! Confidence as the weight of a pixel's loss.
//!
//! # Source
//! Wang et al. 2024, "DUSt3R", equation 4; Wan et al. 2018, "ConfNet".

use super::reduce::masked_mean;
use super::regression::PixelLoss;
use burn_tensor::Tensor;

/// Mean of `loss · c − alpha · ln c` over the pixels that count, of the whole batch.
pub(crate) fn confidence_weighted(pixels: &PixelLoss, confidence: Tensor<3>, alpha: f64) -> Tensor<1> {
    let weighted = pixels.loss.clone() * confidence.clone() - confidence.log() * alpha;
    masked_mean(weighted, pixels.mask.clone())
}
