//! The goldens of the reference network, where they lie beside the repository.

#[path = "../../testdata/golden_file.rs"]
#[allow(dead_code, reason = "every crate takes what it needs")]
mod golden_file;

use golden_file::{Golden, relative_error, root, stated_config, weights, with_extension, with_tensors};
use selenograph_network::checkpoint::{Format, HeadCounts};
use selenograph_network::input::{Filter, InputTransform, Rgb8, Rule, SquareCrop};
use selenograph_network::layout::{Layout, Purpose, TensorSpec};
use selenograph_network::{Checkpoint, Error, NetworkConfig, Preset};
use std::path::{Path, PathBuf};

/// The folders of networks and the heads of each, which cannot be guessed where a head has not 64 channels.
fn networks(root: &Path) -> Vec<(PathBuf, HeadCounts)> {
    let folders = with_extension(root, "json").into_iter().filter(|path| path.ends_with("config.json"));
    folders
        .map(|path| path.parent().unwrap().to_owned())
        .map(|folder| (folder.clone(), heads(&folder)))
        .collect()
}

fn heads(folder: &Path) -> HeadCounts {
    let config = golden_file::config(folder);
    HeadCounts { encoder: Some(config.encoder.num_heads), decoder: Some(config.decoder.num_heads) }
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
    let Some(root) = root("full_shapes.json") else { return };
    let listed: serde_json::Value =
        serde_json::from_slice(&std::fs::read(root.join("full_shapes.json")).unwrap()).unwrap();
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
fn shared_a_pth_is_the_safetensors_beside_it() {
    let Some(root) = root("checkpoints of both formats") else { return };
    let mut num_compared = 0;
    for (folder, heads) in networks(&root) {
        let plain = Checkpoint::open_with(&weights(&folder), heads).unwrap();
        assert_eq!(plain.format(), Format::Safetensors);
        let stated = stated_config(&folder);
        assert_config(plain.config(), &stated);
        let layout = Layout::new(plain.config()).unwrap();
        let num_aliases = layout.specs().iter().filter(|spec| spec.is_alias()).count();
        assert_eq!((plain.fit().num_shared, plain.fit().num_copies), (0, num_aliases));
        assert_complete(&plain);
        for path in with_extension(&folder, "pth") {
            let pth = Checkpoint::open(&path).unwrap();
            assert_eq!(pth.format(), Format::Pytorch);
            assert_eq!(pth.config(), plain.config());
            assert_eq!((pth.fit().num_shared, pth.fit().num_copies), (num_aliases, 0));
            assert_complete(&pth);
            assert_eq!(pth.model_string(), stated["model_string"].as_str());
            assert_eq!(pth.names().count(), layout.specs().len());
            for name in pth.names() {
                assert_eq!(pth.read(name).unwrap(), plain.read(name).unwrap(), "{name}");
            }
            num_compared += 1;
        }
    }
    assert!(num_compared > 0, "no network of the goldens has a .pth");
}

fn assert_complete(checkpoint: &Checkpoint) {
    checkpoint.check_complete().unwrap();
    let fit = checkpoint.fit();
    assert!(fit.missing.is_empty() && fit.extra.is_empty() && fit.wrong_shape.is_empty(), "{fit:?}");
    // Patches, encoder, its norm; embedding, two decoders, their norm; for each view points, descriptors and what they share.
    assert_eq!(fit.complete_parts().count(), 12);
}

#[test]
fn shared_heads_that_cannot_be_known_are_asked_for() {
    /// Channels of a head where a file does not tell.
    const USUAL_HEAD_DIM: usize = 64;
    let Some(root) = root("networks whose heads are not told") else { return };
    for (folder, heads) in networks(&root) {
        let config = golden_file::config(&folder);
        let dims = [config.encoder.dim, config.decoder.dim];
        if dims.iter().all(|dim| dim % USUAL_HEAD_DIM == 0) {
            println!("SKIP shared-data: heads of 64 channels would fit {}", folder.display());
            continue;
        }
        let error = Checkpoint::open(&weights(&folder)).unwrap_err();
        assert!(matches!(error, Error::Unknown { .. }), "{error}");
        assert!(error.to_string().contains("heads"), "{error}");
        assert!(error.hint().unwrap().contains("--encoder-heads"), "{error}");
        Checkpoint::open_with(&weights(&folder), heads).unwrap();
    }
}

#[test]
fn shared_training_checkpoint_gives_its_model_and_names_what_it_lacks() {
    let Some(root) = root("training checkpoints") else { return };
    let inside_networks: Vec<PathBuf> = networks(&root).into_iter().map(|(folder, _)| folder).collect();
    for path in with_extension(&root, "pth") {
        if inside_networks.iter().any(|folder| path.starts_with(folder)) {
            continue;
        }
        let same = path.with_extension("safetensors");
        let expected = Golden::open(&same);
        // The network that it was cut out of: the one with these widths.
        let dims = ["enc_norm.weight", "dec_norm.weight"].map(|name| expected.values(name).len());
        let is_cut_from = |folder: &&PathBuf| {
            let config = golden_file::config(folder);
            [config.encoder.dim, config.decoder.dim] == dims
        };
        let Some(folder) = inside_networks.iter().find(is_cut_from) else {
            println!("SKIP shared-data: the heads of {} are not told", path.display());
            continue;
        };
        let checkpoint = Checkpoint::open_with(&path, heads(folder)).unwrap();
        let notes = checkpoint.notes().join("\n");
        assert!(notes.contains("`optimizer`") && notes.contains("epoch "), "{notes}");
        assert!(checkpoint.names().eq(expected.0.keys().map(String::as_str)));
        assert!(matches!(checkpoint.check_complete(), Err(Error::Misfit { .. })));
        // A few tensors without the encoder's blocks are no network that shapes could tell.
        assert!(Checkpoint::open_with(&same, heads(folder)).is_err());
        for name in expected.0.keys() {
            assert_eq!(relative_error(&checkpoint.read(name).unwrap(), expected.values(name)), 0.0, "{name}");
        }
    }
}

#[test]
fn shared_pictures_become_inputs_within_a_grey_level() {
    let Some(root) = root("pictures and inputs") else { return };
    for file in with_tensors(&root, &["case0.rgb_u8", "case0.out_u8"]) {
        let golden = Golden::open(&file);
        for case in (0..).take_while(|case| golden.has(&format!("case{case}.rgb_u8"))) {
            check_picture(&golden, case);
        }
    }
}

fn check_picture(golden: &Golden, case: usize) {
    let bytes = |name: &str| golden.values(name).iter().map(|v| *v as u8).collect::<Vec<u8>>();
    let (rgb, out) = (format!("case{case}.rgb_u8"), format!("case{case}.out_u8"));
    let &[height, width, _] = golden.shape(&rgb) else { panic!("a picture has three axes") };
    let &[_, out_height, out_width] = golden.shape(&out) else { panic!("an input has three axes") };
    let picture = Rgb8::new(width, height, bytes(&rgb)).unwrap();
    // The longer side of an input is the size that was asked for; a square one of a square picture was to stay so.
    let size = out_width.max(out_height);
    let stays_square = width == height && out_width == out_height;
    let square = if stays_square { SquareCrop::Keep } else { SquareCrop::FourThirds };
    let transform = InputTransform::new(width, height, Rule::Published { size, square }, 16).unwrap();
    let input = transform.apply(&picture).unwrap();
    assert_eq!([out_height, out_width], [input.height(), input.width()], "case {case}");
    let (planes, area) = (bytes(&out), input.width() * input.height());
    let worst = (0..area * 3).map(|i| input.data()[i].abs_diff(planes[i % 3 * area + i / 3])).max().unwrap();
    println!("case {case}: {:?}, worst difference {worst} grey levels", transform.filter);
    // The library rounds each pass to bytes; an input one level off is its own spread between versions.
    assert!(worst <= 1, "case {case}: {worst} grey levels");
    assert_eq!(
        transform.filter == Filter::Lanczos,
        transform.source.iter().max() > transform.resized.iter().max()
    );
}
