//! `train`: bad input, and what a run keeps of what it was given.

use crate::evaluate::{copy, lines, with_dataset};
use crate::program::{Place, names};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};
use selenograph_network::random;
use selenograph_raster::codec::exr;
use std::path::PathBuf;

/// Twelve steps on three small pairs with everything that has a memory, and a checkpoint after each.
pub const RUN: &str = "train run --weights network.safetensors --settings small.toml --data dataset --val dataset --allow-leak --device cpu";

const SMALL: &str = "[learning]\nepochs = 12.0\nlearning_rate = 1e-3\nfrozen = \"none\"\nclip = 5.0\n\
    average_decay = 0.9\n[learning.checkpoint]\nevery_min = 0.0\n\
    [learning.validation]\nevery_epochs = 4.0\npairs = 2\n\
    [loader]\nbatch_size = 1\nsizes = [[48, 48]]\nnum_matches = 64\n\
    [loader.augmentation]\nwindows = \"matched\"\nroll_share = 0.5\nsuns = \"independent\"\n";

/// A network of some 100 000 parameters.
fn config() -> NetworkConfig {
    let transformer = |dim, num_blocks| Transformer { dim, num_blocks, num_heads: 4, mlp_dim: 4 * dim };
    NetworkConfig {
        patch_px: 16,
        stem_dims: None,
        encoder: transformer(64, 2),
        decoder: transformer(48, 4),
        rope_base: 100.0,
        dpt_dims: [8, 12, 16, 24],
        dpt_fusion_dim: 16,
        dpt_last_dim: 8,
        descriptor_dim: Some(8),
        depth_mode: DepthMode::Exp,
        confidence: ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY },
        descriptor_confidence: Some(ConfidenceMode::Exp { min: 0.0, max: f64::INFINITY }),
    }
}

/// A place with `dataset`, `network.safetensors` and `small.toml`.
pub fn with_network() -> Place {
    let place = with_dataset();
    random::write(&config(), 3, &place.path("network.safetensors"), &mut |_| ()).unwrap();
    place.write("small.toml", SMALL);
    place
}

/// The run is refused, and leaves nothing.
fn refused(place: &Place, line: &str, says: &str, hints: &str) {
    let before = place.names();
    let answer = place.run(&format!("{line} --quiet --out run")).refused(says, hints);
    assert!(answer.stderr.lines().count() == 2, "{}", answer.stderr);
    assert_eq!(place.names(), before, "something was left behind");
}

/// Every file of the dataset that is called `name`.
fn files(place: &Place, name: &str) -> Vec<PathBuf> {
    let pairs = place.path("dataset/pairs/000");
    let found: Vec<PathBuf> = names(&pairs).iter().map(|pair| pairs.join(pair).join(name)).collect();
    assert!(found.iter().all(|path| path.is_file()), "{found:?}");
    found
}

const ONE_STEP: &str =
    "train run --weights network.safetensors --settings small.toml --data dataset --set learning.epochs=0.3";

#[test]
fn a_dataset_without_truth() {
    let place = with_network();
    copy(&place.path("dataset"), &place.path("whole"));
    for name in ["a.depth_z.exr", "b.depth_z.exr"] {
        files(&place, name).iter().for_each(|path| std::fs::remove_file(path).unwrap());
    }
    refused(&place, ONE_STEP, "dataset` holds no depth", "--teacher");
    place.run(&format!("{ONE_STEP} --teacher network.safetensors --out run")).ok();
    // Beside pairs with depth its poses teach the one loss that needs no more.
    let mixed =
        format!("{ONE_STEP} --data whole --set learning.epochs=2 --set learning.loss.epipolar_weight=1.0");
    place.run(&format!("{mixed} --out mixed")).ok();
    let records = lines(&place.path("mixed/metrics.jsonl"));
    let of = |record: &serde_json::Value, term: &str| record["terms"][term].as_f64().unwrap_or(0.0);
    let blind: Vec<_> = records.iter().filter(|record| of(record, "regression_a") == 0.0).collect();
    assert!(!blind.is_empty() && blind.len() < records.len(), "{} of {}", blind.len(), records.len());
    assert!(blind.iter().all(|record| of(record, "epipolar") > 0.0 && of(record, "matching") == 0.0));
}

#[test]
fn depth_that_is_nowhere_a_number() {
    let place = with_network();
    for path in files(&place, "b.depth_z.exr") {
        let mut truth = exr::read(&path).unwrap();
        truth.channels.iter_mut().for_each(|channel| channel.samples.fill(f32::NAN));
        std::fs::write(&path, exr::encode(&truth).unwrap()).unwrap();
    }
    refused(&place, ONE_STEP, "its checksum is not the one in pair.json", "--no-verify");
    let believed = format!("{ONE_STEP} --no-verify");
    refused(&place, &believed, "view b has no pixel with depth", "--skip-faulty");
}

#[test]
fn a_picture_that_is_missing() {
    let place = with_network();
    let path = &files(&place, "b.l1.png")[1];
    std::fs::remove_file(path).unwrap();
    refused(&place, ONE_STEP, "000001/b.l1.png` is missing", "--skip-faulty");
    place.run(&format!("{ONE_STEP} --set learning.epochs=4 --skip-faulty --out run")).ok();
}

#[test]
fn ground_that_is_held_out_is_not_learnt() {
    let place = with_network();
    refused(&place, &format!("{ONE_STEP} --val dataset"), "3 held-out pairs are seen", "--allow-leak");
    place.run(&format!("{ONE_STEP} --val dataset --allow-leak --out run")).ok();
}

