//! Relief at several scales: differences of local height between pixels, in metres per metre of ground.
//!
//! A pointmap can be right in the mean and useless as terrain; what a lander asks for is the slope over its own length.
//!
//! # Source
//! Ours; the multi-scale differences follow Li and Snavely 2018, "MegaDepth", section 4.1.

use super::reduce::{length, masked_mean, squeeze_last};
use super::regression::Normalised;
use crate::batch::Targets;
use burn_tensor::{Bool, Tensor};

/// Distances of the pixels compared, in pixels.
const STRIDES_PX: [usize; 4] = [1, 2, 4, 8];
/// Shortest distance on the ground, metres: pixels without truth have none.
const SHORTEST_M: f64 = 1e-6;

/// Mean over strides, axes and views of `|Δh − Δh_truth| / |Δp_truth|` at valid pixels, `h` being the metres along the
/// local vertical and `p` the point; zero for pairs whose vertical is unknown. The prediction is brought into metres by
/// the normaliser of the regression.
pub fn slope(points: &Normalised, targets: &Targets) -> Tensor<1> {
    let [b, _] = targets.up.dims();
    let up = targets.up.clone().reshape([b, 1, 1, 3]);
    let mut terms = Vec::new();
    for view in 0..2 {
        let (predicted, truth) = points.views[view].clone();
        let [predicted, truth] = [predicted, truth].map(|unit| unit * points.truth_scale_m.clone());
        let error_m = squeeze_last(((predicted - truth.clone()) * up.clone()).sum_dim(3));
        let known = known_vertical(&up, &targets.views[view].valid);
        for axis in [1, 2] {
            for stride in STRIDES_PX.into_iter().filter(|stride| 2 * stride <= known.dims()[axis]) {
                let ground_m = squeeze_last(length(difference(truth.clone(), axis, stride)));
                let error = difference(error_m.clone(), axis, stride).abs() / ground_m.clamp_min(SHORTEST_M);
                terms.push(masked_mean(error, both(&known, axis, stride)));
            }
        }
    }
    let count = terms.len().max(1);
    Tensor::cat(terms, 0).sum() / count as f64
}

fn known_vertical(up: &Tensor<4>, valid: &Tensor<3, Bool>) -> Tensor<3, Bool> {
    let [b, h, w] = valid.dims();
    let known = up.clone().square().sum_dim(3).greater_elem(0.5).reshape([b, 1, 1]);
    known.expand([b, h, w]).bool_and(valid.clone())
}

/// Value minus the value `stride` pixels before along `axis`.
pub(super) fn difference<const D: usize>(values: Tensor<D>, axis: usize, stride: usize) -> Tensor<D> {
    let len = values.dims()[axis] - stride;
    values.clone().narrow(axis, stride, len) - values.narrow(axis, 0, len)
}

/// Pixels that are valid and whose neighbour `stride` pixels before along `axis` is.
pub(super) fn both(valid: &Tensor<3, Bool>, axis: usize, stride: usize) -> Tensor<3, Bool> {
    let len = valid.dims()[axis] - stride;
    valid.clone().narrow(axis, stride, len).bool_and(valid.clone().narrow(axis, 0, len))
}
