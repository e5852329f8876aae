//! What is written here, and partial checkpoints made of it.

use crate::torch_file::{Tensor, Zip, archive, pickle};
use selenograph_network::checkpoint::{self, ConvertOptions, Storing};
use selenograph_network::layout::{Layout, Part};
use selenograph_network::model_string::Family;
use selenograph_network::safetensors::{Entry, Writer};
use selenograph_network::{Checkpoint, ElementType, Error, NetworkConfig, Preset, Transformer, random};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A network of a few thousand parameters with attention heads of 64 channels.
fn little() -> NetworkConfig {
    let transformer = Transformer { dim: 64, num_blocks: 2, num_heads: 1, mlp_dim: 96 };
    NetworkConfig {
        patch_px: 4,
        encoder: transformer,
        decoder: transformer,
        dpt_dims: [4, 6, 8, 10],
        dpt_fusion_dim: 8,
        dpt_last_dim: 4,
        descriptor_dim: Some(3),
        ..Preset::Tiny.config()
    }
}

fn write_random(dir: &Path, name: &str) -> PathBuf {
    let path = dir.join(name);
    random::write(&little(), 5, &path, &mut |_| {}).unwrap();
    path
}

/// Random weights without our header, with what `keep` leaves of the names and `rename` makes of them.
fn write_plain(path: &Path, rename: impl Fn(&str) -> Option<String>) {
    let layout = Layout::new(&little()).unwrap();
    let kept: Vec<_> = layout.specs().iter().filter_map(|spec| Some((spec, rename(&spec.name)?))).collect();
    let entry = |name: &str, shape: &[usize]| Entry {
        name: name.to_owned(),
        element: ElementType::F32,
        shape: shape.to_vec(),
    };
    let entries = kept.iter().map(|(spec, name)| entry(name, &spec.shape)).collect();
    let mut writer = Writer::create(path, entries, &BTreeMap::new()).unwrap();
    for (spec, _) in kept {
        writer.write(&random::values(spec, 5)).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn random_weights_come_back_with_their_header() {
    let dir = tempfile::tempdir().unwrap();
    let checkpoint = Checkpoint::open(&write_random(dir.path(), "a.safetensors")).unwrap();
    checkpoint.check_complete().unwrap();
    assert_eq!(checkpoint.config(), &little());
    assert!(checkpoint.license().unwrap().contains("CC0"));
    assert!(checkpoint.provenance().unwrap().contains("seed 5"));
    let layout = Layout::new(&little()).unwrap();
    for spec in layout.owned() {
        assert_eq!(checkpoint.read(&spec.name).unwrap(), random::values(spec, 5), "{}", spec.name);
    }
    let alias = "downstream_head1.dpt.scratch.layer_rn.2.weight";
    assert_eq!(
        checkpoint.read(alias).unwrap(),
        checkpoint.read(&alias.replace("layer_rn.2", "layer3_rn")).unwrap()
    );
    let again = write_random(dir.path(), "b.safetensors");
    assert_eq!(
        std::fs::read(checkpoint.path()).unwrap(),
        std::fs::read(again).unwrap(),
        "the same seed, the same file"
    );
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2, "nothing else is left behind");
}

#[test]
fn conversion_keeps_values_and_halves_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let source = Checkpoint::open(&write_random(dir.path(), "a.safetensors")).unwrap();
    let [exact, half] = ["exact", "half"].map(|name| dir.path().join(name));
    source.convert(&exact, &ConvertOptions::default(), &mut |_| {}).unwrap();
    let license = Some("none".to_owned());
    let options = ConvertOptions { storing: Storing::Bf16, license, ..ConvertOptions::default() };
    source.convert(&half, &options, &mut |_| {}).unwrap();
    let told = dir.path().join("told");
    let provenance = Some("a test".to_owned());
    let options = ConvertOptions { provenance, input_px: Some(384), ..ConvertOptions::default() };
    source.convert(&told, &options, &mut |_| {}).unwrap();
    // The same bytes, whether they lie in a file or came with the program.
    let bytes: &'static [u8] = Box::leak(std::fs::read(&told).unwrap().into_boxed_slice());
    for told in [Checkpoint::open(&told).unwrap(), Checkpoint::of_bytes("told", bytes).unwrap()] {
        assert_eq!((told.provenance(), told.input_px()), (Some("a test"), Some(384)));
        assert!(source.names().all(|name| told.read(name).unwrap() == source.read(name).unwrap()));
    }
    let cut = Checkpoint::of_bytes("cut", &bytes[..bytes.len() - 8]);
    assert!(matches!(cut, Err(Error::Truncated { .. })), "{cut:?}");
    let [exact, half] = [exact, half].map(|path| Checkpoint::open(&path).unwrap());
    half.check_complete().unwrap();
    assert_eq!((exact.license(), half.license()), (source.license(), Some("none")));
    assert!(
        half.provenance().unwrap().contains("seed 5") && half.file_bytes() < source.file_bytes() * 6 / 10
    );
    for name in source.names() {
        let (expected, found) = (source.read(name).unwrap(), half.read(name).unwrap());
        assert_eq!(exact.read(name).unwrap(), expected);
        // Eight bits of precision: half a unit in the last place.
        assert!(expected.iter().zip(&found).all(|(e, f)| (e - f).abs() <= e.abs() / 256.0), "{name}");
    }
    let failing = source.convert(Path::new("no/such/folder/x"), &ConvertOptions::default(), &mut |_| {});
    assert!(matches!(failing, Err(Error::Files(_))), "{failing:?}");
}

