//! Reading and comparing the reference's tensors.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use safetensors::{Dtype, SafeTensors};
use selenograph_model::{Device, Model, Tensor};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};

/// `golden/README.md`: 5e-4, or ten times the reference's own rounding (at most 2.4e-4), relative to a tensor's largest value.
const TOLERANCE: f32 = 5e-4;

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
pub struct Golden(pub BTreeMap<String, (Vec<usize>, Vec<f32>)>);

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
        let tensors = file.tensors().into_iter();
        Self(tensors.map(|(name, t)| (name, (t.shape().to_vec(), floats(t.dtype(), t.data())))).collect())
    }

    pub fn shape(&self, name: &str) -> &[usize] {
        &self.0[name].0
    }

    pub fn values(&self, name: &str) -> &[f32] {
        &self.0[name].1
    }

    /// Panics beyond the tolerance; returns the difference, relative to the largest value.
    pub fn compare<const D: usize>(&self, name: &str, found: &Tensor<D>) -> f32 {
        let (shape, expected) = &self.0[name];
        assert_eq!(shape, &found.dims(), "{name}");
        let found = found.clone().without_autodiff().try_into_vec_as::<f32>().unwrap();
        let top = expected.iter().fold(0.0_f32, |top, v| top.max(v.abs()));
        let differences = expected.iter().zip(&found).map(|(a, b)| (a - b).abs());
        let worst =
            differences.fold(0.0_f32, |worst, v| if v.is_nan() { f32::INFINITY } else { worst.max(v) });
        assert!(worst <= TOLERANCE * top, "{name}: off by {worst}, largest value {top}");
        worst / top
    }

    /// Compares everything seen that the golden holds, and wants everything that it holds seen.
    pub fn compare_all(&self, seen: &Collected) -> f32 {
        let inner = self
            .0
            .keys()
            .filter(|name| !["img", "pos", "out", "swap"].iter().any(|prefix| name.starts_with(prefix)));
        let seen = seen.0.borrow();
        inner.fold(0.0, |worst, name| {
            let (shape, value) = seen.get(name).unwrap_or_else(|| panic!("`{name}` was not seen"));
            assert_eq!(shape, self.shape(name), "{name}");
            let flat =
                Self(BTreeMap::from([(name.clone(), (vec![value.dims()[0]], self.values(name).to_vec()))]));
            worst.max(flat.compare(name, value))
        })
    }
}

/// Intermediates by name.
#[derive(Default)]
pub struct Collected(RefCell<BTreeMap<String, (Vec<usize>, Tensor<1>)>>);

impl Collected {
    /// A probe that puts `suffix` after every name.
    pub fn probe<'a>(&'a self, suffix: &'a str) -> impl Fn(&str, &[usize], Tensor<1>) + 'a {
        move |name, shape, value| {
            self.0.borrow_mut().insert(format!("{name}{suffix}"), (shape.to_vec(), value));
        }
    }

    pub fn len(&self) -> usize {
        self.0.borrow().len()
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
    let dims: Vec<usize> = serde_json::from_value(json["layer_dims"].clone()).unwrap();
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
pub fn network(folder: &Path, device: &Device) -> Model {
    let weights = Golden::open(&folder.join("model.safetensors"));
    Model::new(&config(folder), device, &mut |name| {
        weights.0.get(name).cloned().ok_or_else(|| format!("no tensor `{name}`").into())
    })
    .unwrap()
}
