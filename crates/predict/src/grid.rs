//! A head's output on the grid of the full picture.

use rayon::prelude::*;
use selenograph_engine::HeadOutput;
use selenograph_geometry::pixel;
use selenograph_network::config::ConfidenceMode;
use selenograph_network::input::InputTransform;
use selenograph_raster::Raster;
use selenograph_reconstruct::learned::Pointmap;

/// The part of an output that belongs to the picture: without what was padded.
pub(crate) fn without_padding(output: HeadOutput, transform: &InputTransform) -> HeadOutput {
    let [width, height] = transform.kept;
    if [output.width_px, output.height_px] == transform.kept {
        return output;
    }
    let cut = |values: &[f32], channels: usize| -> Vec<f32> {
        let rows = values.chunks_exact((output.width_px * channels).max(1)).take(height);
        rows.flat_map(|row| row[..width * channels].iter().copied()).collect()
    };
    HeadOutput {
        height_px: height,
        width_px: width,
        points: cut(&output.points, 3),
        confidence: cut(&output.confidence, 1),
        descriptor_dim: output.descriptor_dim,
        descriptors: cut(&output.descriptors, output.descriptor_dim),
        descriptor_confidence: cut(&output.descriptor_confidence, usize::from(output.descriptor_dim > 0)),
    }
}

/// A confidence in `[0, 1]`: for `min + exp(x)` it is `exp(x) / (1 + exp(x))`, for a sigmoid the sigmoid. Both grow with the network's
/// own, so that an order stays what it was.
pub(crate) fn unit_confidence(mode: ConfidenceMode, confidence: f32) -> f32 {
    match mode {
        ConfidenceMode::Exp { min, .. } => {
            let above = (confidence - min as f32).max(0.0);
            if above.is_finite() { above / (1.0 + above) } else { 1.0 }
        }
        ConfidenceMode::Sigmoid { min, max } => {
            ((confidence - min as f32) / (max - min) as f32).clamp(0.0, 1.0)
        }
    }
}

/// Points and confidences on the picture's grid, interpolated where it was resized; absent outside what the network saw.
pub(crate) fn pointmap(output: &HeadOutput, transform: &InputTransform, mode: ConfidenceMode) -> Pointmap {
    let [width, height] = transform.source;
    let rows: Vec<(Vec<[f32; 3]>, Vec<f32>)> = (0..height)
        .into_par_iter()
        .map(|y| {
            (0..width)
                .map(|x| {
                    let at = transform.input_from_source(pixel::center_of(x), pixel::center_of(y));
                    match sample(output, at) {
                        Some([px, py, pz, confidence]) => ([px, py, pz], unit_confidence(mode, confidence)),
                        None => ([f32::NAN; 3], 0.0),
                    }
                })
                .unzip()
        })
        .collect();
    let (points, confidence): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    Pointmap {
        points: Raster { width, height, data: points.concat() },
        confidence: Raster { width, height, data: confidence.concat() },
    }
}

/// Bilinear point and confidence at continuous coordinates of the input; between the border and the first centres those of the
/// border's pixels. `None` outside, and where a neighbour that counts is not finite.
fn sample(output: &HeadOutput, at: [f64; 2]) -> Option<[f32; 4]> {
    let sizes = [output.width_px, output.height_px];
    let mut first = [0; 2];
    let mut share = [0.0f32; 2];
    for axis in 0..2 {
        if !(0.0..=sizes[axis] as f64).contains(&at[axis]) {
            return None;
        }
        let position = pixel::sample_position(at[axis]).clamp(0.0, (sizes[axis] - 1) as f64);
        first[axis] = position as usize;
        share[axis] = (position - position.floor()) as f32;
    }
    let mut sum = [0.0f32; 4];
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let weight = [(dx, share[0]), (dy, share[1])]
            .into_iter()
            .map(|(step, share)| if step == 0 { 1.0 - share } else { share })
            .product::<f32>();
        if weight == 0.0 {
            continue;
        }
        let idx = (first[1] + dy) * sizes[0] + first[0] + dx;
        let point = &output.points[3 * idx..3 * idx + 3];
        for (to, value) in sum.iter_mut().zip(point.iter().chain(&output.confidence[idx..=idx])) {
            *to += weight * value;
        }
    }
    sum.iter().all(|value| value.is_finite()).then_some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_network::input::{Border, Rule, SquareCrop};

    /// Points whose x and y are the place in the input where they stand.
    fn output(width_px: usize, height_px: usize) -> HeadOutput {
        let pixels = (0..width_px * height_px).map(|idx| (idx % width_px, idx / width_px));
        HeadOutput {
            height_px,
            width_px,
            points: pixels
                .flat_map(|(x, y)| [pixel::center_of(x) as f32, pixel::center_of(y) as f32, 2.0])
                .collect(),
            confidence: vec![2.0; width_px * height_px],
            descriptor_dim: 0,
            descriptors: Vec::new(),
            descriptor_confidence: Vec::new(),
        }
    }

    const MODE: ConfidenceMode = ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY };

    #[test]
    fn points_come_back_to_the_pixels_they_were_made_from() {
        // Resized to a half and cropped; padded; as it is.
        let published = Rule::Published { size: 64, square: SquareCrop::FourThirds };
        let whole = |max_side| Rule::Whole { max_side, border: Border::Pad };
        for (width, height, rule) in
            [(128, 128, published), (40, 33, whole(None)), (96, 64, whole(Some(48))), (48, 32, whole(None))]
        {
            let transform = InputTransform::new(width, height, rule, 16).unwrap();
            let seen = without_padding(output(transform.input[0], transform.input[1]), &transform);
            let map = pointmap(&seen, &transform, MODE);
            assert_eq!((map.points.width, map.points.height), (width, height));
            let mut absent = 0;
            for y in 0..height {
                for x in 0..width {
                    let [px, py, _] = map.points[(x, y)];
                    if px.is_nan() {
                        absent += 1;
                        assert_eq!(map.confidence[(x, y)], 0.0);
                        continue;
                    }
                    let back = transform.source_from_input(f64::from(px), f64::from(py));
                    let off =
                        [(back[0], x), (back[1], y)].map(|(at, idx)| (at - pixel::center_of(idx)).abs());
                    // Beyond the outermost centres a point stays at them: half a pixel of the input; inside, rounding of f32.
                    let inside = |at: f32, side: usize| at > 0.5 && at < side as f32 - 0.5;
                    let is_inside = inside(px, transform.kept[0]) && inside(py, transform.kept[1]);
                    let scale = transform.source[0] as f64 / transform.resized[0] as f64;
                    let tolerance = if is_inside { 1e-3 } else { 0.5 * scale + 1e-3 };
                    assert!(off[0] < tolerance && off[1] < tolerance, "{width}×{height} {x} {y} {off:?}");
                }
            }
            let lost = (transform.lost_share() * (width * height) as f64).round() as usize;
            assert_eq!(absent, lost, "{width}×{height}");
        }
    }

    #[test]
    fn confidence_is_mapped_monotonically_into_the_unit_interval() {
        let sigmoid = ConfidenceMode::Sigmoid { min: 0.0, max: 4.0 };
        assert_eq!(
            [1.0, 2.0, 3.0, f32::INFINITY].map(|c| unit_confidence(MODE, c)),
            [0.0, 0.5, 2.0 / 3.0, 1.0]
        );
        assert_eq!([0.0, 1.0, 4.0].map(|c| unit_confidence(sigmoid, c)), [0.0, 0.25, 1.0]);
    }
}
