//! The goldens of the reference network, where they lie beside the repository.

use selenograph_network::checkpoint::{Format, HeadCounts};
use selenograph_network::input::{Filter, Plan, Rgb8, Rule, SquareCrop};
use selenograph_network::layout::{Layout, Purpose, TensorSpec};
use selenograph_network::{Checkpoint, Error, NetworkConfig, Preset};
use std::path::{Path, PathBuf};

/// Heads of the golden networks, whose head widths (12, 8, 16 channels) cannot be guessed.
const TINY: HeadCounts = HeadCounts { encoder: Some(4), decoder: Some(4) };
const MEDIUM: HeadCounts = HeadCounts { encoder: Some(4), decoder: Some(2) };

fn golden(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        PathBuf::from,
    );
    let path = root.join("golden").join(name);
    if path.exists() {
        println!("RAN shared-data: {name}");
        Some(path)
    } else {
        println!("SKIP shared-data: {name} is not there");
        None
    }
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// What a golden's `config.json` says, compared with what was deduced.
fn assert_config(config: &NetworkConfig, stated: &serde_json::Value) {
    let number = |key: &str| stated[key].as_u64().unwrap() as usize;
    assert_eq!(config.encoder.dim, number("enc_dim"));
    assert_eq!(config.encoder.num_blocks, number("enc_depth"));
    assert_eq!(config.encoder.num_heads, number("enc_heads"));
    assert_eq!(config.decoder.dim, number("dec_dim"));
    assert_eq!(config.decoder.num_blocks, number("dec_depth"));
    assert_eq!(config.decoder.num_heads, number("dec_heads"));
    assert_eq!(config.descriptor_dim, Some(number("desc_dim")));
    assert_eq!(config.dpt_fusion_dim, number("feature_dim"));
    assert_eq!(config.dpt_last_dim, number("last_dim"));
    assert_eq!(config.descriptor_hidden_dim(), number("mlp_hidden_local"));
    assert_eq!(config.patch_px, number("patch_size"));
    assert_eq!(serde_json::json!(config.dpt_dims), stated["layer_dims"]);
    assert_eq!(serde_json::json!(config.hooks()), stated["hooks"]);
    let layout = Layout::new(config).unwrap();
    assert_eq!(layout.num_parameters(), number("unique_params"));
    assert_eq!(layout.specs().len(), number("state_dict_entries"));
}

#[test]
fn shared_full_layout_is_that_of_the_reference() {
    let Some(path) = golden("full_shapes.json") else { return };
    let listed = json(&path);
    let listed = listed.as_object().unwrap();
    let layout = Layout::new(&Preset::Mast3rVitl.config()).unwrap();
    assert_eq!(layout.specs().len(), listed.len());
    for spec in layout.specs() {
        assert_eq!(listed.get(&spec.name), Some(&serde_json::json!(spec.shape)), "{}", spec.name);
    }
    assert_eq!(layout.num_parameters(), 688_638_856);
    assert_eq!(layout.specs().iter().map(TensorSpec::len).sum::<usize>(), 695_274_376);
    let aliases = layout.specs().iter().filter(|spec| spec.is_alias());
    assert_eq!(aliases.count(), 8);
    let unused: Vec<&str> =
        layout.specs().iter().filter(|s| s.purpose == Purpose::Unused).map(|s| s.name.as_str()).collect();
    assert_eq!(unused.len(), 1 + 2 * 4, "{unused:?}");
}

#[test]
fn shared_tiny_pth_is_the_tiny_safetensors() {
    let (Some(pth), Some(plain)) = (golden("tiny/model.pth"), golden("tiny/model.safetensors")) else {
        return;
    };
    let (pth, plain) = (Checkpoint::open(&pth).unwrap(), Checkpoint::open_with(&plain, TINY).unwrap());
    assert_eq!((pth.format(), plain.format()), (Format::Pytorch, Format::Safetensors));
    assert_eq!(pth.config(), plain.config());
    assert_config(pth.config(), &json(&golden("tiny/config.json").unwrap()));
    for checkpoint in [&pth, &plain] {
        checkpoint.check_complete().unwrap();
        let fit = checkpoint.fit();
        assert!(fit.missing.is_empty() && fit.extra.is_empty() && fit.wrong_shape.is_empty(), "{fit:?}");
        assert_eq!(fit.complete_parts().count(), 12);
    }
    assert_eq!((pth.fit().num_shared, pth.fit().num_copies), (8, 0));
    assert_eq!((plain.fit().num_shared, plain.fit().num_copies), (0, 8));
    assert!(pth.model_string().unwrap().contains("pts3d+desc3"));
    assert_eq!(pth.names().count(), 393);
    for name in pth.names() {
        assert_eq!(pth.read(name).unwrap(), plain.read(name).unwrap(), "{name}");
    }
}

