//! Average precision of descriptors: a measure, without gradient.
//!
//! # Source
//! Revaud et al. 2019, "R2D2", equation 5, with the precision taken exactly: one positive among the candidates.

use super::matching::sampled;
use super::reduce::masked_mean;
use crate::batch::{Matches, ViewOutput};
use burn_tensor::{Int, Tensor};

/// Mean over the valid matches of one over the rank of the true pixel among the candidates, which are the pixels of all
/// matches in view B and `padding`'s (B × p, `y · W + x`).
pub fn average_precision(
    output: &[ViewOutput; 2],
    matches: &Matches,
    padding: Option<&Tensor<2, Int>>,
) -> Tensor<1> {
    masked_mean(reciprocal_ranks(output, matches, padding), matches.valid.clone())
}

/// One over the rank of each match: B × n.
pub fn reciprocal_ranks(
    output: &[ViewOutput; 2],
    matches: &Matches,
    padding: Option<&Tensor<2, Int>>,
) -> Tensor<2> {
    let [b, n] = matches.valid.dims();
    let items = (0..b).map(|item| {
        let [first, second] = [0, 1].map(|view| sampled(output, matches, view, item).detach());
        let candidates = match padding {
            Some(pixels) => {
                let pixels = Matches {
                    pixels: [pixels.clone(), pixels.clone()],
                    valid: pixels.clone().greater_equal_elem(0),
                };
                Tensor::cat(vec![second, sampled(output, &pixels, 1, item).detach()], 0)
            }
            None => second,
        };
        let candidates_len = candidates.dims()[0];
        let scores = first.matmul(candidates.transpose());
        // Taken from the same product, so that rounding puts no match above itself.
        let diagonal = Tensor::<1, Int>::arange(0..n as i64, &scores.device()).reshape([n, 1]);
        let above = scores.clone().greater(scores.gather(1, diagonal).expand([n, candidates_len]));
        (above.int().sum_dim(1).reshape([n]).float() + 1.0).recip()
    });
    Tensor::stack(items.collect(), 0)
}
