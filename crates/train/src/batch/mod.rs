//! What goes into a network and into a loss, on a device.

mod host;

pub use host::{AssemblySettings, HostBatch};

use burn_tensor::{Bool, Int, Tensor};
use std::borrow::Cow;

/// The pictures of P pairs in host memory, A and B of each pair in turn, stored landscape: those of portrait format with
/// rows and columns exchanged.
#[derive(Debug, Clone, Default)]
pub struct PairImages {
    /// Rows and columns as stored.
    pub size: [usize; 2],
    /// Values −1 … 1: 2P × 3 × H × W.
    pub values: Vec<f32>,
    /// For each picture whether it is of portrait format: 2P.
    pub portrait: Vec<bool>,
}

impl PairImages {
    /// The values of one picture as stored: 3 × H × W.
    pub fn picture(&self, place: usize) -> &[f32] {
        let len = 3 * self.size[0] * self.size[1];
        &self.values[place * len..][..len]
    }

    /// Rows, columns and values of one picture as it was taken.
    pub fn upright(&self, place: usize) -> ([usize; 2], Cow<'_, [f32]>) {
        let ([rows, columns], stored) = (self.size, self.picture(place));
        if !self.portrait[place] {
            return (self.size, stored.into());
        }
        let plane = |channel: &[f32]| -> Vec<f32> {
            (0..columns * rows).map(|idx| channel[idx % rows * columns + idx / rows]).collect()
        };
        ([columns, rows], stored.chunks(rows * columns).flat_map(plane).collect())
    }

    /// The pictures at these places.
    #[must_use]
    pub fn select(&self, places: &[usize]) -> Self {
        Self {
            size: self.size,
            values: places.iter().flat_map(|place| self.picture(*place)).copied().collect(),
            portrait: places.iter().map(|place| self.portrait[*place]).collect(),
        }
    }
}

/// What a network says about one view of B pairs of H × W pixels, stored as the pictures are.
#[derive(Debug, Clone)]
pub struct ViewOutput {
    /// Points in the frame of camera A, in the network's own scale: B × H × W × 3.
    pub points: Tensor<4>,
    /// Confidence of the points: B × H × W, above zero.
    pub confidence: Tensor<3>,
    /// Unit descriptors: B × H × W × C.
    pub descriptors: Tensor<4>,
    /// Confidence of the descriptors: B × H × W, above zero.
    pub descriptor_confidence: Tensor<3>,
}

/// The truth of one view of B pairs.
#[derive(Debug, Clone)]
pub struct ViewTarget {
    /// Points in the frame of camera A, metres: B × H × W × 3; anything finite where there is no truth.
    pub points: Tensor<4>,
    /// Pixels whose point is known: B × H × W.
    pub valid: Tensor<3, Bool>,
    /// Pixels that show the sky, none of them valid: B × H × W.
    pub sky: Tensor<3, Bool>,
}

/// Pixels of the two views that belong together, and pixels that do not.
#[derive(Debug, Clone)]
pub struct Matches {
    /// Per view `y · W + x`: B × n.
    pub pixels: [Tensor<2, Int>; 2],
    /// True for a match, false for a pair of pixels that only serve as negatives: B × n.
    pub valid: Tensor<2, Bool>,
}

/// The truth of B pairs. What a source does not know it marks, and the losses that need it pass over it.
#[derive(Debug, Clone)]
pub struct Targets {
    /// Views A and B.
    pub views: [ViewTarget; 2],
    /// Pairs whose predictions shall be in metres: B.
    pub metric: Tensor<1, Bool>,
    /// Correspondences, if the source has any.
    pub matches: Option<Matches>,
    /// The local vertical in the frame of camera A: B × 3, unit; zero where unknown.
    pub up: Tensor<2>,
    /// For each pixel of each view the unit normal, in the frame of camera A, of the plane through its ray and both
    /// cameras: B × H × W × 3; zero where there is none.
    pub epipolar_normals: Option<[Tensor<4>; 2]>,
}

impl Targets {
    /// Puts another network's points in the place of the truth, where its confidence reaches `min_confidence`. What the
    /// truth knew besides (matches, vertical, epipolar planes) stays.
    #[must_use]
    pub(crate) fn taught_by(mut self, teacher: &[ViewOutput; 2], min_confidence: f64) -> Self {
        for (target, taught) in self.views.iter_mut().zip(teacher) {
            target.points = taught.points.clone().without_autodiff();
            target.valid = taught.confidence.clone().without_autodiff().greater_equal_elem(min_confidence);
            target.sky = target.sky.clone().bool_and(target.valid.clone().bool_not());
        }
        self
    }
}
