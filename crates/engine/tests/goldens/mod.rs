//! Reading and comparing the reference's tensors.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use safetensors::{Dtype, SafeTensors};
use selenograph_engine::{Engine, HeadOutput, Image, Probe, Simd};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};

/// Largest difference, relative to the largest value of the tensor.
#[derive(Clone, Copy)]
pub struct Tolerance(pub f32);

/// The folder of the goldens, announced as the house wants it.
pub fn root(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        PathBuf::from,
    );
    let golden = shared.join("golden");
    if golden.is_dir() {
        println!("RAN shared-data: {name}");
        Some(golden)
    } else {
        println!("SKIP shared-data: no goldens");
        None
    }
}

/// Tensors by name: shape and values, integers as floats.
pub struct Golden(BTreeMap<String, (Vec<usize>, Vec<f32>)>);

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

fn floats(dtype: Dtype, bytes: &[u8]) -> Vec<f32> {
    match dtype {
        Dtype::F32 => bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        Dtype::I32 => bytes.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b) as f32).collect(),
        Dtype::U8 => bytes.iter().map(|b| f32::from(*b)).collect(),
        other => panic!("no golden holds {other:?}"),
    }
}

impl Golden {
    pub fn open(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        Self(
            file.tensors()
                .into_iter()
                .map(|(name, view)| (name, (view.shape().to_vec(), floats(view.dtype(), view.data()))))
                .collect(),
        )
    }

    pub fn shape(&self, name: &str) -> &[usize] {
        &self.0[name].0
    }

    pub fn values(&self, name: &str) -> &[f32] {
        &self.0[name].1
    }

    /// A batch item's shape and values.
    fn item(&self, name: &str, item: usize) -> (&[usize], &[f32]) {
        let (shape, values) = &self.0[name];
        let len = values.len() / shape[0];
        (&shape[1..], &values[item * len..(item + 1) * len])
    }

    pub fn image(&self, name: &str, item: usize) -> OwnImage {
        let (shape, values) = self.item(name, item);
        OwnImage { height: shape[1], width: shape[2], values: values.to_vec() }
    }

    /// A view of a training batch as it was taken, and whether it is stored transposed.
    pub fn upright_image(&self, view: usize, item: usize) -> (OwnImage, bool) {
        let stored = self.image(&format!("gt{view}.img"), item);
        let shape = self.item(&format!("gt{view}.true_shape"), item).1;
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
        let (_, expected) = self.item(name, item);
        assert_eq!(expected.len(), found.len(), "{name}");
        let top = expected.iter().fold(0.0_f32, |top, v| top.max(v.abs()));
        let differences = expected.iter().zip(found).map(|(a, b)| (a - b).abs());
        let worst =
            differences.fold(0.0_f32, |worst, v| if v.is_nan() { f32::INFINITY } else { worst.max(v) });
        assert!(worst <= tolerance.0 * top, "{name}[{item}]: off by {worst}, largest value {top}");
        worst / top
    }

    /// Compares everything seen that the golden holds, and wants everything that it holds seen.
    pub fn compare_all(&self, seen: &Collected, item: usize, tolerance: Tolerance) -> f32 {
        let mut worst = 0.0_f32;
        for (name, (shape, _)) in &self.0 {
            if ["img", "pos", "out", "swap"].iter().any(|prefix| name.starts_with(prefix)) {
                continue;
            }
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

/// The small networks' dimensions, from the file beside their weights.
fn config(folder: &Path) -> NetworkConfig {
    let text = std::fs::read_to_string(folder.join("config.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let number = |name: &str| usize::try_from(json[name].as_u64().unwrap()).unwrap();
    let transformer = |part: &str| Transformer {
        dim: number(&format!("{part}_dim")),
        num_blocks: number(&format!("{part}_depth")),
        num_heads: number(&format!("{part}_heads")),
        mlp_dim: number("mlp_ratio") * number(&format!("{part}_dim")),
    };
    let dims: Vec<usize> = json["layer_dims"]
        .as_array()
        .unwrap()
        .iter()
        .map(|v| usize::try_from(v.as_u64().unwrap()).unwrap())
        .collect();
    NetworkConfig {
        patch_px: number("patch_size"),
        encoder: transformer("enc"),
        decoder: transformer("dec"),
        rope_base: json["rope_base"].as_f64().unwrap(),
        stem_dims: None,
        dpt_dims: dims.try_into().unwrap(),
        dpt_fusion_dim: number("feature_dim"),
        dpt_last_dim: number("last_dim"),
        descriptor_dim: Some(number("desc_dim")),
        depth_mode: DepthMode::Exp,
        confidence: ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY },
        descriptor_confidence: Some(ConfidenceMode::Exp { min: 0.0, max: f64::INFINITY }),
    }
}

/// A small network with the goldens' weights.
pub fn network(folder: &str, level: Simd) -> Engine {
    let folder = root(&format!("weights {folder}")).unwrap().join(folder);
    let weights = Golden::open(&folder.join("model.safetensors"));
    Engine::with_simd(&config(&folder), level, &mut |name| {
        weights.0.get(name).cloned().ok_or_else(|| format!("no tensor `{name}`").into())
    })
    .unwrap()
}
