//! Whole training steps of the reference's tiny network: many-aspect batches, each pair both ways.

use crate::goldens::{Golden, relative_error, root, training_cases, values, with_extension};
use burn_tensor::{Device, Tensor};
use selenograph_dataset::rng::rng;
use selenograph_model::{Model, SavedActivations};
use selenograph_network::Checkpoint;
use selenograph_train::batch::{AssemblySettings, HostBatch};
use selenograph_train::loss::{LossSettings, training_loss};
use selenograph_train::network::{Gradients, PairNetwork};
use selenograph_train::optimizer::{AdamW, AdamWSettings, Schedule, decays, norm};
use selenograph_train::{Frozen, ModelNetwork};
use std::path::Path;

/// Relative to the largest value of the tensor: the README of the goldens.
const OUTPUT_TOLERANCE: f32 = 5e-4;
/// The same for the gradient of a whole network; losses of it inherit the outputs' tolerance.
const GRADIENT_TOLERANCE: f32 = 1e-3;
/// Of a parameter after a step, in learning rates, beyond what the tolerance of the gradients does to it: the last digits
/// of a parameter of size one, of which a learning rate is a thousandth.
const STEP_TOLERANCE: f32 = 1e-3;
/// Learning rates that the tolerance of the gradients may leave open for the median value of a tensor, or nothing is tested.
const LARGEST_DOUBT: f32 = 0.1;
/// Of a parameter after a step from the reference's own gradient: what its README saw of another implementation.
const ALONE_TOLERANCE: f32 = 1e-7;

/// The checkpoint of the reference beside a case.
pub fn checkpoint(case: &Path) -> Checkpoint {
    Checkpoint::open(&with_extension(case.parent().unwrap(), "pth").swap_remove(0)).unwrap()
}

fn network(case: &Path, frozen: Frozen, keep: SavedActivations) -> ModelNetwork {
    let checkpoint = checkpoint(case);
    let mut read = |name: &str| Ok(checkpoint.read_with_shape(name)?);
    let model = Model::new(checkpoint.config(), &Device::flex(), &mut read).unwrap();
    ModelNetwork::new(model, frozen, keep, None, "goldens")
}

pub fn host_batch(golden: &Golden) -> HostBatch {
    let settings = AssemblySettings { match_block: 8192, epipolar: false };
    let mut stream = rng(0, "test", 0, "matches");
    let mut batch = HostBatch::assemble(&golden.pairs(golden), &settings, &mut stream).unwrap();
    // The reference's pictures are no bytes: ours are those but for their rounding.
    let pixels = batch.images.values.len() / batch.images.portrait.len();
    for (slot, image) in batch.images.values.chunks_mut(pixels).enumerate() {
        let theirs = golden.item(&format!("gt{}.img", slot % 2 + 1), slot / 2);
        assert!(image.iter().zip(theirs).all(|(a, b)| (a - b.clamp(-1.0, 1.0)).abs() < 0.5 / 127.0));
        image.copy_from_slice(theirs);
    }
    batch
}

#[test]
fn shared_two_training_steps() {
    let Some(root) = root("golden training steps") else { return };
    for case in training_cases(&root) {
        check_training_steps(&case);
    }
}

/// What a file beside a case says: `train_meta.json` beside `train.safetensors`.
fn meta(case: &Path) -> serde_json::Value {
    let stem = case.file_stem().unwrap().to_str().unwrap();
    let text = std::fs::read_to_string(case.with_file_name(format!("{stem}_meta.json"))).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// The optimiser that the case was made with, and its learning rate.
fn optimizer(meta: &serde_json::Value) -> (AdamWSettings, f64) {
    let of = |value: &serde_json::Value| value.as_f64().unwrap();
    let settings = AdamWSettings {
        beta_1: of(&meta["betas"][0]),
        beta_2: of(&meta["betas"][1]),
        epsilon: of(&meta["eps"]),
        weight_decay: of(&meta["weight_decay"]),
    };
    (settings, of(&meta["lr"]))
}

fn check_training_steps(case: &Path) {
    let golden = Golden::open(case);
    let meta = meta(case);
    let (settings, learning_rate) = optimizer(&meta);
    let names = |key: &str| -> Vec<String> { serde_json::from_value(meta[key].clone()).unwrap() };
    let batch = host_batch(&golden);
    let targets = batch.targets(&Device::flex());
    for keep in [SavedActivations::Everything, SavedActivations::BlockInputs] {
        let mut network = network(case, Frozen::None, keep);
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
        let selected = names("selected");
        let mut optimizer = AdamW::new(settings);
        let mut past = Vec::new();
        for step in (0..).take_while(|step| golden.has(&format!("step{step}.loss"))) {
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
                check_gradients(&golden, &gradients, &selected);
            }
            past.push(gradients.clone());
            optimizer.step(&mut network, gradients, learning_rate).unwrap();
            let steps = Steps { past: &past, settings, learning_rate };
            check_parameters(&golden, &steps, &network, &selected);
        }
    }
}

fn check_groups(network: &ModelNetwork, decay: &[String], no_decay: &[String]) {
    network.visit(&mut |name, shape, _| {
        let group = if decays(name, shape) { decay } else { no_decay };
        assert!(group.iter().any(|other| other == name), "{name}");
    });
}

