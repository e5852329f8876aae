//! Directions of the surface.
//!
//! # Source
//! Ours; the angle between normals of point differences as in Wang et al. 2025, "MoGe", section 3.2.

use super::reduce::{length, masked_mean, squeeze_last};
use super::regression::Normalised;
use super::slope::{both, difference};
use crate::batch::Targets;
use burn_tensor::Tensor;

/// Mean over both views of `1 − cos` of the angle between the predicted and the true normal, at pixels that are valid
/// together with the one before in both axes.
pub fn normals(points: &Normalised, targets: &Targets) -> Tensor<1> {
    let [first, second] = [0, 1].map(|view| {
        let (predicted, truth) = points.views[view].clone();
        let cosine = squeeze_last((unit_normals(predicted) * unit_normals(truth)).sum_dim(3));
        let valid = &targets.views[view].valid;
        let [_, h, w] = valid.dims();
        let in_x = both(valid, 2, 1).narrow(1, 1, h - 1);
        let in_y = both(valid, 1, 1).narrow(2, 1, w - 1);
        masked_mean(cosine.neg() + 1.0, in_x.bool_and(in_y))
    });
    (first + second) * 0.5
}

/// Cross products of the steps from the pixels before: B × (H − 1) × (W − 1) × 3, unit.
fn unit_normals(points: Tensor<4>) -> Tensor<4> {
    let [_, h, w, _] = points.dims();
    let in_x = difference(points.clone(), 2, 1).narrow(1, 1, h - 1);
    let in_y = difference(points, 1, 1).narrow(2, 1, w - 1);
    let normal = in_x.cross(in_y, 3);
    normal.clone() / length(normal)
}
