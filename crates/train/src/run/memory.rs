//! What a run will take of the memory, before it takes it.

use super::settings::TrainSettings;
use crate::Error;
use crate::network::PairNetwork;

const FLOAT: u64 = 4;
/// Similarities of all matches of an item with each other, and what its gradient keeps of them at the same time.
const SIMILARITIES: u64 = 4;

/// Bytes of a run's parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Weights, their gradients, the optimiser's moments and the averaged weights.
    pub parameters: u64,
    /// What one pair of a batch takes.
    pub per_pair: u64,
    /// What one item's matches take while they are compared.
    pub matching: u64,
}

impl MemoryEstimate {
    /// For pictures of `size` (rows, columns) with `num_matches` matches a pair.
    pub fn new(
        network: &dyn PairNetwork,
        settings: &TrainSettings,
        size: [usize; 2],
        num_matches: usize,
    ) -> Self {
        let (mut all, mut learning) = (0, 0);
        network.visit(&mut |name, shape, _| {
            let len = shape.iter().product::<usize>() as u64;
            all += len;
            learning += if network.learns(name) { len } else { 0 };
        });
        let averaged = if settings.average_decay.is_some() { all } else { 0 };
        let compared = num_matches.min(settings.loss.matching.block) as u64;
        Self {
            // Gradient, mean, mean square.
            parameters: FLOAT * (all + averaged + 3 * learning),
            per_pair: network.activation_bytes(size),
            matching: SIMILARITIES * FLOAT * compared * compared,
        }
    }

    /// Bytes of a run with batches of `pairs`.
    pub fn bytes(&self, pairs: usize) -> u64 {
        // Each pair is two items, whose similarities all wait for the gradient.
        self.parameters + pairs as u64 * (self.per_pair + 2 * self.matching)
    }

    /// Whether a run fits into `available` bytes.
    ///
    /// # Errors
    /// [`Error::OutOfMemoryForeseen`] with the batch that would.
    pub fn check(&self, pairs: usize, available: u64) -> Result<(), Error> {
        let needed = self.bytes(pairs);
        if needed <= available {
            return Ok(());
        }
        let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
        let one = (self.bytes(1) - self.parameters).max(1);
        Err(Error::OutOfMemoryForeseen {
            needed_gib: gib(needed),
            available_gib: gib(available),
            batch_that_fits: (available.saturating_sub(self.parameters) / one) as usize,
        })
    }
}
