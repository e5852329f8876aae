//! Distance of pointmaps, each divided by its mean distance from camera A.
//!
//! # Source
//! Wang et al. 2024, "DUSt3R", equations 1 to 3; Leroy et al. 2024, "Grounding Image Matching in 3D with MASt3R",
//! section 3.1 (metric pairs keep the scale of the truth).

use super::reduce::{length, masked, squeeze_last};
use crate::batch::{Targets, ViewOutput};
use burn_tensor::{Bool, Tensor};

/// Smallest scale, and what keeps an empty mask from dividing by zero.
const SMALLEST_SCALE: f64 = 1e-8;

/// Predicted and true points on one scale, and what it was.
#[derive(Debug, Clone)]
pub struct Normalised {
    /// Per view: prediction and truth, B × H × W × 3.
    pub views: [(Tensor<4>, Tensor<4>); 2],
    /// Metres of one unit: B × 1 × 1 × 1.
    pub truth_scale_m: Tensor<4>,
}

/// The regression loss of each pixel of a view.
#[derive(Debug, Clone)]
pub struct PixelLoss {
    /// B × H × W.
    pub loss: Tensor<3>,
    /// The pixels that count: B × H × W.
    pub mask: Tensor<3, Bool>,
}

/// Divides the truth by its mean distance from camera A over the valid pixels of both views, and the prediction by its
/// own over the same pixels, through which the gradient passes; a prediction that shall be metric by the truth's.
pub fn normalise(output: &[ViewOutput; 2], targets: &Targets) -> Normalised {
    let truth = [0, 1].map(|view| targets.views[view].points.clone());
    let predicted = [0, 1].map(|view| output[view].points.clone());
    let truth_scale = joint_scale(&truth, targets);
    let own_scale = joint_scale(&predicted, targets);
    let [b] = targets.metric.dims();
    let scale = own_scale.mask_where(targets.metric.clone().reshape([b, 1, 1, 1]), truth_scale.clone());
    let views = [0, 1]
        .map(|view| (predicted[view].clone() / scale.clone(), truth[view].clone() / truth_scale.clone()));
    Normalised { views, truth_scale_m: truth_scale }
}

/// Mean length over the valid pixels of both views: B × 1 × 1 × 1.
fn joint_scale(points: &[Tensor<4>; 2], targets: &Targets) -> Tensor<4> {
    let [(sum_a, count_a), (sum_b, count_b)] = [0, 1].map(|view| {
        let lengths = squeeze_last(length(points[view].clone()));
        let valid = targets.views[view].valid.clone();
        let counts = lengths.zeros_like().mask_fill(valid.clone(), 1.0);
        (per_pair_sum(masked(lengths, valid)), per_pair_sum(counts))
    });
    ((sum_a + sum_b) / (count_a + count_b + SMALLEST_SCALE)).clamp_min(SMALLEST_SCALE)
}

fn per_pair_sum(values: Tensor<3>) -> Tensor<4> {
    let [b, h, w] = values.dims();
    values.reshape([b, h * w]).sum_dim(1).reshape([b, 1, 1, 1])
}

/// Distance between prediction and truth at the valid pixels; with `sky`, that constant at the pixels of the sky, which
/// then teaches their confidence and nothing else.
pub fn regression(points: &Normalised, targets: &Targets, sky: Option<f64>) -> [PixelLoss; 2] {
    [0, 1].map(|view| {
        let (predicted, truth) = points.views[view].clone();
        let target = &targets.views[view];
        let distance = masked(squeeze_last(length(predicted - truth)), target.valid.clone());
        match sky {
            Some(constant) => PixelLoss {
                loss: distance.mask_fill(target.sky.clone(), constant),
                mask: target.valid.clone().bool_or(target.sky.clone()),
            },
            None => PixelLoss { loss: distance, mask: target.valid.clone() },
        }
    })
}
