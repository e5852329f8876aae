//! Norms without a pole and means over masks.

use burn_tensor::{Bool, Tensor};

/// Smallest squared length: the gradient of a root at zero is no number, and the square root of this is below
/// what any loss resolves.
const SMALLEST_SQUARE: f64 = 1e-30;

/// Length of the vectors along the last axis, which stays with size 1.
pub(crate) fn length<const D: usize>(vectors: Tensor<D>) -> Tensor<D> {
    vectors.square().sum_dim(D - 1).clamp_min(SMALLEST_SQUARE).sqrt()
}

/// Drops the last axis, of size 1.
pub(crate) fn squeeze_last(values: Tensor<4>) -> Tensor<3> {
    let [b, h, w, _] = values.dims();
    values.reshape([b, h, w])
}

/// Mean over the pixels of a mask; zero for an empty mask.
pub(crate) fn masked_mean<const D: usize>(values: Tensor<D>, mask: Tensor<D, Bool>) -> Tensor<1> {
    let count = values.zeros_like().mask_fill(mask.clone(), 1.0).sum().clamp_min(1.0);
    masked(values, mask).sum() / count
}

/// The values of a mask, zero elsewhere.
pub(crate) fn masked<const D: usize>(values: Tensor<D>, mask: Tensor<D, Bool>) -> Tensor<D> {
    values.mask_fill(mask.bool_not(), 0.0)
}
