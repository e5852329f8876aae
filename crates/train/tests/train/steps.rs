//! Whole training steps of the reference's tiny network: many-aspect batches, each pair both ways.

use crate::goldens::{Golden, relative_error, root, values};
use burn_tensor::Device;
use selenograph_dataset::rng::rng;
use selenograph_model::{Keep, Model};
use selenograph_network::Checkpoint;
use selenograph_train::batch::{AssemblySettings, HostBatch};
use selenograph_train::loss::{LossSettings, training_loss};
use selenograph_train::network::PairNetwork;
use selenograph_train::optimizer::{AdamW, AdamWSettings, Schedule, decays, norm};
use selenograph_train::{Frozen, ModelNetwork};
use std::path::Path;

/// Relative to the largest value of the tensor: the README of the goldens.
const OUTPUT_TOLERANCE: f32 = 5e-4;
/// The same for the gradient of a whole network; losses of it inherit the outputs' tolerance.
const GRADIENT_TOLERANCE: f32 = 1e-3;
/// Of a parameter after a step, in learning rates. Adam's first step moves every value by the learning rate whatever the
/// size of its gradient, so that rounding decides the sign of those that are all but zero: a share of them may differ.
const STEP_TOLERANCE: f32 = 0.05;
const SIGN_SHARE: f32 = 0.01;

fn network(folder: &Path, frozen: Frozen, keep: Keep) -> ModelNetwork {
    let checkpoint = Checkpoint::open(&folder.join("model.pth")).unwrap();
    let mut read = |name: &str| Ok(checkpoint.read_with_shape(name)?);
    let model = Model::new(checkpoint.config(), &Device::flex(), &mut read).unwrap();
    ModelNetwork::new(model, frozen, keep, None, "goldens")
}

fn host_batch(golden: &Golden) -> HostBatch {
    let settings = AssemblySettings { match_block: 8192, epipolar: false };
    let mut stream = rng(0, "test", 0, "matches");
    let mut batch = HostBatch::assemble(&golden.pairs(golden), &settings, &mut stream).unwrap();
    // The reference's pictures are no bytes: ours are those but for their rounding.
    let pixels = batch.images.values.len() / 4;
    for (slot, image) in batch.images.values.chunks_mut(pixels).enumerate() {
        let theirs = golden.item(&format!("gt{}.img", slot % 2 + 1), slot / 2);
        assert!(image.iter().zip(theirs).all(|(a, b)| (a - b.clamp(-1.0, 1.0)).abs() < 0.5 / 127.0));
        image.copy_from_slice(theirs);
    }
    batch
}

#[test]
fn shared_two_training_steps() {
    let Some(root) = root("golden tiny/train") else { return };
    let folder = root.join("tiny");
    let golden = Golden::open(&folder.join("train.safetensors"));
    let meta: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("train_meta.json")).unwrap()).unwrap();
    let names = |key: &str| -> Vec<String> { serde_json::from_value(meta[key].clone()).unwrap() };
    let batch = host_batch(&golden);
    let targets = batch.targets(&Device::flex());
    for keep in [Keep::Everything, Keep::BlockInputs] {
        let mut network = network(&folder, Frozen::None, keep);
        check_groups(&network, &names("decay"), &names("no_decay"));
        let output = network.forward(&batch.images).unwrap();
        for (view, output) in output.iter().enumerate() {
            let points = if view == 0 { "pts3d" } else { "pts3d_in_other_view" };
            for (name, found) in [
                (points, values(&output.points)),
                ("conf", values(&output.confidence)),
                ("desc", values(&output.descriptors)),
                ("desc_conf", values(&output.descriptor_confidence)),
            ] {
                let name = format!("pred{}.{name}", view + 1);
                let error = relative_error(&found, golden.values(&name));
                assert!(error <= OUTPUT_TOLERANCE, "{name}: {error:.1e}");
            }
        }
        let mut optimizer = AdamW::new(AdamWSettings::default());
        for step in 0..2 {
            let mut total = f32::NAN;
            let gradients = network
                .learn(&batch.images, &mut |output| {
                    let loss = training_loss(output, &targets, &LossSettings::default());
                    total = values(&loss.total)[0];
                    Ok(loss.total)
                })
                .unwrap();
            let expected = golden.scalar(&format!("step{step}.loss"));
            let error = (total - expected).abs() / expected;
            println!("{keep:?} step {step}: loss {total}, error {error:.1e}");
            assert!(error <= OUTPUT_TOLERANCE, "step {step}: {total} instead of {expected}");
            if step == 0 {
                check_norms(&golden, &gradients, &names("param_names"));
            }
            optimizer.step(&mut network, gradients, 1e-3).unwrap();
            check_parameters(&golden, step + 1, &network, &names("selected"));
        }
    }
}

