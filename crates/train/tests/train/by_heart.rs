//! Few pairs, seen again and again.

use crate::runs::steps;
use crate::scene::{Scenes, config, random_network};
use burn_tensor::{Int, Tensor};
use selenograph_network::{NetworkConfig, Preset};
use selenograph_train::network::PairNetwork;
use selenograph_train::run::metrics::StepRecord;
use selenograph_train::run::{BatchSource, CheckpointSettings, TrainSettings, Trainer, TrainerContext};
use selenograph_train::{Frozen, ModelNetwork};
use std::time::Duration;

/// Pixels along a side in the short form.
const SIDE: usize = 32;

/// Share of the first regression loss that is left, and share of the true matches whose nearest descriptor in the whole
/// second view lies within two pixels of the truth, after eight pairs were seen `epochs` times.
fn by_heart(config: &NetworkConfig, side: usize, epochs: f64) -> (f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    let settings = TrainSettings {
        epochs,
        learning_rate: 2e-3,
        min_learning_rate: 1e-5,
        warmup_epochs: 2.0,
        frozen: Frozen::None,
        clip: Some(5.0),
        checkpoint: CheckpointSettings { every_min: 1e9, keep: 1 },
        ..TrainSettings::default()
    };
    let mut network = random_network(config, Frozen::None);
    let mut source = Scenes::new(side, 8, 4, 0);
    assert_eq!(source.batches_per_epoch(), 2);
    let context = TrainerContext {
        network: &mut network,
        source: &mut source,
        teacher: None,
        at_a_time: 1,
        validate: None,
        clock: &|| Duration::ZERO,
        budget_s: None,
        stops: &|| false,
        observer: &mut |_| Ok(()),
    };
    Trainer::start(folder.path(), &settings, context).unwrap().run().unwrap();
    let steps = steps(folder.path());
    let of = |step: &StepRecord| step.terms["regression_a"] + step.terms["regression_b"];
    let (first, last) = (&steps[0], &steps[steps.len() - 1]);
    let left = of(last) / of(first);
    let near = matched_within(&network, &source, 2.0);
    println!(
        "regression {:.4} to {:.4}, matching {} to {}",
        of(first),
        of(last),
        first.terms["matching"],
        last.terms["matching"]
    );
    println!(
        "{:.1} % of the regression loss is left, {:.1} % of matches within 2 px",
        100.0 * left,
        100.0 * near
    );
    assert!(last.terms["matching"] < first.terms["matching"]);
    (left, near)
}

/// Share of the true matches of all pairs whose nearest descriptor in view B lies within `reach_px` of where it should.
fn matched_within(network: &ModelNetwork, source: &Scenes, reach_px: f64) -> f64 {
    let (mut near, mut all) = (0_usize, 0_usize);
    for batch in source.batches() {
        let [a, b] = network.forward(&batch.images).unwrap().map(|view| view.descriptors);
        let [items, height, width, channels] = a.dims();
        let flat = |view: Tensor<4>| view.reshape([items, height * width, channels]);
        let targets = batch.targets(&network.device());
        let matches = targets.matches.unwrap();
        let numbers = |pixels: Tensor<2, Int>| pixels.try_into_vec_as::<i64>().unwrap();
        let [from, to] = matches.pixels.map(numbers);
        let valid = matches.valid.int().try_into_vec_as::<i64>().unwrap();
        let nearest = numbers(flat(a).matmul(flat(b).swap_dims(1, 2)).argmax(2).squeeze_dim::<2>(2));
        let per_item = from.len() / items;
        for idx in (0..from.len()).filter(|idx| valid[*idx] == 1) {
            let found = nearest[idx / per_item * height * width + from[idx] as usize];
            let [dx, dy] = [
                found % width as i64 - to[idx] % width as i64,
                found / width as i64 - to[idx] / width as i64,
            ];
            all += 1;
            near += usize::from(((dx * dx + dy * dy) as f64).sqrt() <= reach_px);
        }
    }
    near as f64 / all as f64
}

#[test]
fn eight_pairs_are_learnt_by_heart() {
    /// Share of the first regression loss that is left after these few steps.
    const LEFT: f64 = 0.4;
    let (left, _) = by_heart(&config(), SIDE, 24.0);
    assert!(left < LEFT, "{left} is left");
}

#[test]
#[ignore = "minutes: the long form, with the preset `tiny`"]
fn eight_pairs_are_learnt_by_heart_by_tiny() {
    let (left, near) = by_heart(&Preset::Tiny.config(), 64, 150.0);
    assert!(left < 0.05, "{left} is left");
    assert!(near > 0.9, "{near} of the matches within 2 px");
}