fn check_norms(golden: &Golden, gradients: &Gradients, names: &[String]) {
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

fn check_gradients(golden: &Golden, gradients: &Gradients, selected: &[String]) {
    for name in selected {
        let Some(gradient) = gradients.get(name) else {
            assert!(!golden.has(&format!("grad.{name}")), "{name} has no gradient");
            continue;
        };
        let error = relative_error(&values(gradient), golden.values(&format!("grad.{name}")));
        println!("gradient of {name}: {error:.1e}");
        assert!(error <= GRADIENT_TOLERANCE, "gradient of {name}: {error:.1e}");
    }
}

/// The steps so far: their gradients, and how they were made.
struct Steps<'a> {
    past: &'a [Gradients],
    settings: AdamWSettings,
    learning_rate: f64,
}

fn check_parameters(golden: &Golden, steps: &Steps<'_>, network: &ModelNetwork, selected: &[String]) {
    let step = steps.past.len();
    let mut num_seen = 0;
    network.visit(&mut |name, _, value| {
        if !selected.iter().any(|other| other == name) {
            return;
        }
        num_seen += 1;
        let past: Vec<Vec<f32>> =
            steps.past.iter().filter_map(|gradients| gradients.get(name).map(values)).collect();
        let found = values(&value);
        let mut doubts = doubts(steps.settings, &past, found.len());
        let expected = golden.values(&format!("after_step{step}.{name}"));
        for (n, doubt) in doubts.iter().enumerate() {
            let error = (found[n] - expected[n]).abs() / steps.learning_rate as f32;
            assert!(error <= doubt + STEP_TOLERANCE, "{name}, value {n} after step {step}: {error:.1e} off");
        }
        doubts.sort_by(f32::total_cmp);
        let median = doubts[doubts.len() / 2];
        println!("after step {step} {name}: the gradient's tolerance leaves {median:.1e}");
        assert!(median <= LARGEST_DOUBT, "{name}: {median}");
    });
    assert_eq!(num_seen, selected.len());
}

/// Adam's step after these gradients, in learning rates, without decay.
fn adam(settings: AdamWSettings, gradients: &[f32]) -> f32 {
    let AdamWSettings { beta_1, beta_2, epsilon, .. } = settings;
    let mean = |beta: f64, values: &mut dyn Iterator<Item = f64>| {
        let (sum, weight) = values.fold((0.0, 0.0), |(sum, weight), g| (beta * sum + g, beta * weight + 1.0));
        sum / weight
    };
    let mut plain = gradients.iter().map(|g| f64::from(*g));
    let mut squares = gradients.iter().map(|g| f64::from(*g).powi(2));
    (mean(beta_1, &mut plain) / (mean(beta_2, &mut squares).sqrt() + epsilon)) as f32
}

/// How far each of `len` values may have gone astray, in learning rates, since each gradient is known within its tolerance.
/// Where a gradient is smaller than that its sign is anyone's, and with it the whole step.
fn doubts(settings: AdamWSettings, past: &[Vec<f32>], len: usize) -> Vec<f32> {
    let slack: Vec<f32> = past
        .iter()
        .map(|gradient| GRADIENT_TOLERANCE * gradient.iter().fold(0.0f32, |max, g| max.max(g.abs())))
        .collect();
    let doubt = |n: usize, step: usize| {
        let moved = |signs: usize| -> Vec<f32> {
            let sign = |k: usize| if signs >> k & 1 == 0 { 1.0 } else { -1.0 };
            (0..step).map(|k| past[k][n] + sign(k) * slack[k]).collect()
        };
        let own: Vec<f32> = past[..step].iter().map(|gradient| gradient[n]).collect();
        (0..1 << step)
            .map(|signs| (adam(settings, &moved(signs)) - adam(settings, &own)).abs())
            .fold(0.0, f32::max)
    };
    (0..len).map(|n| (1..=past.len()).map(|step| doubt(n, step)).sum()).collect()
}

/// Starts from the reference's weights and gradients, so that nothing but the optimiser is tested.
#[test]
fn shared_one_step_of_the_optimiser_alone() {
    let Some(root) = root("golden steps of the optimiser") else { return };
    for case in training_cases(&root) {
        check_optimiser(&case);
    }
}

fn check_optimiser(case: &Path) {
    let golden = Golden::open(case);
    let (settings, learning_rate) = optimizer(&meta(case));
    let mut network = network(case, Frozen::None, SavedActivations::Everything);
    let mut gradients = Gradients::new();
    network.visit(&mut |name, shape, _| {
        let theirs = format!("grad.{name}");
        if golden.has(&theirs) {
            assert_eq!(golden.shape(&theirs), shape);
            let gradient = Tensor::from_floats(golden.values(&theirs), &Device::flex());
            gradients.insert(name.to_owned(), gradient);
        }
    });
    let selected: Vec<String> = gradients.keys().cloned().collect();
    assert!(!selected.is_empty());
    AdamW::new(settings).step(&mut network, gradients, learning_rate).unwrap();
    network.visit(&mut |name, _, value| {
        if selected.iter().any(|other| other == name) {
            let expected = golden.values(&format!("after_step1.{name}"));
            let error =
                values(&value).iter().zip(expected).fold(0.0f32, |max, (f, e)| max.max((f - e).abs()));
            println!("{name}: {error:.1e}");
            assert!(error <= ALONE_TOLERANCE, "{name}: {error:.1e}");
        }
    });
}

#[test]
fn shared_a_frozen_encoder_lets_its_norm_learn() {
    let Some(root) = root("golden training steps, frozen") else { return };
    for case in training_cases(&root) {
        check_frozen_encoder(&case);
    }
}

fn check_frozen_encoder(case: &Path) {
    let batch = host_batch(&Golden::open(case));
    let network = network(case, Frozen::Encoder, SavedActivations::Everything);
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