#[test]
fn dust3r_and_croco_load_the_part_that_they_have() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("dust3r");
    write_plain(&path, |name| (!name.contains("head_local_features")).then(|| name.to_owned()));
    let dust3r = Checkpoint::open(&path).unwrap();
    dust3r.check_complete().unwrap();
    assert_eq!((dust3r.family(), dust3r.config().descriptor_dim), (Family::Dust3r, None));
    assert!(dust3r.notes().iter().any(|note| note.contains("no descriptors")), "{:?}", dust3r.notes());

    let path = dir.path().join("croco");
    write_plain(&path, |name| {
        (!name.contains("head") && !name.starts_with("dec_blocks2")).then(|| name.to_owned())
    });
    let croco = Checkpoint::open(&path).unwrap();
    let complete: Vec<Part> = croco.fit().complete_parts().collect();
    assert_eq!(croco.family(), Family::Croco);
    assert!(complete.contains(&Part::Encoder) && complete.contains(&Part::Decoder2));
    assert!(!complete.contains(&Part::Head1Points));
    assert!(croco.notes().iter().any(|note| note.contains("second starts as its copy")));
    let [first, second] =
        ["dec_blocks.1", "dec_blocks2.1"].map(|b| croco.read(&format!("{b}.mlp.fc1.weight")).unwrap());
    assert_eq!(first, second);
    assert!(matches!(croco.check_complete(), Err(Error::Misfit { .. })));
    let written = dir.path().join("croco-converted");
    croco.convert(&written, &ConvertOptions::default(), &mut |_| {}).unwrap();
    assert_eq!(Checkpoint::open(&written).unwrap().read("dec_blocks2.1.mlp.fc1.weight").unwrap(), first);
}

#[test]
fn faults_are_named_with_expected_and_found() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("faulty");
    write_plain(&path, |name| match name {
        "enc_norm.weight" => None,
        "enc_norm.bias" => Some("prediction_head.bias".into()),
        "mask_token" => Some("enc_norm.weight".into()),
        name => Some(name.into()),
    });
    let checkpoint = Checkpoint::open(&path).unwrap();
    let fit = checkpoint.fit();
    assert_eq!(fit.wrong_shape.len(), 1);
    assert_eq!((&fit.wrong_shape[0].expected, &fit.wrong_shape[0].found), (&vec![64], &vec![1, 1, 64]));
    assert_eq!(fit.extra[0].name, "prediction_head.bias");
    let missing: Vec<(&str, bool)> = fit.missing.iter().map(|m| (m.name.as_str(), m.needed)).collect();
    assert_eq!(missing, [("mask_token", false), ("enc_norm.bias", true)]);
    let error = checkpoint.check_complete().unwrap_err().to_string();
    assert!(
        error.contains("`enc_norm.weight` is [1, 1, 64], expected [64]") && error.contains("`enc_norm.bias`"),
        "{error}"
    );
    assert!(checkpoint.convert(&dir.path().join("x"), &ConvertOptions::default(), &mut |_| {}).is_err());
}

