//! One step: batches, gradients, weights.

use super::metrics::StepRecord;
use super::settings::TrainSettings;
use super::trainer::Trainer;
use crate::Error;
use crate::batch::HostBatch;
use crate::loss::{Loss, training_loss};
use crate::network::{Gradients, PairNetwork};
use crate::optimizer::{clip, norm, scale};
use burn_tensor::Tensor;
use selenograph_network::ElementType;
use selenograph_network::safetensors::{Entry, Writer};
use std::collections::BTreeMap;
use std::path::Path;

/// Shortest step, seconds, so that rates stay numbers.
const SHORTEST_S: f64 = 1e-9;

/// What the batches of a step add up to.
#[derive(Default)]
struct Gathered {
    gradients: Gradients,
    loss: f64,
    terms: BTreeMap<String, f64>,
    pairs: usize,
    wait_s: f64,
    last: HostBatch,
}

impl Trainer<'_> {
    /// One step and its record.
    pub(super) fn step(&mut self) -> Result<(), Error> {
        let began_s = self.elapsed_s();
        let learning_rate = self.settings.schedule().at(self.epoch_at(self.state.step));
        let mut gathered = Gathered::default();
        self.gather(&mut gathered)?;
        let gradient_norm = self.unscaled_norm(&mut gathered)?;
        let moved = gradient_norm.is_finite();
        if moved {
            if let Some(limit) = self.settings.clip {
                clip(&mut gathered.gradients, gradient_norm, limit);
            }
            self.optimizer.step(self.context.network, gathered.gradients, learning_rate)?;
            if let Some(average) = &mut self.average {
                average.record(self.context.network);
            }
        }
        self.state.step += 1;
        self.state.elapsed_s = self.elapsed_s();
        let step_s = (self.state.elapsed_s - began_s).max(SHORTEST_S);
        self.pace.step(self.state.elapsed_s, self.state.step);
        self.report(StepRecord {
            step: self.state.step,
            epoch: self.epoch_at(self.state.step),
            learning_rate,
            loss: gathered.loss,
            terms: gathered.terms,
            gradient_norm,
            moved,
            pairs_per_s: gathered.pairs as f64 / step_s,
            data_wait_share: gathered.wait_s / step_s,
            elapsed_s: self.state.elapsed_s,
        })
    }

    /// Adds up the gradients of the step's batches, always in their order, so that the sum is the same however many of them
    /// are computed at a time.
    fn gather(&mut self, gathered: &mut Gathered) -> Result<(), Error> {
        let mut left = self.settings.accumulate;
        while left > 0 {
            let count = left.min(self.context.at_a_time.max(1));
            left -= count;
            let asked_s = self.elapsed_s();
            let batches = (0..count).map(|_| self.context.source.next_batch());
            let batches = batches.collect::<Result<Vec<HostBatch>, Error>>()?;
            gathered.wait_s += self.elapsed_s() - asked_s;
            self.state.batches += count as u64;
            let job = Job {
                network: &*self.context.network,
                teacher: self.context.teacher,
                settings: self.settings,
                folder: &self.folder,
                step: self.state.step + 1,
                share: 1.0 / self.settings.accumulate as f64,
                factor: self.state.loss_scale.map_or(1.0, |scale| scale.factor()),
            };
            for (learnt, batch) in job.run_all(&batches).into_iter().zip(batches) {
                gathered.add(learnt?, job.share, batch);
            }
        }
        Ok(())
    }

    /// Length of the gradients, which lose the factor of the loss. One that is no number is an overflow where the loss is
    /// scaled, and the end of the run elsewhere.
    fn unscaled_norm(&mut self, gathered: &mut Gathered) -> Result<f64, Error> {
        let Some(loss_scale) = &mut self.state.loss_scale else {
            let length = length(&gathered.gradients);
            return if length.is_finite() {
                Ok(length)
            } else {
                Err(diverged(&self.folder, self.state.step + 1, length, &gathered.last))
            };
        };
        scale(&mut gathered.gradients, 1.0 / loss_scale.factor());
        let length = length(&gathered.gradients);
        loss_scale.record(length.is_finite());
        Ok(length)
    }
}

