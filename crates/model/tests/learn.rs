//! Gradients: against differences of the loss, with and without recomputation, and who gets none.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and says what it ran on"
)]

use selenograph_model::{
    Device, Error, Gradients, Images, Inputs, LossAndGradients, Model, Output, Parameter, Precision,
    SavedActivations, Tensor,
};
use selenograph_network::layout::{Layout, Part, TensorSpec};
use selenograph_network::{NetworkConfig, Preset, Transformer, random};

/// As small as a network of the family can be: four heads of two sizes, odd grids.
fn config() -> NetworkConfig {
    let transformer =
        |dim: usize, num_blocks| Transformer { dim, num_blocks, num_heads: 2, mlp_dim: 2 * dim };
    NetworkConfig {
        encoder: transformer(16, 2),
        decoder: transformer(24, 4),
        dpt_dims: [4, 6, 8, 10],
        dpt_fusion_dim: 8,
        dpt_last_dim: 4,
        descriptor_dim: Some(3),
        ..Preset::Tiny.config()
    }
}

/// Random weights; biases and norms too, so that none can be forgotten.
fn values(spec: &TensorSpec) -> Vec<f32> {
    let mut values = random::values(spec, 5);
    if spec.shape.len() == 1 {
        for (idx, value) in values.iter_mut().enumerate() {
            *value += 0.2 * (idx as f32 * 1.7 + spec.len() as f32).sin();
        }
    }
    values
}

fn model() -> Model {
    let config = config();
    let layout = Layout::new(&config).unwrap();
    Model::new(&config, &Device::flex(), &mut |name| {
        let spec = layout.get(name).unwrap();
        Ok((spec.shape.clone(), values(spec)))
    })
    .unwrap()
}

/// Three images of a training batch, the second portrait.
fn images() -> Images {
    let (height, width) = (48, 80);
    let values = (0..3 * 3 * height * width).map(|idx| (idx as f32 * 0.137).sin()).collect();
    let sizes = [[height, width], [width, height], [height, width]];
    Images::stored_landscape(values, [height, width], &sizes, &Device::flex()).unwrap()
}

const PAIRS: [[usize; 2]; 4] = [[0, 1], [1, 0], [2, 1], [0, 2]];

/// A smooth function of everything that the heads say, different for every pixel and side.
fn loss([a, b]: &[Output; 2]) -> Result<Tensor<1>, Error> {
    let term = |value: Tensor<4>, factor: f64| (value * factor).sin().mean();
    let parts = [(a, 1.0), (b, 1.7)].map(|(output, factor)| {
        term(output.points.clone(), factor)
            + term(output.confidence.clone().unsqueeze(), 2.0 * factor)
            + term(output.descriptors.clone().unwrap(), 3.0 * factor)
            + term(output.descriptor_confidence.clone().unwrap().unsqueeze(), factor)
    });
    let [a, b] = parts;
    Ok(a + b * 0.5)
}

fn learn(model: &Model, keep: SavedActivations) -> LossAndGradients {
    model.learn::<Error>(&|_| true, Inputs::Images(&images()), &PAIRS, keep, &mut loss).unwrap()
}

fn number(value: &Tensor<1>) -> f64 {
    f64::from(value.clone().into_scalar::<f32>())
}

/// The length of the gradient by all parameters of a part.
fn norm(model: &Model, gradients: &Gradients, part: Part) -> f64 {
    let own = model.parameters().iter().zip(gradients.iter()).filter(|(each, _)| each.spec().part == part);
    own.filter_map(|(_, by)| Some(number(&by?.clone().square().sum()))).sum::<f64>().sqrt()
}

/// The loss with a part's parameters moved by `step` along their gradient.
fn moved(model: &Model, gradients: &Gradients, part: Part, step: f64) -> f64 {
    let mut moved = model.clone();
    let norm = norm(model, gradients, part);
    for (idx, by) in gradients.iter().enumerate() {
        let parameter = model.parameters().at(idx);
        if let Some(by) = by.filter(|_| parameter.spec().part == part) {
            let value = parameter.value().clone() + by.clone() * (step / norm);
            moved.parameters_mut().set(idx, value).unwrap();
        }
    }
    let all = moved.encode(&images()).unwrap();
    let [a, b] = [0, 1].map(|side| all.select(&PAIRS.map(|pair| pair[side])).unwrap());
    number(&loss(&moved.decode(&a, &b).unwrap()).unwrap())
}

