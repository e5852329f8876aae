//! The loop: batches in, steps, checkpoints and curves out.

use super::checkpoint::{Checkpoints, RunState, Saved};
use super::metrics::{MetricsFile, Record, StepRecord, ValidationRecord};
use super::pace::Pace;
use super::settings::TrainSettings;
use super::tensorboard::EventWriter;
use crate::Error;
use crate::batch::HostBatch;
use crate::network::PairNetwork;
use crate::optimizer::{AdamW, LossScale, WeightAverage};
use burn_tensor::Tensor;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The weights of the best validation, among the checkpoints.
const BEST: &str = "best.safetensors";

/// Where batches come from. What the n-th batch holds depends on the seed and on n alone.
pub trait BatchSource {
    /// Batches of an epoch.
    fn batches_per_epoch(&self) -> u64;

    /// The next batch; waits for it.
    ///
    /// # Errors
    /// What the source says.
    fn next_batch(&mut self) -> Result<HostBatch, Error>;
}

/// Judges the network on held-out pairs.
pub type Validate<'a> = dyn FnMut(&dyn PairNetwork, u64) -> Result<ValidationRecord, Error> + 'a;

/// What a run works with.
pub struct TrainerContext<'a> {
    /// What learns.
    pub network: &'a mut dyn PairNetwork,
    /// What it learns from.
    pub source: &'a mut dyn BatchSource,
    /// Whose predictions stand in for the truth.
    pub teacher: Option<&'a dyn PairNetwork>,
    /// Batches of a step that are computed at the same time; the result does not depend on it.
    pub at_a_time: usize,
    /// Held-out pairs.
    pub validate: Option<Box<Validate<'a>>>,
    /// Time since 1970, never going back.
    pub clock: &'a dyn Fn() -> Duration,
    /// Seconds that this run may take, earlier sittings included; the steps are sized to it.
    pub budget_s: Option<f64>,
    /// Whether to stop at the next step.
    pub stops: &'a dyn Fn() -> bool,
    /// Is told what happens.
    pub observer: &'a mut dyn FnMut(Event<'_>) -> Result<(), Error>,
}