#[test]
fn halves_strides_and_shared_storages_of_a_pth_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let floats: Vec<u8> = (0..64 * 96).flat_map(|i| (i as f32).to_le_bytes()).collect();
    let halves: Vec<u8> = (0..64u16).flat_map(|_| 0x3c00u16.to_le_bytes()).collect();
    let brains: Vec<u8> = (0..64u16).flat_map(|_| 0xbf80u16.to_le_bytes()).collect();
    let storage = |tensor: Tensor| Tensor { storage_len: 64 * 96, ..tensor };
    let tensors = [
        // [96, 64] kept transposed, and its second row alone.
        Tensor {
            strides: vec![1, 96],
            ..Tensor::new("enc_blocks.0.mlp.fc1.weight", "FloatStorage", "w", &[96, 64])
        },
        storage(Tensor {
            offset: 96,
            ..Tensor::new("dec_blocks.0.norm1.weight", "FloatStorage", "w", &[96])
        }),
        Tensor::new("enc_blocks.0.norm1.weight", "HalfStorage", "h", &[64]),
        Tensor::new("enc_blocks.0.norm1.bias", "BFloat16Storage", "b", &[64]),
    ];
    let model = "AsymmetricMASt3R(enc_embed_dim=64, enc_depth=1, enc_num_heads=2, dec_embed_dim=96, dec_depth=1, \
        dec_num_heads=3, output_mode='pts3d+desc24', patch_size=16)";
    let storages = [("w", floats), ("h", halves), ("b", brains)];
    let zip = archive(pickle(Some(model), &tensors), &storages);
    for zip in [zip.clone(), Zip { wide: true, ..zip }] {
        let path = dir.path().join("model.pth");
        std::fs::write(&path, zip.bytes()).unwrap();
        let checkpoint = Checkpoint::open(&path).unwrap();
        let weight = checkpoint.read("enc_blocks.0.mlp.fc1.weight").unwrap();
        assert_eq!((weight[0], weight[1], weight[64], weight[65]), (0.0, 96.0, 1.0, 97.0));
        let row = checkpoint.read("dec_blocks.0.norm1.weight").unwrap();
        assert_eq!((row[0], row[95]), (96.0, 191.0));
        assert_eq!(checkpoint.read("enc_blocks.0.norm1.weight").unwrap(), [1.0; 64]);
        assert_eq!(checkpoint.read("enc_blocks.0.norm1.bias").unwrap(), [-1.0; 64]);
        assert_eq!(checkpoint.tensor("enc_blocks.0.norm1.bias").unwrap().element, ElementType::Bf16);
        assert_eq!(checkpoint.config().decoder.num_heads, 3);
        assert!(matches!(checkpoint.read("nothing"), Err(Error::MissingTensor { .. })));
    }
}

#[test]
fn the_same_name_twice_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let twice = [
        Tensor::new("enc_blocks.0.norm1.weight", "FloatStorage", "0", &[64]),
        Tensor::new("enc_blocks.0.norm1.weight", "FloatStorage", "1", &[64]),
    ];
    let model = "AsymmetricMASt3R(enc_embed_dim=64, enc_depth=1, enc_num_heads=1, dec_embed_dim=64, dec_depth=1, \
        dec_num_heads=1, output_mode='pts3d+desc24', patch_size=16)";
    let path = dir.path().join("model.pth");
    let zip = archive(pickle(Some(model), &twice), &[("0", vec![0; 256]), ("1", vec![0; 256])]);
    std::fs::write(&path, zip.bytes()).unwrap();
    let checkpoint = Checkpoint::open(&path).unwrap();
    assert_eq!(checkpoint.fit().duplicated, ["enc_blocks.0.norm1.weight"]);
    assert!(checkpoint.check_complete().unwrap_err().to_string().contains("there twice"));
}

#[test]
fn a_network_with_a_stem_is_read_from_halves_and_its_header() {
    let dir = tempfile::tempdir().unwrap();
    let config = Preset::Hybrid.config();
    let layout = Layout::new(&config).unwrap();
    let value = |idx: usize| [0.5f32, -1.0, 2.0, 0.0][idx % 4];
    let bits = |idx: usize| [0x3800u16, 0xbc00, 0x4000, 0][idx % 4];
    let mut header = serde_json::Map::new();
    header.insert(
        "__metadata__".into(),
        serde_json::to_value(checkpoint::header(&config, Some("none"))).unwrap(),
    );
    let mut data = Vec::new();
    for spec in layout.owned() {
        let start = data.len();
        data.extend((0..spec.len()).flat_map(|idx| bits(idx).to_le_bytes()));
        let tensor =
            serde_json::json!({ "dtype": "F16", "shape": spec.shape, "data_offsets": [start, data.len()] });
        header.insert(spec.name.clone(), tensor);
    }
    let header = serde_json::to_vec(&header).unwrap();
    let path = dir.path().join("hybrid.safetensors");
    std::fs::write(&path, [&(header.len() as u64).to_le_bytes(), header.as_slice(), &data].concat()).unwrap();
    let checkpoint = Checkpoint::open(&path).unwrap();
    checkpoint.check_complete().unwrap();
    assert_eq!((checkpoint.config(), checkpoint.family()), (&config, Family::Mast3r));
    assert!(checkpoint.fit().complete_parts().any(|part| part == Part::Stem));
    for name in ["stem.0.down.weight", "downstream_head2.head_local_features.weight"] {
        assert_eq!(checkpoint.tensor(name).unwrap().element, ElementType::F16);
        let expected: Vec<f32> = (0..layout.get(name).unwrap().len()).map(value).collect();
        assert_eq!(checkpoint.read(name).unwrap(), expected, "{name}");
    }
}

#[test]
fn random_weights_of_a_network_with_a_stem_are_complete() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("hybrid.safetensors");
    random::write(&Preset::Hybrid.config(), 1, &path, &mut |_| {}).unwrap();
    let checkpoint = Checkpoint::open(&path).unwrap();
    checkpoint.check_complete().unwrap();
    assert_eq!(checkpoint.layout().num_parameters(), 6_560_778);
    assert_eq!(checkpoint.config(), &Preset::Hybrid.config());
}