#[test]
fn gradients_are_the_slope_of_the_loss() {
    /// Of a central difference over steps of this length, beside rounding of a loss of about one to 1e-7.
    const STEP: f64 = 0.003;
    const TOLERANCE: f64 = 0.005;
    let model = model();
    let gradients = learn(&model, SavedActivations::Everything).gradients;
    let parts = model.parameters().iter().map(|each| each.spec().part);
    let parts: std::collections::BTreeSet<Part> = parts.filter(|part| *part != Part::MaskToken).collect();
    assert_eq!(parts.len(), 11);
    for part in parts {
        let expected = norm(&model, &gradients, part);
        let difference = moved(&model, &gradients, part, STEP) - moved(&model, &gradients, part, -STEP);
        let found = difference / (2.0 * STEP);
        println!("{part:?}: {found:.6} and {expected:.6}");
        assert!((found - expected).abs() < TOLERANCE * expected, "{part:?}: {found}, gradient {expected}");
    }
}

#[test]
fn recomputing_changes_nothing_but_rounding() {
    /// Sums in another order, relative to a parameter's largest gradient or a thousandth of the largest of all.
    const TOLERANCE: f64 = 1e-4;
    let model = model();
    let [kept, again] =
        [SavedActivations::Everything, SavedActivations::BlockInputs].map(|keep| learn(&model, keep));
    assert!((number(&kept.loss) - number(&again.loss)).abs() < 1e-6);
    let tops: Vec<f64> =
        kept.gradients.iter().map(|by| by.map_or(0.0, |by| number(&by.clone().abs().max()))).collect();
    let top = tops.iter().copied().fold(0.0, f64::max);
    for (idx, (a, b)) in kept.gradients.iter().zip(again.gradients.iter()).enumerate() {
        let parameter = model.parameters().at(idx);
        assert_eq!([a.is_some(), b.is_some()], [parameter.is_computed(); 2], "{}", parameter.name());
        if let (Some(a), Some(b)) = (a, b) {
            let difference = number(&(a.clone() - b.clone()).abs().max());
            assert!(
                difference <= TOLERANCE * tops[idx].max(1e-3 * top),
                "{}: {difference}",
                parameter.name()
            );
        }
    }
}

#[test]
fn a_frozen_encoder_can_be_cached_and_its_norm_learns() {
    let model = model();
    let learns = |parameter: &Parameter| ![Part::PatchEmbed, Part::Encoder].contains(&parameter.spec().part);
    let features = model.encode_blocks(&images()).unwrap();
    let images = images();
    let run = |inputs, keep| model.learn::<Error>(&learns, inputs, &PAIRS, keep, &mut loss).unwrap();
    let expected = learn(&model, SavedActivations::Everything).gradients;
    for keep in [SavedActivations::Everything, SavedActivations::BlockInputs] {
        let cached = run(Inputs::Features(&features), keep);
        let direct = run(Inputs::Images(&images), keep);
        assert_eq!(number(&cached.loss), number(&direct.loss));
        for (idx, by) in cached.gradients.iter().enumerate() {
            let parameter = model.parameters().at(idx);
            assert_eq!(by.is_some(), parameter.is_computed() && learns(parameter), "{}", parameter.name());
            assert_eq!(by.is_some(), direct.gradients.at(idx).is_some());
        }
        let norm = model.parameters().idx("enc_norm.weight").unwrap();
        let [a, b] = [&cached.gradients, &expected].map(|all| all.at(norm).unwrap().clone());
        let top = number(&b.clone().abs().max());
        // The frozen encoder's attention runs through another kernel.
        assert!(number(&(a - b).abs().max()) < 1e-3 * top);
    }
}

#[test]
fn gradients_of_halves_add_up() {
    let model = model();
    let twice = |keep| learn(&model, keep).gradients;
    let sum =
        twice(SavedActivations::Everything).plus(twice(SavedActivations::Everything)).map(&|by| by * 0.5);
    for (sum, once) in sum.iter().zip(twice(SavedActivations::Everything).iter()) {
        let same = sum.zip(once).is_none_or(|(a, b)| a.to_data() == b.to_data());
        assert!(same && sum.is_some() == once.is_some());
    }
}

#[test]
fn products_in_bf16_lose_digits_and_nothing_else() {
    /// Eight bits of a product's factors, through a network of a dozen layers.
    const LOSS_TOLERANCE: f64 = 0.02;
    const LEAST_COSINE: f64 = 0.99;
    let exact = learn(&model(), SavedActivations::Everything);
    for keep in [SavedActivations::Everything, SavedActivations::BlockInputs] {
        let rough = learn(&model().with_precision(Precision::Bf16), keep);
        let difference = (number(&rough.loss) - number(&exact.loss)).abs();
        assert!(difference > 0.0, "bf16 was not used");
        assert!(difference < LOSS_TOLERANCE * number(&exact.loss).abs(), "{difference}");
        let dot = |a: &Gradients, b: &Gradients| -> f64 {
            let terms = a.iter().zip(b.iter());
            terms.filter_map(|(a, b)| Some(number(&(a?.clone() * b?.clone()).sum()))).sum()
        };
        let (a, b) = (&exact.gradients, &rough.gradients);
        let cosine = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
        println!("loss off by {difference:.1e}, cosine of gradients {cosine:.5}");
        assert!(cosine > LEAST_COSINE, "{cosine}");
    }
}
