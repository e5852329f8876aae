//! How far predicted points leave the plane through their pixel's ray and both cameras.
//!
//! It needs cameras and poses but no depth, so that pairs without truth maps teach too.
//!
//! # Source
//! Ours; the plane is the epipolar plane of Hartley and Zisserman 2004, "Multiple View Geometry", section 9.1.

use super::reduce::{length, masked_mean, squeeze_last};
use crate::batch::ViewOutput;
use burn_tensor::Tensor;

/// Mean over the pixels of both views that have a plane of the sine of the angle, seen from camera A, between the
/// predicted point and that plane. Scale cancels.
pub fn epipolar(output: &[ViewOutput; 2], plane_normals: &[Tensor<4>; 2]) -> Tensor<1> {
    let [first, second] = [0, 1].map(|view| {
        let points = output[view].points.clone();
        let normals = plane_normals[view].clone();
        let exists = squeeze_last(normals.clone().square().sum_dim(3)).greater_elem(0.5);
        let sine = (points.clone() * normals).sum_dim(3).abs() / length(points);
        masked_mean(squeeze_last(sine), exists)
    });
    (first + second) * 0.5
}
