//! InfoNCE over the descriptors of matches, weighted by their confidence.
//!
//! # Source
//! Leroy et al. 2024, "Grounding Image Matching in 3D with MASt3R", equations 8 and 9; van den Oord et al. 2018,
//! "Representation Learning with Contrastive Predictive Coding".

use super::reduce::masked_mean;
use crate::batch::{Matches, ViewOutput};
use burn_tensor::Tensor;
use serde::{Deserialize, Serialize};

/// Smallest probability of a match: below it there is no gradient.
const SMALLEST_PROBABILITY: f64 = 1e-8;

/// How descriptors are compared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MatchingSettings {
    /// Share in the total loss.
    pub weight: f64,
    /// Temperature of the similarities.
    pub temperature: f64,
    /// Weight of the logarithm of the confidence.
    pub alpha: f64,
    /// Matches compared with each other at most; more are cut into blocks of this size.
    pub block: usize,
}

impl Default for MatchingSettings {
    fn default() -> Self {
        Self { weight: 0.075, temperature: 0.05, alpha: 10.0, block: 8192 }
    }
}

/// The matching loss of a batch.
#[derive(Debug, Clone)]
pub struct MatchingLoss {
    /// Mean of `l · κ − alpha · ln κ` over all valid matches, κ being the mean confidence of the two pixels.
    pub weighted: Tensor<1>,
    /// Mean of `l`.
    pub plain: Tensor<1>,
}

/// The matching loss of a batch.
pub fn matching(output: &[ViewOutput; 2], matches: &Matches, settings: &MatchingSettings) -> MatchingLoss {
    let per_match = info_nce(output, matches, settings);
    let confidence = [0, 1].map(|view| {
        let [b, h, w] = output[view].descriptor_confidence.dims();
        let flat = output[view].descriptor_confidence.clone().reshape([b, h * w]);
        flat.gather(1, matches.pixels[view].clone())
    });
    let [first, second] = confidence;
    // A pixel that only serves as a negative may have any confidence, so its logarithm must not reach the mean.
    let confidence = ((first + second) * 0.5).mask_fill(matches.valid.clone().bool_not(), 1.0);
    let weighted = per_match.clone() * confidence.clone() - confidence.log() * settings.alpha;
    MatchingLoss {
        weighted: masked_mean(weighted, matches.valid.clone()),
        plain: masked_mean(per_match, matches.valid.clone()),
    }
}

/// `−ln p(b|a) − ln p(a|b)` of each pair of pixels, the negatives among them counted in the sums only: B × n.
pub fn info_nce(output: &[ViewOutput; 2], matches: &Matches, settings: &MatchingSettings) -> Tensor<2> {
    let [b, n] = matches.valid.dims();
    let pairs = (0..b).map(|item| {
        let sampled = [0, 1].map(|view| sampled(output, matches, view, item));
        let blocks = (0..n).step_by(settings.block).map(|start| {
            let len = settings.block.min(n - start);
            let [first, second] = sampled.clone().map(|all| all.narrow(0, start, len));
            of_rows(first, second, settings.temperature)
        });
        Tensor::cat(blocks.collect(), 0)
    });
    Tensor::stack(pairs.collect(), 0)
}

/// Descriptors of one pair at the pixels of its matches: n × C.
pub(super) fn sampled(output: &[ViewOutput; 2], matches: &Matches, view: usize, item: usize) -> Tensor<2> {
    let [_, h, w, c] = output[view].descriptors.dims();
    let descriptors = output[view].descriptors.clone().narrow(0, item, 1).reshape([h * w, c]);
    let [_, n] = matches.pixels[view].dims();
    descriptors.select(0, matches.pixels[view].clone().narrow(0, item, 1).reshape([n]))
}

/// The loss of each row of `first` with the same row of `second`: n.
fn of_rows(first: Tensor<2>, second: Tensor<2>, temperature: f64) -> Tensor<1> {
    let [n, _] = first.dims();
    let matched = (first.clone() * second.clone()).sum_dim(1).reshape([n]) / temperature;
    // Similarities of unit vectors stay below 1 / temperature = 20: no maximum needs to be taken out.
    let exponentials = (first.matmul(second.transpose()) / temperature).exp();
    let sums_of_columns = exponentials.clone().sum_dim(0).log().reshape([n]);
    let sums_of_rows = exponentials.sum_dim(1).log().reshape([n]);
    let smallest = SMALLEST_PROBABILITY.ln();
    -(matched.clone() - sums_of_columns).clamp_min(smallest) - (matched - sums_of_rows).clamp_min(smallest)
}