impl Gathered {
    fn add(&mut self, learnt: Learnt, share: f64, batch: HostBatch) {
        for (name, value) in learnt.values {
            match name {
                "" => self.loss += value * share,
                name => *self.terms.entry(name.to_owned()).or_default() += value * share,
            }
        }
        for (name, gradient) in learnt.gradients {
            match self.gradients.get_mut(&name) {
                Some(sum) => sum.inplace(|sum| sum + gradient),
                None => {
                    self.gradients.insert(name, gradient);
                }
            }
        }
        self.pairs += batch.num_pairs;
        self.last = batch;
    }
}

/// What every batch of a step needs.
#[derive(Clone, Copy)]
struct Job<'a> {
    network: &'a dyn PairNetwork,
    teacher: Option<&'a dyn PairNetwork>,
    settings: &'a TrainSettings,
    folder: &'a Path,
    step: u64,
    /// Weight of a batch in the step's loss.
    share: f64,
    /// Factor of the loss, against underflow.
    factor: f64,
}

/// Loss, terms and gradients of a batch.
struct Learnt {
    values: Vec<(&'static str, f64)>,
    gradients: Gradients,
}

impl Job<'_> {
    /// All batches at once, a thread each.
    fn run_all(self, batches: &[HostBatch]) -> Vec<Result<Learnt, Error>> {
        if let [batch] = batches {
            return vec![self.run(batch)];
        }
        std::thread::scope(|scope| {
            let threads: Vec<_> = batches.iter().map(|batch| scope.spawn(move || self.run(batch))).collect();
            let joined = threads.into_iter().map(|thread| match thread.join() {
                Ok(learnt) => learnt,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            joined.collect()
        })
    }

    fn run(self, batch: &HostBatch) -> Result<Learnt, Error> {
        let mut targets = batch.targets(&self.network.device());
        if let Some(teacher) = self.teacher {
            targets =
                targets.taught_by(&teacher.forward(&batch.images)?, self.settings.teacher_min_confidence);
        }
        let mut values = Vec::new();
        let gradients = self.network.learn(&batch.images, &mut |output| {
            let loss = training_loss(output, &targets, &self.settings.loss);
            values = read(&loss);
            let total = values[0].1;
            if !total.is_finite() {
                return Err(diverged(self.folder, self.step, total, batch));
            }
            Ok(loss.total * (self.share * self.factor))
        })?;
        Ok(Learnt { values, gradients })
    }
}

fn length(gradients: &Gradients) -> f64 {
    norm(gradients).map_or(0.0, |length| f64::from(length.into_scalar::<f32>()))
}

/// The loss, under no name, and its terms, in one transfer.
fn read(loss: &Loss) -> Vec<(&'static str, f64)> {
    let mut all = vec![loss.total.clone().inner()];
    all.extend(loss.terms.iter().map(|(_, value)| value.clone().inner()));
    let values = Tensor::cat(all, 0).try_into_vec_as::<f32>().unwrap_or_else(|_| vec![f32::NAN]);
    let names = std::iter::once("").chain(loss.terms.iter().map(|(name, _)| *name));
    names.zip(values.into_iter().map(f64::from)).collect()
}

/// Keeps the batch and says where.
fn diverged(folder: &Path, step: u64, found: f64, batch: &HostBatch) -> Error {
    let path = folder.join(format!("diverged-step-{step:08}.safetensors"));
    match keep(&path, batch) {
        Ok(()) => Error::Diverged { step, found, batch: path },
        Err(error) => error,
    }
}

fn keep(path: &Path, batch: &HostBatch) -> Result<(), Error> {
    let arrays = batch.arrays();
    let entry = |(name, shape, _): &(&str, Vec<usize>, &[f32])| Entry {
        name: (*name).to_owned(),
        element: ElementType::F32,
        shape: shape.clone(),
    };
    let pairs =
        batch.provenance.iter().map(|from| format!("{} {} at {}", from.source, from.pair_id, from.position));
    let metadata = BTreeMap::from([("pairs".to_owned(), pairs.collect::<Vec<_>>().join("; "))]);
    let mut writer = Writer::create(path, arrays.iter().map(entry).collect(), &metadata)?;
    for (_, _, values) in &arrays {
        writer.write(values)?;
    }
    Ok(writer.finish()?)
}
