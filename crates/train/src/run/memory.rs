//! What a run will take of the memory, before it takes it.

use super::settings::TrainSettings;
use crate::Error;
use crate::network::PairNetwork;

const FLOAT: u64 = 4;
/// Similarities of all matches with each other that come and go while one item's are compared or derived; besides, those of
/// every item wait for the gradient.
const PASSING_SIMILARITIES: u64 = 2;

/// Bytes of a run's parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Weights, their gradients, the optimiser's moments, the averaged weights, and what the network holds beside them.
    pub parameters: u64,
    /// What one pair of a batch takes.
    pub per_pair: u64,
    /// The similarities of one item's matches.
    pub matching: u64,
    /// Batches that are computed side by side.
    pub at_a_time: u64,
}

impl MemoryEstimate {
    /// For pictures of `size` (rows, columns) with `num_matches` matches a pair, and up to `at_a_time` batches of a step side
    /// by side.
    pub fn new(
        network: &dyn PairNetwork,
        settings: &TrainSettings,
        size: [usize; 2],
        num_matches: usize,
        at_a_time: usize,
    ) -> Self {
        let (mut all, mut learning) = (0, 0);
        network.visit(&mut |name, shape, _| {
            let len = shape.iter().product::<usize>() as u64;
            all += len;
            learning += if network.learns(name) { len } else { 0 };
        });
        let averaged = if settings.average_decay.is_some() { learning } else { 0 };
        let compared = num_matches.min(settings.loss.matching.block);
        let at_a_time = at_a_time.clamp(1, settings.accumulate.max(1)) as u64;
        Self {
            // Each batch's gradient, mean, mean square.
            parameters: FLOAT * (all + averaged + (at_a_time + 2) * learning) + network.resident_bytes(),
            per_pair: network.activation_bytes(size),
            matching: FLOAT * (compared * num_matches) as u64,
            at_a_time,
        }
    }

    /// Bytes of a run with batches of `pairs`.
    pub fn bytes(&self, pairs: usize) -> u64 {
        // Each pair is two items.
        let kept = pairs as u64 * (self.per_pair + 2 * self.matching);
        self.parameters + self.at_a_time * (kept + PASSING_SIMILARITIES * self.matching)
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
        let fixed = self.bytes(0);
        Err(Error::OutOfMemoryForeseen {
            needed_gib: gib(needed),
            available_gib: gib(available),
            batch_that_fits: (available.saturating_sub(fixed) / (self.bytes(1) - fixed).max(1)) as usize,
        })
    }
}