/// What happens in a run.
#[derive(Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A step was made; seconds that are left, where that is known.
    Step(&'a StepRecord, Option<f64>),
    /// A validation was made.
    Validation(&'a ValidationRecord),
    /// A checkpoint was written.
    Saved(&'a Path),
    /// A checkpoint could not be written; the one before is whole, and the run goes on.
    NotSaved(&'a Error),
}

/// A run that stands between two steps.
pub struct Trainer<'a> {
    pub(super) settings: &'a TrainSettings,
    pub(super) context: TrainerContext<'a>,
    pub(super) folder: PathBuf,
    pub(super) optimizer: AdamW,
    pub(super) average: Option<WeightAverage>,
    pub(super) state: RunState,
    checkpoints: Checkpoints,
    /// The last checkpoint and its step.
    saved: Option<(u64, PathBuf)>,
    metrics: MetricsFile,
    events: EventWriter,
    /// Clock at the start of this sitting, earlier sittings taken off.
    pub(super) epoch_zero: Duration,
    saved_at_s: f64,
    pub(super) pace: Pace,
    /// What the last checkpoint and the last validation took.
    pub(super) save_s: f64,
    pub(super) validation_s: f64,
}

/// The checkpoints of the run in `folder`.
pub fn checkpoints(folder: &Path, settings: &TrainSettings) -> Checkpoints {
    Checkpoints::new(folder.join("checkpoints"), settings.checkpoint.keep)
}

/// The file of the curves of the run in `folder`.
pub fn metrics_path(folder: &Path) -> PathBuf {
    folder.join("metrics.jsonl")
}

impl<'a> Trainer<'a> {
    /// A run from the network as it is.
    ///
    /// # Errors
    /// [`Error::Settings`], [`Error::Io`].
    pub fn start(
        folder: &Path,
        settings: &'a TrainSettings,
        context: TrainerContext<'a>,
    ) -> Result<Self, Error> {
        let total = (settings.epochs * context.source.batches_per_epoch() as f64 / settings.accumulate as f64)
            .floor()
            .max(1.0) as u64;
        let state = RunState {
            total_steps: context.budget_s.is_none().then_some(total),
            loss_scale: settings.loss_scaling.then(LossScale::default),
            ..RunState::default()
        };
        Self::stand(folder, settings, context, (AdamW::new(settings.optimizer), BTreeMap::new()), state, None)
    }

    /// The run in `folder` as its last checkpoint left it. The network holds [`Checkpoints::last_weights`] and the source
    /// gives the batch after [`RunState::batches`].
    ///
    /// # Errors
    /// [`Error::Resume`], [`Error::Io`], [`Error::Network`].
    pub fn resume(
        folder: &Path,
        settings: &'a TrainSettings,
        context: TrainerContext<'a>,
    ) -> Result<Self, Error> {
        let saved = checkpoints(folder, settings);
        let state = saved.last_state()?;
        let device = context.network.device();
        let optimizer = saved.last_optimizer(settings.optimizer, &state, &device)?;
        let average = saved.last_average(&device)?;
        let last = (state.step, saved.last()?);
        Self::stand(folder, settings, context, (optimizer, average), state, Some(last))
    }

    fn stand(
        folder: &Path,
        settings: &'a TrainSettings,
        context: TrainerContext<'a>,
        (optimizer, averaged): (AdamW, BTreeMap<String, Tensor<1>>),
        state: RunState,
        saved: Option<(u64, PathBuf)>,
    ) -> Result<Self, Error> {
        settings.check()?;
        std::fs::create_dir_all(folder).map_err(Error::io("write", folder))?;
        let now = (context.clock)();
        Ok(Self {
            checkpoints: checkpoints(folder, settings),
            saved,
            average: settings.average_decay.map(|decay| WeightAverage::new(decay, context.network, averaged)),
            metrics: MetricsFile::open(&metrics_path(folder), state.step)?,
            events: EventWriter::create(&folder.join("tensorboard"), now)?,
            epoch_zero: now.saturating_sub(Duration::from_secs_f64(state.elapsed_s)),
            saved_at_s: state.elapsed_s,
            pace: Pace::default(),
            save_s: 0.0,
            validation_s: 0.0,
            folder: folder.to_owned(),
            settings,
            context,
            optimizer,
            state,
        })
    }

    /// Runs to the end of the schedule, of the budget, or until told to stop, and leaves a checkpoint.
    ///
    /// # Errors
    /// [`Error::Diverged`], [`Error::BudgetTooShort`], what source and network say, and [`Error::Io`] if the last
    /// checkpoint cannot be written.
    pub fn run(mut self) -> Result<RunState, Error> {
        let first = self.state.step;
        if first == 0 {
            // Also tells, before time is spent, that the folder can take one.
            self.save()?;
        }
        while !self.is_over() && !(self.context.stops)() {
            self.step()?;
            self.size_budget()?;
            let is_last = self.is_over();
            if !is_last && self.is_validation_due() {
                self.validate()?;
            }
            let is_due = self.elapsed_s() - self.saved_at_s >= 60.0 * self.settings.checkpoint.every_min;
            if !is_last && is_due {
                // Before the checkpoint, so that who goes on from it keeps to the same steps.
                self.resize_budget();
                let saved = self.save();
                self.tell_if_lost(saved)?;
            }
        }
        // A run that ended before has been judged.
        if self.is_over() && self.state.step > first {
            self.validate()?;
        }
        self.save()?;
        Ok(self.state)
    }

    pub(super) fn report(&mut self, record: StepRecord) -> Result<(), Error> {
        let mut values: Vec<(String, f64)> =
            record.terms.iter().map(|(name, value)| (format!("terms/{name}"), *value)).collect();
        values.extend([
            ("loss".to_owned(), record.loss),
            ("learning_rate".to_owned(), record.learning_rate),
            ("gradient_norm".to_owned(), record.gradient_norm),
            ("pairs_per_s".to_owned(), record.pairs_per_s),
        ]);
        self.events.scalars((self.context.clock)(), record.step, &values)?;
        let left = self.state.total_steps.zip(self.step_s());
        let left_s = left.map(|(total, step_s)| total.saturating_sub(record.step) as f64 * step_s);
        let record = Record::Step(record);
        self.metrics.push(&record)?;
        if let Record::Step(record) = &record {
            (self.context.observer)(Event::Step(record, left_s))?;
        }
        Ok(())
    }

    fn is_validation_due(&self) -> bool {
        let every = self.settings.validation.every_epochs;
        let periods = |step: u64| (self.epoch_at(step) / every).floor();
        every > 0.0 && periods(self.state.step) > periods(self.state.step - 1)
    }

    fn validate(&mut self) -> Result<(), Error> {
        let began_s = self.elapsed_s();
        let Some(validate) = self.context.validate.as_mut() else { return Ok(()) };
        let network = &mut *self.context.network;
        let trained = match &self.average {
            Some(average) => exchange(network, average.values())?,
            None => BTreeMap::new(),
        };
        let found = validate(network, self.state.step);
        exchange(network, &trained)?;
        let found = found?;
        self.validation_s = self.elapsed_s() - began_s;
        let values: Vec<_> =
            found.values.iter().map(|(name, value)| (format!("validation/{name}"), *value)).collect();
        self.events.scalars((self.context.clock)(), found.step, &values)?;
        let is_best = self.state.best_score.is_none_or(|best| found.score < best);
        let record = Record::Validation(found);
        self.metrics.push(&record)?;
        if let Record::Validation(found) = &record {
            (self.context.observer)(Event::Validation(found))?;
            if is_best {
                let before = self.state.best_score.replace(found.score);
                let saved = self.save();
                let kept = saved.and_then(|saved| self.checkpoints.keep_weights(&saved, BEST));
                if !self.tell_if_lost(kept)? {
                    self.state.best_score = before;
                }
            }
        }
        Ok(())
    }

    /// Tells of a checkpoint that could not be written, and whether it was.
    fn tell_if_lost<T>(&mut self, saved: Result<T, Error>) -> Result<bool, Error> {
        if let Err(error) = &saved {
            (self.context.observer)(Event::NotSaved(error))?;
            self.saved_at_s = self.elapsed_s();
        }
        Ok(saved.is_ok())
    }

    /// A checkpoint, unless this step has one.
    fn save(&mut self) -> Result<PathBuf, Error> {
        if let Some((_, path)) = self.saved.as_ref().filter(|(step, _)| *step == self.state.step) {
            return Ok(path.clone());
        }
        let began_s = self.elapsed_s();
        let path = self.checkpoints.save(Saved {
            network: self.context.network,
            optimizer: &self.optimizer,
            average: self.average.as_ref(),
            state: self.state.clone(),
        })?;
        self.saved_at_s = self.elapsed_s();
        self.save_s = self.saved_at_s - began_s;
        self.saved = Some((self.state.step, path.clone()));
        (self.context.observer)(Event::Saved(&path))?;
        Ok(path)
    }
}

/// Puts values in the place of parameters and returns what was there.
fn exchange(
    network: &mut dyn PairNetwork,
    values: &BTreeMap<String, Tensor<1>>,
) -> Result<BTreeMap<String, Tensor<1>>, Error> {
    let mut before = BTreeMap::new();
    network.update(&mut |name, _, value| {
        let new = values.get(name)?.clone();
        before.insert(name.to_owned(), value);
        Some(new)
    })?;
    Ok(before)
}
