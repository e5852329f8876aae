//! A frozen encoder in the CPU engine, and the cache of what it makes of pictures.

use crate::goldens::{Golden, root, training_cases, values};
use crate::scene::{Scenes, config};
use crate::steps::{checkpoint, host_batch};
use burn_tensor::{Device, Tensor};
use selenograph_model::{Images, Inputs, Model, SavedActivations};
use selenograph_network::layout::Layout;
use selenograph_network::random;
use selenograph_train::batch::{HostBatch, ViewOutput};
use selenograph_train::loss::{LossSettings, training_loss};
use selenograph_train::network::{Gradients, PairNetwork};
use selenograph_train::{Error, Frozen, ModelNetwork};
use std::path::Path;

/// Of a loss: the encoder's products are summed in another order, each to about 1e-7.
const LOSS_TOLERANCE: f32 = 1e-5;
/// Of a gradient, relative to its largest value or a thousandth of the largest of all: what is summed with changing signs
/// keeps fewer digits than its terms.
const GRADIENT_TOLERANCE: f32 = 1e-4;

/// Loss and gradients of a batch.
fn learn(network: &ModelNetwork, batch: &HostBatch) -> (f32, Gradients) {
    let targets = batch.targets(&Device::flex());
    let mut total = f32::NAN;
    let mut loss = |output: &[ViewOutput; 2]| -> Result<Tensor<1>, Error> {
        let loss = training_loss(output, &targets, &LossSettings::default());
        total = values(&loss.total)[0];
        Ok(loss.total)
    };
    let gradients = network.learn(&batch.images, &mut loss).unwrap();
    (total, gradients)
}

/// The same with the model's own encoder.
fn learn_without_engine(model: &Model, network: &ModelNetwork, batch: &HostBatch) -> (f32, Gradients) {
    let images = &batch.images;
    let [height, width] = images.size;
    let size = |portrait: &bool| if *portrait { [width, height] } else { [height, width] };
    let sizes: Vec<_> = images.portrait.iter().map(size).collect();
    let pixels =
        Images::stored_landscape(images.values.clone(), images.size, &sizes, &Device::flex()).unwrap();
    let pairs: Vec<_> = (0..sizes.len()).map(|place| [place, place ^ 1]).collect();
    let targets = batch.targets(&Device::flex());
    let view = |output: &selenograph_model::Output| ViewOutput {
        points: output.points.clone(),
        confidence: output.confidence.clone(),
        descriptors: output.descriptors.clone().unwrap(),
        descriptor_confidence: output.descriptor_confidence.clone().unwrap(),
    };
    let mut total = f32::NAN;
    let learned = model
        .learn::<Error>(
            &|parameter| network.learns(parameter.name()),
            Inputs::Images(&pixels),
            &pairs,
            SavedActivations::Everything,
            &mut |output| {
                let loss = training_loss(&output.each_ref().map(view), &targets, &LossSettings::default());
                total = values(&loss.total)[0];
                Ok(loss.total)
            },
        )
        .unwrap();
    let named = model.parameters().iter().zip(learned.gradients.iter());
    let gradients = named.filter_map(|(one, by)| Some((one.name().to_owned(), by?.clone())));
    (total, gradients.collect())
}

fn assert_same_but_for_rounding(found: &(f32, Gradients), expected: &(f32, Gradients)) {
    let error = (found.0 - expected.0).abs() / expected.0.abs();
    assert!(error < LOSS_TOLERANCE, "{} and {}", found.0, expected.0);
    assert!(found.1.keys().eq(expected.1.keys()));
    let top = |gradient: &Tensor<1>| values(gradient).iter().fold(0.0f32, |top, value| top.max(value.abs()));
    let largest = expected.1.values().map(top).fold(0.0f32, f32::max);
    let mut worst = 0.0f32;
    for (name, gradient) in &expected.1 {
        let difference = top(&(found.1[name].clone() - gradient.clone()));
        let error = difference / top(gradient).max(1e-3 * largest);
        worst = worst.max(error);
        assert!(error < GRADIENT_TOLERANCE, "{name}: {error:.1e}");
    }
    println!("loss off by {error:.1e}, gradients by {worst:.1e}");
}

#[test]
fn shared_a_step_from_the_engine_s_features_is_that_of_the_model() {
    let Some(root) = root("golden training steps, engine") else { return };
    for case in training_cases(&root) {
        check_features(&case);
    }
}

fn check_features(case: &Path) {
    let batch = host_batch(&Golden::open(case));
    if !(batch.images.portrait.contains(&true) && batch.images.portrait.contains(&false)) {
        println!("SKIP shared-data: {} has not pictures both ways up", case.display());
    }
    let checkpoint = checkpoint(case);
    let mut read = |name: &str| Ok(checkpoint.read_with_shape(name)?);
    let model = Model::new(checkpoint.config(), &Device::flex(), &mut read).unwrap();
    let network =
        ModelNetwork::new(model.clone(), Frozen::Encoder, SavedActivations::Everything, None, "a test");
    let expected = learn_without_engine(&model, &network, &batch);
    assert_same_but_for_rounding(&learn(&network, &batch), &expected);
}

/// Scenes' network with its encoder frozen, keeping up to `cache_bytes`.
fn network(cache_bytes: usize) -> ModelNetwork {
    crate::scene::fresh_network(Frozen::Encoder).with_encoding_cache(cache_bytes)
}

fn assert_identical(a: &(f32, Gradients), b: &(f32, Gradients)) {
    assert_eq!(a.0.to_bits(), b.0.to_bits());
    assert!(a.1.keys().eq(b.1.keys()));
    assert!(a.1.iter().all(|(name, gradient)| gradient.to_data() == b.1[name].to_data()));
}

#[test]
fn what_is_kept_is_what_was_computed() {
    let scenes = Scenes::new(64, 4, 2, 0);
    let [first, second] = [0, 1].map(|idx| &scenes.batches()[idx]);
    // Sixteen tokens of 64 numbers a picture: all of them fit, or those of one pair and a half.
    for cache_bytes in [1 << 20, 3 * 16 * 64 * 4] {
        let (plain, keeping) = (network(0), network(cache_bytes));
        for batch in [first, second, first, second] {
            assert_identical(&learn(&keeping, batch), &learn(&plain, batch));
        }
    }
}

#[test]
fn changed_weights_are_no_hit() {
    let scenes = Scenes::new(64, 1, 1, 0);
    let batch = &scenes.batches()[0];
    let mut keeping = network(1 << 20);
    let before = learn(&keeping, batch);
    let mut change = |name: &str, _: &[usize], value: Tensor<1>| {
        (name == "enc_blocks.0.attn.proj.weight").then(|| value * 1.5)
    };
    keeping.update(&mut change).unwrap();
    let after = learn(&keeping, batch);
    assert!(before.0.to_bits() != after.0.to_bits());
    let layout = Layout::new(&config()).unwrap();
    let mut changed = |name: &str| {
        let spec = layout.get(name).unwrap();
        let mut values = random::values(spec, 3);
        if name == "enc_blocks.0.attn.proj.weight" {
            values.iter_mut().for_each(|value| *value *= 1.5);
        }
        Ok((spec.shape.clone(), values))
    };
    let model = Model::new(&config(), &Device::flex(), &mut changed).unwrap();
    let fresh = ModelNetwork::new(model, Frozen::Encoder, SavedActivations::Everything, None, "a test");
    assert_identical(&after, &learn(&fresh, batch));
}