fn check_groups(network: &ModelNetwork, decay: &[String], no_decay: &[String]) {
    network.visit(&mut |name, shape, _| {
        let group = if decays(name, shape) { decay } else { no_decay };
        assert!(group.iter().any(|other| other == name), "{name}");
    });
}

fn check_norms(golden: &Golden, gradients: &selenograph_train::network::Gradients, names: &[String]) {
    let largest = golden.values("grad_norms").iter().fold(0.0f32, |max, norm| max.max(*norm));
    let mut worst = 0.0f32;
    for (name, expected) in names.iter().zip(golden.values("grad_norms")) {
        let Some(gradient) = gradients.get(name) else {
            assert_eq!(*expected, -1.0, "{name} has no gradient");
            continue;
        };
        let found = values(&gradient.clone().square().sum().sqrt())[0];
        // Norms of tensors that nearly cancel are as rough as the largest ones' rounding.
        let error = (found - expected).abs() / expected.max(1e-3 * largest);
        worst = worst.max(error);
        assert!(error <= GRADIENT_TOLERANCE, "{name}: {found} instead of {expected}");
    }
    let total = values(&norm(gradients).unwrap())[0];
    let expected = golden.scalar("grad_norm_total");
    assert!((total - expected).abs() <= GRADIENT_TOLERANCE * expected, "{total} instead of {expected}");
    println!("gradient norms: worst {worst:.1e}");
}

fn check_parameters(golden: &Golden, step: usize, network: &ModelNetwork, selected: &[String]) {
    let mut num_seen = 0;
    network.visit(&mut |name, _, value| {
        if !selected.iter().any(|other| other == name) {
            return;
        }
        num_seen += 1;
        let expected = golden.values(&format!("after_step{step}.{name}"));
        let found = values(&value);
        let off = found.iter().zip(expected).filter(|(f, e)| (*f - *e).abs() > STEP_TOLERANCE * 1e-3).count();
        let share = off as f32 / found.len() as f32;
        println!("after step {step} {name}: {off} of {} values off", found.len());
        assert!(share <= SIGN_SHARE, "{name} after step {step}: {off} of {} values are off", found.len());
    });
    assert_eq!(num_seen, selected.len());
}

#[test]
fn shared_a_frozen_encoder_lets_its_norm_learn() {
    let Some(root) = root("golden tiny/train, frozen") else { return };
    let folder = root.join("tiny");
    let batch = host_batch(&Golden::open(&folder.join("train.safetensors")));
    let network = network(&folder, Frozen::Encoder, Keep::Everything);
    let targets = batch.targets(&Device::flex());
    let gradients = network
        .learn(&batch.images, &mut |output| {
            Ok(training_loss(output, &targets, &LossSettings::default()).total)
        })
        .unwrap();
    assert!(gradients.contains_key("enc_norm.weight") && gradients.contains_key("decoder_embed.weight"));
    assert!(gradients.keys().all(|name| !name.starts_with("enc_blocks") && !name.starts_with("patch_embed")));
}

#[test]
fn shared_schedule() {
    let Some(root) = root("golden lr_schedule") else { return };
    let text = std::fs::read_to_string(root.join("lr_schedule.json")).unwrap();
    let cases: serde_json::Value = serde_json::from_str(&text).unwrap();
    for case in cases.as_array().unwrap() {
        let of = |key: &str| case["args"][key].as_f64().unwrap();
        let schedule = Schedule {
            peak: of("lr"),
            minimum: of("min_lr"),
            warmup_epochs: of("warmup_epochs"),
            epochs: of("epochs"),
        };
        for point in case["points"].as_array().unwrap() {
            let [epoch, expected] = [0, 1].map(|at| point[at].as_f64().unwrap());
            // The same formula in double precision, perhaps in another order.
            assert!((schedule.at(epoch) - expected).abs() <= 1e-15 * schedule.peak.max(1.0), "{epoch}");
        }
    }
}
