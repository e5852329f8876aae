//! Batches from the loader of crate `dataset`.

use super::trainer::BatchSource;
use crate::Error;
use crate::batch::{AssemblySettings, HostBatch};
use selenograph_dataset::loader::{Loader, Mixture};
use selenograph_dataset::rng::rng;
use std::sync::Arc;

/// Batches from the loader of crate `dataset`.
pub struct LoaderFeed {
    mixture: Arc<Mixture>,
    loader: Loader,
    settings: AssemblySettings,
    observer: Box<dyn FnMut(&str)>,
}

impl LoaderFeed {
    /// Starts at batch number `first`; `observer` is told of pairs that were left out, and why.
    ///
    /// # Errors
    /// Those of [`Loader::start`].
    pub fn start(
        mixture: Arc<Mixture>,
        first: u64,
        settings: AssemblySettings,
        observer: Box<dyn FnMut(&str)>,
    ) -> Result<Self, Error> {
        let loader = Loader::start(mixture.clone(), first)?;
        Ok(Self { mixture, loader, settings, observer })
    }
}

impl BatchSource for LoaderFeed {
    fn batches_per_epoch(&self) -> u64 {
        self.mixture.batches_per_epoch()
    }

    fn next_batch(&mut self) -> Result<HostBatch, Error> {
        let batch = self.loader.next_batch()?;
        for left_out in &batch.replaced {
            (self.observer)(&left_out.reason);
        }
        let mut stream = rng(self.mixture.options().seed, "batch", batch.batch_idx, "match blocks");
        HostBatch::assemble(&batch.pairs, &self.settings, &mut stream)
    }
}

/// The first `pairs` pairs of a mixture, for a validation: in batches of its own size.
///
/// # Errors
/// Those of the pairs.
pub fn held_out(
    mixture: &Mixture,
    pairs: usize,
    settings: &AssemblySettings,
) -> Result<Vec<HostBatch>, Error> {
    let size = mixture.options().batch_size;
    let count = (pairs as u64).div_ceil(size as u64).min(mixture.batches_per_epoch());
    (0..count)
        .map(|batch| {
            let samples = (0..size).map(|idx| Ok(mixture.sample(batch, idx)?.0));
            let pairs: Vec<_> = samples.collect::<Result<_, Error>>()?;
            let mut stream = rng(mixture.options().seed, "batch", batch, "match blocks");
            HostBatch::assemble(&pairs, settings, &mut stream)
        })
        .collect()
}
