//! The reference's tensors and the small networks' dimensions, for the tests of every crate that is held to them:
//! `#[path = "../../../network/testdata/golden_file.rs"] mod golden_file;`

use safetensors::{Dtype, SafeTensors};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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
        let tensors = SafeTensors::deserialize(&bytes).unwrap().tensors().into_iter();
        Self(tensors.map(|(name, t)| (name, (t.shape().to_vec(), floats(t.dtype(), t.data())))).collect())
    }

    pub fn shape(&self, name: &str) -> &[usize] {
        &self.0[name].0
    }

    pub fn values(&self, name: &str) -> &[f32] {
        &self.0[name].1
    }

    /// The values of one item of a batch.
    pub fn item(&self, name: &str, item: usize) -> &[f32] {
        let (shape, values) = &self.0[name];
        let len = values.len() / shape[0];
        &values[item * len..(item + 1) * len]
    }
}

/// Dimensions of the network in `folder`, from the file beside its weights.
pub fn config(folder: &Path) -> NetworkConfig {
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
        stem_dims: None,
        patch_px: number("patch_size"),
        encoder: transformer("enc"),
        decoder: transformer("dec"),
        rope_base: json["rope_base"].as_f64().unwrap(),
        dpt_dims: dims.try_into().unwrap(),
        dpt_fusion_dim: number("feature_dim"),
        dpt_last_dim: number("last_dim"),
        descriptor_dim: Some(number("desc_dim")),
        depth_mode: DepthMode::Exp,
        confidence: ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY },
        descriptor_confidence: Some(ConfidenceMode::Exp { min: 0.0, max: f64::INFINITY }),
    }
}
