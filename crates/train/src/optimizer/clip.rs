//! Length of a gradient, and its limit.

use crate::network::Gradients;
use burn_tensor::Tensor;

/// Length of all gradients as one vector: one value, on their device.
pub fn norm(gradients: &Gradients) -> Option<Tensor<1>> {
    let squares: Vec<_> = gradients.values().map(|gradient| gradient.clone().square().sum()).collect();
    (!squares.is_empty()).then(|| Tensor::cat(squares, 0).sum().sqrt())
}

/// Multiplies every gradient.
pub fn scale(gradients: &mut Gradients, factor: f64) {
    for gradient in gradients.values_mut() {
        gradient.inplace(|gradient| gradient * factor);
    }
}

/// Shortens the gradients to `limit` if `length`, theirs, is beyond it.
pub fn clip(gradients: &mut Gradients, length: f64, limit: f64) {
    if length > limit {
        scale(gradients, limit / length);
    }
}
