//! Reading and comparing the reference's tensors.

#[path = "../../../network/testdata/golden_file.rs"]
mod golden_file;

pub use golden_file::{Golden, inference_cases, root, stated, training_cases, with_tensors};

use selenograph_engine::{Engine, HeadOutput, Image, Probe, Simd};
use std::collections::BTreeMap;
use std::path::Path;

/// Largest difference, relative to the largest value of the tensor.
#[derive(Clone, Copy)]
pub struct Tolerance(pub f32);

/// An image of its own.
pub struct OwnImage {
    pub height: usize,
    pub width: usize,
    pub values: Vec<f32>,
}

impl OwnImage {
    pub fn borrowed(&self) -> Image<'_> {
        Image { height_px: self.height, width_px: self.width, values: &self.values }
    }
}

impl Golden {
    pub fn image(&self, name: &str, item: usize) -> OwnImage {
        let shape = self.shape(name);
        OwnImage { height: shape[2], width: shape[3], values: self.item(name, item).to_vec() }
    }

    /// A view of a training batch as it was taken, and whether it is stored transposed.
    pub fn upright_image(&self, view: usize, item: usize) -> (OwnImage, bool) {
        let stored = self.image(&format!("gt{view}.img"), item);
        let shape = self.item(&format!("gt{view}.true_shape"), item);
        if shape[0] <= shape[1] {
            return (stored, false);
        }
        let (height, width) = (stored.width, stored.height);
        let values = (0..3 * height * width)
            .map(|idx| {
                let (plane, y, x) = (idx / (height * width), idx / width % height, idx % width);
                stored.values[(plane * width + x) * height + y]
            })
            .collect();
        (OwnImage { height, width, values }, true)
    }

    /// Panics beyond the tolerance; returns the difference.
    pub fn compare(&self, name: &str, item: usize, found: &[f32], tolerance: Tolerance) -> f32 {
        let error = golden_file::relative_error(found, self.item(name, item));
        assert!(error <= tolerance.0, "{name}[{item}]: off by {error} of the largest value");
        error
    }

    /// Compares everything seen that the golden holds, and wants everything that it holds seen.
    pub fn compare_all(&self, seen: &Collected, item: usize, tolerance: Tolerance) -> f32 {
        let mut worst = 0.0_f32;
        for name in self.intermediates() {
            let shape = self.shape(name);
            let (own_shape, own) = seen.0.get(name).unwrap_or_else(|| panic!("`{name}` was not seen"));
            let own = if name.ends_with("mlp_out") {
                channels_first(&own_shape[..1], own, (shape[2] / 256, 256))
            } else if name.starts_with("head") {
                assert_eq!(own_shape[..2], shape[2..], "{name}");
                channels_first(&[], own, (own_shape[2], own_shape[0] * own_shape[1]))
            } else {
                own.clone()
            };
            worst = worst.max(self.compare(name, item, &own, tolerance));
        }
        worst
    }
}

/// Swaps the last two of `[outer, pixels, channels]`.
fn channels_first(outer: &[usize], values: &[f32], (channels, pixels): (usize, usize)) -> Vec<f32> {
    let count: usize = outer.iter().product();
    assert_eq!(values.len(), count * channels * pixels);
    (0..values.len())
        .map(|idx| {
            let (block, c, p) = (idx / (channels * pixels), idx / pixels % channels, idx % pixels);
            values[block * channels * pixels + p * channels + c]
        })
        .collect()
}

/// A head's output as training stores it: transposed for portrait views.
pub fn stored(output: &HeadOutput, transposed: bool) -> HeadOutput {
    if !transposed {
        return output.clone();
    }
    let (height, width) = (output.height_px, output.width_px);
    let swap = |values: &[f32], channels: usize| -> Vec<f32> {
        (0..values.len())
            .map(|idx| {
                let (x, y, c) = (idx / channels / height, idx / channels % height, idx % channels);
                values[(y * width + x) * channels + c]
            })
            .collect()
    };
    HeadOutput {
        height_px: width,
        width_px: height,
        points: swap(&output.points, 3),
        confidence: swap(&output.confidence, 1),
        descriptor_dim: output.descriptor_dim,
        descriptors: swap(&output.descriptors, output.descriptor_dim),
        descriptor_confidence: swap(&output.descriptor_confidence, 1),
    }
}

/// Intermediates by name.
#[derive(Default)]
pub struct Collected(BTreeMap<String, (Vec<usize>, Vec<f32>)>);

impl Probe for Collected {
    fn see(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}");
        self.0.insert(name.to_owned(), (shape.to_vec(), values.to_vec()));
    }
}

impl Collected {
    /// Takes what was seen of one view under the goldens' names.
    pub fn adopt(&mut self, other: Self, view: usize) {
        self.0.extend(other.0.into_iter().map(|(name, value)| (format!("{name}.{view}"), value)));
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// The network with the goldens' weights in `folder`.
pub fn network(folder: &Path, level: Simd) -> Engine {
    let weights = Golden::open(&golden_file::weights(folder));
    Engine::with_simd(&golden_file::config(folder), level, &mut |name| {
        weights.0.get(name).cloned().ok_or_else(|| format!("no tensor `{name}`").into())
    })
    .unwrap()
}
