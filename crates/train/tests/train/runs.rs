//! Runs: stopped, killed, resumed, diverging, on a budget.

use crate::scene::{Scenes, config, fresh_network, read_network};
use burn_tensor::{Device, Tensor};
use selenograph_train::network::PairNetwork;
use selenograph_train::run::memory::MemoryEstimate;
use selenograph_train::run::metrics::{self, Record, StepRecord, ValidationRecord};
use selenograph_train::run::{
    CheckpointSettings, Event, TrainSettings, Trainer, TrainerContext, Validate, checkpoints, metrics_path,
    validation,
};
use selenograph_train::{Error, Frozen};
use std::cell::Cell;
use std::path::Path;
use std::time::Duration;

const SIDE: usize = 32;

/// Six steps of one batch, a checkpoint after each.
fn settings() -> TrainSettings {
    TrainSettings {
        epochs: 3.0,
        learning_rate: 1e-3,
        accumulate: 2,
        average_decay: Some(0.9),
        clip: Some(5.0),
        frozen: Frozen::None,
        checkpoint: CheckpointSettings { every_min: 0.0, keep: 2 },
        ..TrainSettings::default()
    }
}

/// How a run is carried out: by default as it should be.
struct Sitting<'a> {
    budget_s: Option<f64>,
    /// Seconds that pass whenever the clock is looked at, by the seconds of the run.
    tick_s: fn(f64) -> f64,
    observer: &'a mut dyn FnMut(Event<'_>) -> Result<(), Error>,
    validate: Option<Box<Validate<'a>>>,
}

fn carry_out(
    folder: &Path,
    settings: &TrainSettings,
    network: &mut dyn PairNetwork,
    resumes: bool,
    sitting: Sitting<'_>,
) -> Result<selenograph_train::run::checkpoint::RunState, Error> {
    let first = if resumes { checkpoints(folder, settings).last_state()?.batches } else { 0 };
    let mut source = Scenes::new(SIDE, 4, 1, first);
    let start = Duration::from_secs(1_000_000);
    let time = Cell::new(start);
    let clock = || {
        let gone_s = (time.get() - start).as_secs_f64();
        time.set(time.get() + Duration::from_secs_f64((sitting.tick_s)(gone_s)));
        time.get()
    };
    let context = TrainerContext {
        network,
        source: &mut source,
        teacher: None,
        at_a_time: 1,
        validate: sitting.validate,
        clock: &clock,
        budget_s: sitting.budget_s,
        stops: &|| false,
        observer: sitting.observer,
    };
    let trainer = if resumes {
        Trainer::resume(folder, settings, context)
    } else {
        Trainer::start(folder, settings, context)
    };
    trainer?.run()
}

pub fn steps(folder: &Path) -> Vec<StepRecord> {
    let records = metrics::read(&metrics_path(folder)).unwrap();
    let step = |record| match record {
        Record::Step(step) => Some(step),
        Record::Validation(_) => None,
    };
    records.into_iter().filter_map(step).collect()
}

/// What the run computed, to the last bit; what the clock says is left out.
fn curve(folder: &Path) -> Vec<(u64, [u64; 3])> {
    let bits = |step: &StepRecord| [step.loss, step.gradient_norm, step.learning_rate].map(f64::to_bits);
    steps(folder).iter().map(|step| (step.step, bits(step))).collect()
}

fn weights(network: &dyn PairNetwork) -> Vec<u32> {
    let mut all = Vec::new();
    network.visit(&mut |_, _, value| {
        all.extend(value.try_to_vec_as::<f32>().unwrap().into_iter().map(f32::to_bits));
    });
    all
}

fn killed() -> Error {
    Error::Settings { what: "a test".into(), message: "killed".into() }
}

#[test]
fn a_killed_run_goes_on_to_the_last_bit() {
    let (whole, broken) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let settings = settings();
    let mut quiet = |_: Event<'_>| Ok(());
    let mut network = fresh_network(Frozen::None);
    let sitting = |observer| Sitting { budget_s: None, tick_s: |_| 0.001, observer, validate: None };
    let state = carry_out(whole.path(), &settings, &mut network, false, sitting(&mut quiet)).unwrap();
    assert_eq!((state.step, state.batches), (6, 12));

    // Killed within step 4, after its line was written and before its checkpoint.
    let mut kill = |event: Event<'_>| match event {
        Event::Step(record, _) if record.step == 4 => Err(killed()),
        _ => Ok(()),
    };
    let mut first = fresh_network(Frozen::None);
    carry_out(broken.path(), &settings, &mut first, false, sitting(&mut kill)).unwrap_err();
    assert_eq!(steps(broken.path()).len(), 4);
    // And while a checkpoint was being written, and a line.
    let half = broken.path().join("checkpoints/.step-00000003.partial");
    std::fs::create_dir(&half).unwrap();
    std::fs::write(half.join("weights.safetensors"), [1, 2, 3]).unwrap();
    let lines = std::fs::read_to_string(metrics_path(broken.path())).unwrap();
    std::fs::write(metrics_path(broken.path()), lines + "{\"kind\":\"st").unwrap();

    let last = checkpoints(broken.path(), &settings).last_weights().unwrap();
    let mut second = read_network(&last, Frozen::None);
    let mut quiet = |_: Event<'_>| Ok(());
    let state = carry_out(broken.path(), &settings, &mut second, true, sitting(&mut quiet)).unwrap();
    assert_eq!(state.step, 6);
    assert_eq!(curve(broken.path()), curve(whole.path()));
    assert!(weights(&second) == weights(&network));
    let averages = [&whole, &broken].map(|folder| {
        let last = checkpoints(folder.path(), &settings).list().unwrap().pop().unwrap();
        std::fs::read(last.join("average.safetensors")).unwrap()
    });
    assert!(averages[0] == averages[1]);
    // Only the last two are kept.
    assert_eq!(checkpoints(broken.path(), &settings).list().unwrap().len(), 2);
}

