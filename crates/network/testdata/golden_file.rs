//! The reference's tensors and the small networks' dimensions, for the tests of every crate that is held to them:
//! `#[path = "../../../network/testdata/golden_file.rs"] mod golden_file;`
//!
//! Files are found by the tensors in them and sizes are the files' own: another folder of the same kind serves as well.

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

/// Every file under a folder, in the order of their paths.
fn files_under(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    entries.into_iter().flat_map(|path| if path.is_dir() { files_under(&path) } else { vec![path] }).collect()
}

/// The files with this extension under a folder, in the order of their paths.
pub fn with_extension(folder: &Path, extension: &str) -> Vec<PathBuf> {
    files_under(folder)
        .into_iter()
        .filter(|path| path.extension().is_some_and(|own| own == extension))
        .collect()
}

/// The files under a folder that hold all of these tensors.
pub fn with_tensors(folder: &Path, names: &[&str]) -> Vec<PathBuf> {
    let holds_all = |path: &PathBuf| {
        let bytes = std::fs::read(path).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        names.iter().all(|name| header.info(name).is_some())
    };
    let found: Vec<PathBuf> = with_extension(folder, "safetensors").into_iter().filter(holds_all).collect();
    if found.is_empty() {
        println!("SKIP shared-data: no file of the goldens holds {names:?}");
    }
    found
}

/// The files with such a pair of images and what a network makes of it; the network's folder is that of the file.
pub fn inference_cases(root: &Path) -> Vec<PathBuf> {
    with_tensors(root, &["img1", "img2", "out1.pts3d"])
}

/// The files with such a training batch and what a network makes of it.
pub fn training_cases(root: &Path) -> Vec<PathBuf> {
    with_tensors(root, &["gt1.img", "gt2.img", "pred1.pts3d"])
}

/// The file with the weights of the network in `folder`.
pub fn weights(folder: &Path) -> PathBuf {
    with_tensors(folder, &["patch_embed.proj.weight", "dec_norm.weight"]).swap_remove(0)
}

/// The number after `key` in what the goldens' README says of a tensor.
pub fn stated(root: &Path, tensor: &str, key: &str) -> Option<f64> {
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap_or_default();
    let lines = readme.lines().filter(|line| line.starts_with(&format!("`{tensor}`")));
    let number = |line: &str| {
        let after = line.split_once(key)?.1;
        after.split(|c: char| !c.is_ascii_digit() && c != '.').next()?.parse().ok()
    };
    let found = lines.filter_map(number).next();
    if found.is_none() {
        println!("SKIP shared-data: the goldens do not say {key:?} of `{tensor}`");
    }
    found
}

/// Largest difference, relative to the largest expected value; infinite where a value is no number.
pub fn relative_error(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0_f32, |max, value| max.max(value.abs()));
    let differences = found.iter().zip(expected).map(|(f, e)| (f - e).abs());
    let worst = differences.fold(0.0_f32, |worst, v| if v.is_nan() { f32::INFINITY } else { worst.max(v) });
    if worst == 0.0 { 0.0 } else { worst / largest }
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

    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// The names of what an inference case holds between its inputs and its outputs.
    pub fn intermediates(&self) -> impl Iterator<Item = &String> {
        let outer = ["img", "pos", "out", "swap"];
        self.0.keys().filter(move |name| !outer.iter().any(|prefix| name.starts_with(prefix)))
    }

    /// The values of one item of a batch.
    pub fn item(&self, name: &str, item: usize) -> &[f32] {
        let (shape, values) = &self.0[name];
        let len = values.len() / shape[0];
        &values[item * len..(item + 1) * len]
    }
}

/// What the file beside a network's weights says.
pub fn stated_config(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(folder.join("config.json")).unwrap()).unwrap()
}

/// Dimensions of the network in `folder`.
pub fn config(folder: &Path) -> NetworkConfig {
    let json = stated_config(folder);
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