#[test]
fn shared_heads_that_cannot_be_known_are_asked_for() {
    let Some(path) = golden("medium/model.safetensors") else { return };
    let error = Checkpoint::open(&path).unwrap_err();
    assert!(matches!(error, Error::Unknown { .. }), "{error}");
    assert!(error.to_string().contains("heads") && error.hint().unwrap().contains("--encoder-heads"));
    let medium = Checkpoint::open_with(&path, MEDIUM).unwrap();
    medium.check_complete().unwrap();
    assert_config(medium.config(), &json(&golden("medium/config.json").unwrap()));
}

#[test]
fn shared_training_checkpoint_gives_its_model_and_names_what_it_lacks() {
    let Some(path) = golden("mini_train_checkpoint.pth") else { return };
    let expected = golden("mini_train_checkpoint.safetensors").unwrap();
    let expected = Checkpoint::open_with(&expected, TINY);
    let checkpoint = Checkpoint::open_with(&path, TINY).unwrap();
    let notes = checkpoint.notes().join("\n");
    assert!(notes.contains("`optimizer`") && notes.contains("epoch 4"), "{notes}");
    assert_eq!(checkpoint.names().count(), 5);
    assert!(matches!(checkpoint.check_complete(), Err(Error::Misfit { .. })));
    // Five tensors without the encoder's blocks are no network that shapes could tell.
    assert!(expected.is_err());
    assert_eq!(checkpoint.read("decoder_embed.weight").unwrap().len(), 32 * 48);
}

#[test]
fn shared_pictures_become_inputs_within_a_grey_level() {
    let Some(path) = golden("preprocess.safetensors") else { return };
    let tensors = Tensors::read(&path);
    let sizes = [64, 64, 64, 64, 64, 64, 112, 512, 224];
    for (case, size) in sizes.into_iter().enumerate() {
        let (shape, data) = tensors.bytes(&format!("case{case}.rgb_u8"));
        let picture = Rgb8::new(shape[1], shape[0], data.to_vec()).unwrap();
        let square = if case == 3 { SquareCrop::Keep } else { SquareCrop::FourThirds };
        let plan = Plan::new(shape[1], shape[0], Rule::Published { size, square }, 16).unwrap();
        let input = plan.apply(&picture).unwrap();
        let (shape, planes) = tensors.bytes(&format!("case{case}.out_u8"));
        assert_eq!([3, input.height(), input.width()], shape[..], "case {case}");
        let area = input.width() * input.height();
        let worst =
            (0..area * 3).map(|i| input.data()[i].abs_diff(planes[i % 3 * area + i / 3])).max().unwrap();
        println!("case {case}: {:?}, worst difference {worst} grey levels", plan.filter);
        // The library rounds each pass to bytes; an input one level off is its own spread between versions.
        assert!(worst <= 1, "case {case}: {worst} grey levels");
        assert_eq!(plan.filter == Filter::Lanczos, plan.source.iter().max() > plan.resized.iter().max());
    }
}

/// Bytes of the tensors of a golden file, read without the code under test.
struct Tensors {
    header: serde_json::Value,
    data: Vec<u8>,
}

impl Tensors {
    fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let len = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        Self { header: serde_json::from_slice(&bytes[8..8 + len]).unwrap(), data: bytes[8 + len..].to_vec() }
    }

    fn bytes(&self, name: &str) -> (Vec<usize>, &[u8]) {
        let tensor = &self.header[name];
        let shape = serde_json::from_value(tensor["shape"].clone()).unwrap();
        let [start, end]: [usize; 2] = serde_json::from_value(tensor["data_offsets"].clone()).unwrap();
        (shape, &self.data[start..end])
    }
}