#[test]
fn a_checkpoint_that_cannot_be_written_leaves_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let settings = TrainSettings { average_decay: None, ..settings() };
    let mut network = fresh_network(Frozen::None);
    let (place, elsewhere) = (folder.path().join("checkpoints"), folder.path().join("elsewhere"));
    let mut num_lost = 0;
    let mut observer = |event: Event<'_>| {
        match event {
            // A file where the folder would be: stands in for a full disk.
            Event::Step(record, _) if record.step == 3 => {
                std::fs::create_dir(&elsewhere).unwrap();
                std::fs::rename(&place, elsewhere.join("checkpoints")).unwrap();
                std::fs::write(&place, []).unwrap();
            }
            Event::Step(record, _) if record.step == 5 => {
                std::fs::remove_file(&place).unwrap();
                std::fs::rename(elsewhere.join("checkpoints"), &place).unwrap();
            }
            Event::NotSaved(_) => {
                num_lost += 1;
                let kept = checkpoints(&elsewhere, &settings).last_state().unwrap();
                assert_eq!(kept.step, 2);
            }
            _ => (),
        }
        Ok(())
    };
    let sitting = Sitting { budget_s: None, tick_s: |_| 0.001, observer: &mut observer, validate: None };
    let state = carry_out(folder.path(), &settings, &mut network, false, sitting).unwrap();
    assert_eq!((state.step, num_lost), (6, 2));
}

