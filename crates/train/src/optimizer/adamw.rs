//! Adam with decoupled weight decay.
//!
//! # Source
//! Loshchilov and Hutter 2019, "Decoupled Weight Decay Regularization", algorithm 2; groups as in Touvron et al. 2021,
//! "DeiT": vectors and biases do not decay.

use crate::Error;
use crate::network::{Gradients, PairNetwork};
use burn_tensor::Tensor;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Settings of the optimiser.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamWSettings {
    /// Decay of the mean gradient.
    pub beta_1: f64,
    /// Decay of the mean squared gradient.
    pub beta_2: f64,
    /// Added to the root of the mean squared gradient.
    pub epsilon: f64,
    /// Share of a decaying parameter lost per step, in learning rates.
    pub weight_decay: f64,
}

impl Default for AdamWSettings {
    fn default() -> Self {
        Self { beta_1: 0.9, beta_2: 0.95, epsilon: 1e-8, weight_decay: 0.05 }
    }
}

/// What the optimiser remembers of a parameter.
#[derive(Debug, Clone)]
pub struct Moments {
    /// Steps that had a gradient.
    pub steps: u64,
    /// Running mean of the gradient.
    pub mean: Tensor<1>,
    /// Running mean of its square.
    pub square: Tensor<1>,
}

/// Adam with decoupled weight decay. A parameter without gradient is passed over: it does not decay either.
#[derive(Debug, Clone)]
pub struct AdamW {
    settings: AdamWSettings,
    moments: BTreeMap<String, Moments>,
}

/// Whether a parameter decays: neither vectors nor biases do.
pub fn decays(name: &str, shape: &[usize]) -> bool {
    shape.len() > 1 && !name.ends_with(".bias")
}

impl AdamW {
    /// An optimiser that has made no step.
    pub fn new(settings: AdamWSettings) -> Self {
        Self { settings, moments: BTreeMap::new() }
    }

    /// An optimiser that goes on.
    pub fn resume(settings: AdamWSettings, moments: BTreeMap<String, Moments>) -> Self {
        Self { settings, moments }
    }

    /// What it remembers.
    pub fn moments(&self) -> &BTreeMap<String, Moments> {
        &self.moments
    }

    /// One step.
    ///
    /// # Errors
    /// What the network says about its new parameters.
    pub fn step(
        &mut self,
        network: &mut dyn PairNetwork,
        mut gradients: Gradients,
        learning_rate: f64,
    ) -> Result<(), Error> {
        network.update(&mut |name, shape, value| {
            let gradient = gradients.remove(name)?;
            Some(self.stepped(name, shape, value, gradient, learning_rate))
        })
    }

    fn stepped(
        &mut self,
        name: &str,
        shape: &[usize],
        value: Tensor<1>,
        gradient: Tensor<1>,
        learning_rate: f64,
    ) -> Tensor<1> {
        let AdamWSettings { beta_1, beta_2, epsilon, weight_decay } = self.settings;
        let old = self.moments.remove(name).unwrap_or_else(|| Moments {
            steps: 0,
            mean: gradient.zeros_like(),
            square: gradient.zeros_like(),
        });
        let steps = old.steps + 1;
        let mean = old.mean * beta_1 + gradient.clone() * (1.0 - beta_1);
        let square = old.square * beta_2 + gradient.square() * (1.0 - beta_2);
        let (correct_1, correct_2) = (1.0 - beta_1.powf(steps as f64), 1.0 - beta_2.powf(steps as f64));
        let spread = square.clone().sqrt() / correct_2.sqrt() + epsilon;
        let decayed = if decays(name, shape) { value * (1.0 - learning_rate * weight_decay) } else { value };
        let stepped = decayed - mean.clone() / spread * (learning_rate / correct_1);
        self.moments.insert(name.to_owned(), Moments { steps, mean, square });
        stepped
    }
}
