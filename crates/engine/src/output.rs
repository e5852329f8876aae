//! From raw channels to points, confidences and descriptors.

use rayon::prelude::*;
use selenograph_network::config::{ConfidenceMode, DepthMode};

use crate::buffer::with_scratch;
use crate::dpt::MAP_CHANNELS;
use crate::kernel::Simd;
use crate::upsample::Pixels;
use crate::vector::{dot, scale};

/// Pixels of a task.
const TASK_PIXELS: usize = 4096;

/// How raw channels are read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Modes {
    pub points: DepthMode,
    pub confidence: ConfidenceMode,
    /// Confidence of the descriptors, if they have one of their own.
    pub descriptors: Option<ConfidenceMode>,
}

/// What a head says about one view, row-major over its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadOutput {
    /// Rows of pixels.
    pub height_px: usize,
    /// Columns of pixels.
    pub width_px: usize,
    /// Points in the frame of the first view's camera (OpenCV axes): x, y, z per pixel.
    pub points: Vec<f32>,
    /// Confidence of the points.
    pub confidence: Vec<f32>,
    /// Numbers of a descriptor; zero where the network has no descriptor head.
    pub descriptor_dim: usize,
    /// Unit descriptors, one after the other.
    pub descriptors: Vec<f32>,
    /// Confidence of the descriptors; empty where the network has no descriptor head.
    pub descriptor_confidence: Vec<f32>,
}

/// A confidence from a raw channel.
pub(crate) fn confidence(mode: ConfidenceMode, raw: f32) -> f32 {
    match mode {
        ConfidenceMode::Exp { min, max } => {
            let (min, max) = (min as f32, max as f32);
            min + raw.exp().min(max - min)
        }
        ConfidenceMode::Sigmoid { min, max } => {
            let (min, max) = (min as f32, max as f32);
            (max - min) / (1.0 + (-raw).exp()) + min
        }
    }
}

/// A point from three raw channels.
fn point(mode: DepthMode, raw: [f32; 3]) -> [f32; 3] {
    /// Shortest length that gives a direction.
    const MIN_LENGTH: f32 = 1e-8;
    let length = (raw[0] * raw[0] + raw[1] * raw[1] + raw[2] * raw[2]).sqrt();
    let range = match mode {
        DepthMode::Linear => return raw,
        DepthMode::Square => length * length,
        DepthMode::Exp => length.exp_m1(),
    };
    raw.map(|value| value / length.max(MIN_LENGTH) * range)
}

/// A pixel's point and its confidence, from its raw channels.
fn locate(raw: &[f32], modes: &Modes, to: &mut [f32], conf: &mut f32) {
    to.copy_from_slice(&point(modes.points, [raw[0], raw[1], raw[2]]));
    *conf = confidence(modes.confidence, raw[3]);
}

/// Points and their confidence from the map of the dense head.
pub(crate) fn unpack_map(raw: &[f32], modes: &Modes, points: &mut [f32], confidences: &mut [f32]) {
    let tasks = points.par_chunks_mut(3 * TASK_PIXELS).zip(confidences.par_chunks_mut(TASK_PIXELS));
    tasks.zip(raw.par_chunks(MAP_CHANNELS * TASK_PIXELS)).for_each(|((points, confidences), raw)| {
        let pixels = raw.chunks_exact(MAP_CHANNELS).zip(points.chunks_exact_mut(3)).zip(confidences);
        for ((raw, to), conf) in pixels {
            locate(raw, modes, to, conf);
        }
    });
}

/// A pixel's unit descriptor and, where it has one of its own, its confidence, from its raw channels.
fn describe(level: Simd, raw: &[f32], modes: &Modes, to: &mut [f32], conf: &mut f32) {
    let vector = &raw[..to.len()];
    let length = dot(level, vector, vector).sqrt();
    scale(level, vector, 1.0 / length, to);
    if let Some(mode) = modes.descriptors {
        *conf = confidence(mode, raw[to.len()]);
    }
}

/// Descriptors and their confidence from the rows of the descriptor head: for each patch its pixels in
/// order, for each pixel `dim` numbers and, where descriptors have their own, a raw confidence.
pub(crate) fn unpack_descriptors(
    level: Simd,
    raw: &[f32],
    (patch, width, dim): (usize, usize, usize),
    modes: &Modes,
    descriptors: &mut [f32],
    confidences: &mut [f32],
) {
    let channels = dim + usize::from(modes.descriptors.is_some());
    let per_row = width / patch;
    let token_len = patch * patch * channels;
    let rows = descriptors.par_chunks_mut(width * dim).zip(confidences.par_chunks_mut(width));
    rows.enumerate().for_each(|(y, (descriptors, confidences))| {
        let pixels = descriptors.chunks_exact_mut(dim).zip(confidences);
        for (x, (to, conf)) in pixels.enumerate() {
            let token = y / patch * per_row + x / patch;
            let pixel = y % patch * patch + x % patch;
            let from = &raw[token * token_len + pixel * channels..][..channels];
            describe(level, from, modes, to, conf);
        }
    });
}

/// All of a view's output from raw channels at half its size: those of a pixel's point, then those of its descriptor.
pub(crate) fn unpack_halves(level: Simd, halves: &Pixels<'_>, modes: &Modes, output: &mut HeadOutput) {
    let (width, dim) = (2 * halves.width, output.descriptor_dim);
    let located = output.points.chunks_mut(3 * width).zip(output.confidence.chunks_mut(width));
    let described = output.descriptors.chunks_mut((width * dim).max(1));
    let described = described.zip(output.descriptor_confidence.chunks_mut(width)).map(Some);
    let rows: Vec<_> = located.zip(described.chain(std::iter::repeat_with(|| None))).collect();
    rows.into_par_iter().enumerate().for_each(|(y, ((points, confidences), described))| {
        with_scratch(width * halves.channels, |row| {
            halves.enlarged_row(level, y, row);
            let pixels = row.chunks_exact(halves.channels);
            for ((raw, to), conf) in pixels.clone().zip(points.chunks_exact_mut(3)).zip(confidences) {
                locate(raw, modes, to, conf);
            }
            let Some((descriptors, confidences)) = described else { return };
            for ((raw, to), conf) in pixels.zip(descriptors.chunks_exact_mut(dim)).zip(confidences) {
                describe(level, &raw[MAP_CHANNELS..], modes, to, conf);
            }
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidences_stay_between_their_limits() {
        let exp = ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY };
        assert!((confidence(exp, 0.0) - 2.0).abs() < 1e-6);
        assert!((confidence(ConfidenceMode::Exp { min: 1.0, max: 3.0 }, 50.0) - 3.0).abs() < 1e-6);
        let sigmoid = ConfidenceMode::Sigmoid { min: 1.0, max: 3.0 };
        assert!((confidence(sigmoid, 0.0) - 2.0).abs() < 1e-6);
        assert!((confidence(sigmoid, 100.0) - 3.0).abs() < 1e-6);
    }

    #[test]
    fn points_keep_their_direction() {
        let raw = [0.0, 3.0, 4.0];
        assert_eq!(point(DepthMode::Linear, raw), raw);
        assert!((point(DepthMode::Square, raw)[2] - 20.0).abs() < 1e-4);
        assert!((point(DepthMode::Exp, raw)[1] - 0.6 * 5.0_f32.exp_m1()).abs() < 1e-3);
        assert_eq!(point(DepthMode::Exp, [0.0; 3]), [0.0; 3]);
    }
}