#[test]
fn weights_of_another_architecture() {
    let place = with_network();
    let line = |weights: &str| ONE_STEP.replace("network.safetensors", weights);
    let without = NetworkConfig { descriptor_dim: None, descriptor_confidence: None, ..config() };
    random::write(&without, 3, &place.path("dust3r.safetensors"), &mut |_| ()).unwrap();
    refused(&place, &line("dust3r.safetensors"), "without descriptors", "MASt3R family");
    place.write("noise.pth", [7; 300]);
    refused(&place, &line("noise.pth"), "noise.pth", "a checkpoint is what");
    // The tensors of one network under the dimensions of another.
    let wider = NetworkConfig { dpt_fusion_dim: 24, ..config() };
    random::write(&wider, 3, &place.path("wider.safetensors"), &mut |_| ()).unwrap();
    let bytes = std::fs::read(place.path("wider.safetensors")).unwrap();
    let fusion = |dim: usize| format!("\\\"dpt_fusion_dim\\\":{dim}").into_bytes();
    let at = bytes.windows(fusion(24).len()).position(|window| window == fusion(24)).unwrap();
    let claims = [&bytes[..at], &fusion(16), &bytes[at + fusion(24).len()..]].concat();
    place.write("claims.safetensors", claims);
    refused(&place, &line("claims.safetensors"), "claims.safetensors", "weights info");
}

#[test]
fn settings_that_are_none() {
    let place = with_network();
    let with = |more: &str| format!("{ONE_STEP} {more}");
    let key = "unknown field `learning_rat`; did you mean `learning_rate`?";
    refused(&place, &with("--set learning.learning_rat=1"), key, "--dry-run");
    place.write("wrong.toml", "[learning]\nlearning_rat = 1\n");
    let line = ONE_STEP.replace("small.toml", "wrong.toml");
    refused(&place, &line, &format!("wrong.toml: line 2: {key}"), "--dry-run");
    refused(&place, &with("--preset paper"), "preset `paper`: there are paper-iccv2025", "");
    refused(&place, &with("--set learning.epochs"), "no value", "key=value");
    refused(&place, &with("--batch 4"), "`loader.batch_size`", "");
    refused(&place, &with("--for 1ms"), "a time such as 90s", "");
    refused(&place, &with("--for 0.01s"), "the budget of 0.0 s is too short", "a longer `--for`");
}

#[test]
fn memory_that_is_not_there() {
    let place = with_network();
    let many = format!("{ONE_STEP} --batch 1000000 --set loader.pairs_per_epoch=1000000");
    refused(&place, &many, "pairs a batch would fit", "--accumulate");
    let large = format!("{ONE_STEP} --set loader.sizes=[[32768,32768]]");
    refused(&place, &large, "not even one pair fits", "--accumulate");
}

#[test]
fn a_split_divides_what_is_learnt_from_what_is_held_out() {
    let place = with_network();
    let split = r#"{"options": {}, "cell_m": 4000.0, "train": [0, 1], "val": [2], "left_out": []}"#;
    place.write("split.json", split);
    place.run("data export dataset --split split.json --out triplets").ok();
    let own = format!("{ONE_STEP} --split split.json");
    let theirs = ONE_STEP.replace("--data dataset", "--triplets triplets")
        + " --split triplets/train.npz --val-split triplets/val.npz";
    for (line, out) in [(own, "own"), (theirs, "theirs")] {
        // How many depends on the folder: of triplets each light is a pair of its own.
        refused(&place, &line, "held-out pairs are seen while learning", "--allow-leak");
        let answer = place.run(&format!("{line} --allow-leak --out {out}")).ok();
        assert!(answer.stderr.contains("held-out pairs: "), "{}", answer.stderr);
    }
    // What a split of our own holds out is evaluated too.
    let examined = place.path("own/evaluations");
    let found = lines(&examined.join(&names(&examined)[0]).join("metrics.jsonl"));
    assert!(found.len() == 1 && found[0]["pair"] == "000002" && found[0]["method"] == "mast3r", "{found:?}");
    let validation = lines(&place.path("own/metrics.jsonl")).pop().unwrap();
    assert_eq!(validation["values"]["point_error_rel"], found[0]["overlap"]["point_error_rel"]);
    assert!(validation["values"]["no_pose"].is_number() && !place.path("theirs/evaluations").exists());
    refused(
        &place,
        &format!("{ONE_STEP} --data dataset --split split.json"),
        "divides one folder",
        "one --data",
    );
    refused(&place, &format!("{ONE_STEP} --split small.toml"), "is no split", "data split");
}

#[test]
fn what_was_given_is_told_apart_from_what_is_there_later() {
    let place = with_network();
    place.run(&format!("{ONE_STEP} --out run")).ok();
    let kept = std::fs::read_to_string(place.path("run/run.toml")).unwrap();
    let sums: Vec<&str> = kept.lines().skip_while(|line| *line != "[inputs]").skip(1).collect();
    for (line, name) in sums.iter().zip(["campaign.toml", "plan.csv", "run.toml", "network.safetensors"]) {
        let (path, sum) = line.split_once(" = ").unwrap();
        assert!(path.ends_with(&format!("{name}\"")) && sum.len() == 66, "{line}");
    }
    assert!(!place.run("train resume run").ok().stderr.contains("warning"));
    let plan = std::fs::read_to_string(place.path("dataset/plan.csv")).unwrap();
    place.write("dataset/plan.csv", plan + "\n");
    let answer = place.run("train resume run").ok();
    assert!(answer.stderr.contains("plan.csv` is not what the run began with"), "{}", answer.stderr);
    for folder in [".", "dataset"] {
        place.run(&format!("train resume {folder}")).refused("is no run of training", "`train run --out`");
    }
}
