//! An exponential moving average of the weights: what is validated and kept as best, while training goes on beside it.

use crate::network::PairNetwork;
use burn_tensor::Tensor;
use std::collections::BTreeMap;

/// A moving average of the weights of a network that learn.
#[derive(Debug, Clone)]
pub(crate) struct WeightAverage {
    decay: f64,
    values: BTreeMap<String, Tensor<1>>,
}

impl WeightAverage {
    /// Starts at the network's weights, or goes on from `values`.
    pub fn new(decay: f64, network: &dyn PairNetwork, mut values: BTreeMap<String, Tensor<1>>) -> Self {
        values.retain(|name, _| network.learns(name));
        if values.is_empty() {
            network.visit(&mut |name, _, value| {
                if network.learns(name) {
                    values.insert(name.to_owned(), value);
                }
            });
        }
        Self { decay, values }
    }

    /// Moves towards the network's weights.
    pub fn record(&mut self, network: &dyn PairNetwork) {
        let decay = self.decay;
        network.visit(&mut |name, _, value| {
            if let Some(average) = self.values.get_mut(name) {
                average.inplace(|average| average * decay + value * (1.0 - decay));
            }
        });
    }

    /// The averaged weights.
    pub fn values(&self) -> &BTreeMap<String, Tensor<1>> {
        &self.values
    }
}
