//! What a run is told.

use crate::Error;
use crate::loss::LossSettings;
use crate::model_network::Frozen;
use crate::optimizer::{AdamWSettings, Schedule};
use serde::{Deserialize, Serialize};

/// In which numbers a graphics card multiplies; elsewhere all is f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// bf16 around linear layers and convolutions.
    Bf16,
}

/// When checkpoints are written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CheckpointSettings {
    /// Minutes between two.
    pub every_min: f64,
    /// How many are kept.
    pub keep: usize,
}

impl Default for CheckpointSettings {
    fn default() -> Self {
        Self { every_min: 10.0, keep: 2 }
    }
}

/// When the network is judged on held-out pairs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ValidationSettings {
    /// Epochs between two; 0 for none but the last.
    pub every_epochs: f64,
    /// Pairs of it.
    pub pairs: usize,
    /// Pairs, spread over the held-out ones, that are also evaluated: pose and points by the definitions of `evaluate`. 0 for
    /// none.
    pub evaluated: usize,
}

impl Default for ValidationSettings {
    fn default() -> Self {
        Self { every_epochs: 1.0, pairs: 64, evaluated: 8 }
    }
}

/// What a run is told about learning; where its pairs come from is the source's affair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainSettings {
    /// Epochs.
    pub epochs: f64,
    /// Batches of a step.
    pub accumulate: usize,
    /// Learning rate after the warm-up.
    pub learning_rate: f64,
    /// Learning rate at the end.
    pub min_learning_rate: f64,
    /// Epochs of warm-up.
    pub warmup_epochs: f64,
    /// Which parameters stay.
    pub frozen: Frozen,
    /// Keep what a frozen encoder makes of pictures, up to so many MiB: worth it where the same picture comes again, which
    /// it does without augmentation only.
    pub encoding_cache_mib: usize,
    /// Numbers on a graphics card.
    pub precision: Precision,
    /// Keep only what goes into each block of the transformers and compute the rest a second time: less memory, more time.
    pub recompute: bool,
    /// Scale the loss up and the gradients down, and leave out steps that overflow.
    pub loss_scaling: bool,
    /// Longest gradient; longer ones are shortened.
    pub clip: Option<f64>,
    /// Decay per step of an average of the weights, which is then what is validated and kept as best.
    pub average_decay: Option<f64>,
    /// A pixel teaches if its teacher's confidence reaches this; for runs with a teacher.
    pub teacher_min_confidence: f64,
    /// The losses.
    pub loss: LossSettings,
    /// The optimiser.
    pub optimizer: AdamWSettings,
    /// Checkpoints.
    pub checkpoint: CheckpointSettings,
    /// Validation.
    pub validation: ValidationSettings,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            epochs: 25.0,
            accumulate: 1,
            learning_rate: 3e-5,
            min_learning_rate: 2e-7,
            warmup_epochs: 0.0,
            frozen: Frozen::Encoder,
            encoding_cache_mib: 0,
            precision: Precision::F32,
            recompute: false,
            loss_scaling: false,
            clip: None,
            average_decay: None,
            teacher_min_confidence: 1.5,
            loss: LossSettings::default(),
            optimizer: AdamWSettings::default(),
            checkpoint: CheckpointSettings::default(),
            validation: ValidationSettings::default(),
        }
    }
}

impl TrainSettings {
    /// The learning rate over the run.
    pub fn schedule(&self) -> Schedule {
        Schedule {
            peak: self.learning_rate,
            minimum: self.min_learning_rate,
            warmup_epochs: self.warmup_epochs,
            epochs: self.epochs,
        }
    }

    /// Whether the numbers make sense.
    ///
    /// # Errors
    /// [`Error::Settings`] naming the key.
    pub fn check(&self) -> Result<(), Error> {
        let share = |value: f64| (0.0..1.0).contains(&value);
        let checks = [
            ("epochs", self.epochs > self.warmup_epochs, "more than warmup_epochs"),
            ("accumulate", self.accumulate > 0, "one or more"),
            ("learning_rate", self.learning_rate > 0.0 && self.learning_rate.is_finite(), "above zero"),
            ("min_learning_rate", self.min_learning_rate >= 0.0, "zero or more"),
            ("warmup_epochs", self.warmup_epochs >= 0.0, "zero or more"),
            ("clip", self.clip.is_none_or(|limit| limit > 0.0), "above zero"),
            ("average_decay", self.average_decay.is_none_or(share), "from 0 to below 1"),
            ("optimizer.beta_1", share(self.optimizer.beta_1), "from 0 to below 1"),
            ("optimizer.beta_2", share(self.optimizer.beta_2), "from 0 to below 1"),
            ("loss.matching.temperature", self.loss.matching.temperature > 0.0, "above zero"),
            ("loss.matching.block", self.loss.matching.block > 0, "one or more"),
            ("checkpoint.every_min", self.checkpoint.every_min >= 0.0, "zero or more"),
        ];
        match checks.iter().find(|(_, holds, _)| !holds) {
            Some((key, _, expected)) => {
                Err(Error::Settings { what: format!("`{key}`"), message: format!("expected {expected}") })
            }
            None => Ok(()),
        }
    }
}