#[test]
fn a_loss_that_is_no_number_ends_the_run_and_keeps_the_batch() {
    let folder = tempfile::tempdir().unwrap();
    let mut network = fresh_network(Frozen::None);
    let mut spoil = |name: &str, _: &[usize], value: Tensor<1>| {
        (name == "downstream_head1.dpt.head.4.bias").then(|| value.zeros_like() + f32::NAN)
    };
    network.update(&mut spoil).unwrap();
    let mut quiet = |_: Event<'_>| Ok(());
    let sitting = Sitting { budget_s: None, tick_s: |_| 0.001, observer: &mut quiet, validate: None };
    match carry_out(folder.path(), &settings(), &mut network, false, sitting) {
        Err(Error::Diverged { step: 1, batch, .. }) => {
            let kept = selenograph_network::checkpoint::TensorFile::open(&batch).unwrap();
            assert_eq!(kept.read("images").unwrap().len(), 2 * 3 * SIDE * SIDE);
            assert!(kept.metadata()["pairs"].contains("scene 0"));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_budget_sizes_the_steps_and_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let settings = TrainSettings {
        checkpoint: CheckpointSettings { every_min: 10.0, keep: 1 },
        average_decay: None,
        ..settings()
    };
    let mut quiet = |_: Event<'_>| Ok(());
    // A step looks at the clock some ten times: eleven seconds or so.
    let sitting =
        |budget_s, observer| Sitting { budget_s: Some(budget_s), tick_s: |_| 1.0, observer, validate: None };
    let state = carry_out(
        folder.path(),
        &settings,
        &mut fresh_network(Frozen::None),
        false,
        sitting(150.0, &mut quiet),
    );
    let state = state.unwrap();
    assert_eq!(state.total_steps, Some(state.step));
    assert!((6..16).contains(&state.step), "{} steps", state.step);
    let last = steps(folder.path()).pop().unwrap();
    assert!(last.elapsed_s < 150.0 && (last.epoch - settings.epochs).abs() < 1e-9);

    let mut quiet = |_: Event<'_>| Ok(());
    let other = tempfile::tempdir().unwrap();
    let refused =
        carry_out(other.path(), &settings, &mut fresh_network(Frozen::None), false, sitting(5.0, &mut quiet));
    assert!(matches!(refused, Err(Error::BudgetTooShort { .. })), "{refused:?}");
}

#[test]
fn a_budget_is_sized_again_where_the_machine_changes_its_pace() {
    let settings = TrainSettings {
        checkpoint: CheckpointSettings { every_min: 1.0, keep: 1 },
        average_decay: None,
        ..settings()
    };
    // Three times as slow, and as fast, as when the budget was sized.
    for tick_s in [|s| if s < 200.0 { 1.0 } else { 3.0 }, |s: f64| if s < 200.0 { 3.0 } else { 1.0 }] {
        let folder = tempfile::tempdir().unwrap();
        let mut quiet = |_: Event<'_>| Ok(());
        let sitting = Sitting { budget_s: Some(1000.0), tick_s, observer: &mut quiet, validate: None };
        let state =
            carry_out(folder.path(), &settings, &mut fresh_network(Frozen::None), false, sitting).unwrap();
        let all = steps(folder.path());
        let last = all.last().unwrap();
        // The schedule came to its end with the time, without a jump on the way.
        assert!(last.elapsed_s > 850.0 && last.elapsed_s < 1000.0, "{}", last.elapsed_s);
        assert!(last.epoch > 0.95 * settings.epochs && last.epoch <= settings.epochs, "{}", last.epoch);
        let strides: Vec<f64> = all.windows(2).map(|pair| pair[1].epoch - pair[0].epoch).collect();
        let usual = settings.epochs / all.len() as f64;
        assert!(strides.iter().all(|stride| (0.2..5.0).contains(&(stride / usual))), "{strides:?}");
        assert!(state.sized.step > 0 && state.total_steps.unwrap() >= state.step);
    }
}

#[test]
fn the_best_weights_are_those_of_the_best_validation() {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings();
    let held_out = Scenes::new(SIDE, 2, 1, 0);
    let mut scores = vec![0.25, 0.5, 0.75];
    let mut judged = Vec::new();
    let mut validate = |network: &dyn PairNetwork, step: u64| {
        let found = validation::judge(network, held_out.batches(), step)?;
        assert!(found.values["average_precision"] > 0.0 && found.values["regression"] > 0.0);
        judged.push(weights(network));
        Ok(ValidationRecord { score: scores.pop().unwrap_or(1.0), ..found })
    };
    let mut quiet = |_: Event<'_>| Ok(());
    let mut network = fresh_network(Frozen::None);
    let sitting = Sitting {
        budget_s: None,
        tick_s: |_| 0.001,
        observer: &mut quiet,
        validate: Some(Box::new(&mut validate)),
    };
    let state = carry_out(folder.path(), &settings, &mut network, false, sitting).unwrap();
    assert_eq!(state.best_score, Some(0.25));
    // Each epoch once; what was judged are the averaged weights, and the network goes on with its own.
    assert_eq!(judged.len(), 3);
    assert!(judged[2] != weights(&network));
    let best = read_network(&folder.path().join("checkpoints/best.safetensors"), Frozen::None);
    assert!(weights(&best) == judged[2]);
}

#[test]
fn a_teacher_stands_in_for_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let settings = TrainSettings { teacher_min_confidence: 0.0, average_decay: None, ..settings() };
    let teacher = fresh_network(Frozen::None);
    let mut network = fresh_network(Frozen::None);
    let mut source = Scenes::new(SIDE, 4, 1, 0);
    let mut first = None;
    let mut observer = |event: Event<'_>| {
        if let Event::Step(record, _) = event {
            first.get_or_insert(record.terms["regression_a"]);
        }
        Ok(())
    };
    let context = TrainerContext {
        network: &mut network,
        source: &mut source,
        teacher: Some(&teacher),
        at_a_time: 1,
        validate: None,
        clock: &|| Duration::ZERO,
        budget_s: None,
        stops: &|| false,
        observer: &mut observer,
    };
    Trainer::start(folder.path(), &settings, context).unwrap().run().unwrap();
    // The same weights: nothing to learn but rounding.
    assert!(first.unwrap() < 1e-5, "{first:?}");
}

#[test]
fn memory_is_foreseen() {
    let network = fresh_network(Frozen::Encoder);
    let settings = TrainSettings::default();
    let estimate = MemoryEstimate::new(&network, &settings, [384, 512], 8192, 1);
    let (one, two) = (estimate.bytes(1), estimate.bytes(2));
    assert!(two > one && estimate.check(2, two).is_ok());
    match estimate.check(8, two) {
        Err(Error::OutOfMemoryForeseen { batch_that_fits: 2, .. }) => (),
        other => panic!("{other:?}"),
    }
    let all = MemoryEstimate::new(&fresh_network(Frozen::None), &settings, [384, 512], 8192, 1);
    assert!(all.parameters > estimate.parameters && all.per_pair > estimate.per_pair);
    assert_eq!(config().patch_px, 16);
    assert_eq!(network.device(), Device::flex());
}
