//! Threads that make samples ahead of their consumer.

use super::{Mixture, Replaced, Sample, TrainingBatch};
use crate::Error;
use std::any::Any;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// What a worker has made of a slot; a panic is carried to the consumer.
type Made = Result<Result<Sample, Error>, Box<dyn Any + Send>>;

/// Which sample is made next, and how far ahead the workers may go.
struct Progress {
    next_slot: u64,
    end: u64,
    stopped: bool,
}

struct Shared {
    mixture: Arc<Mixture>,
    progress: Mutex<Progress>,
    changed: Condvar,
}

impl Shared {
    fn progress(&self) -> MutexGuard<'_, Progress> {
        // Nothing panics while it holds the lock.
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a sample to make; `None` when loading ends.
    fn next_slot(&self) -> Option<u64> {
        let mut progress = self.progress();
        while progress.next_slot >= progress.end && !progress.stopped {
            progress = self.changed.wait(progress).unwrap_or_else(PoisonError::into_inner);
        }
        progress.next_slot += 1;
        (!progress.stopped).then_some(progress.next_slot - 1)
    }

    fn work(&self, made: &Sender<(u64, Made)>) {
        let batch_size = self.mixture.options().batch_size as u64;
        // One thread a worker: their number is what decides how much of the machine they take.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        while let Some(slot) = self.next_slot() {
            let make = || self.mixture.sample(slot / batch_size, (slot % batch_size) as usize);
            let result = catch_unwind(AssertUnwindSafe(|| match &pool {
                Ok(pool) => pool.install(make),
                Err(_) => make(),
            }));
            if made.send((slot, result)).is_err() {
                return;
            }
        }
    }
}

/// Batches in order, made by worker threads that stay a bounded number of batches ahead.
pub struct Loader {
    shared: Arc<Shared>,
    made: Receiver<(u64, Made)>,
    /// Samples that came before their turn.
    early: BTreeMap<u64, Made>,
    next_batch: u64,
    num_waits: u64,
    workers: Vec<JoinHandle<()>>,
}

impl Loader {
    /// Starts the workers; `first_batch` is 0, or where an earlier run ended.
    ///
    /// # Errors
    /// [`Error::Io`] if the system gives no thread.
    pub fn start(mixture: Arc<Mixture>, first_batch: u64) -> Result<Self, Error> {
        let options = mixture.options();
        let (batch_size, num_workers) = (options.batch_size as u64, options.num_workers);
        let next_slot = first_batch * batch_size;
        let end = next_slot + options.queue_batches as u64 * batch_size;
        let progress = Mutex::new(Progress { next_slot, end, stopped: false });
        let shared = Arc::new(Shared { mixture, progress, changed: Condvar::new() });
        let (sender, made) = channel();
        let mut loader = Self {
            shared,
            made,
            early: BTreeMap::new(),
            next_batch: first_batch,
            num_waits: 0,
            workers: Vec::new(),
        };
        for n in 0..num_workers {
            let (shared, sender) = (loader.shared.clone(), sender.clone());
            let thread = std::thread::Builder::new().name(format!("loader {n}"));
            let worker = thread.spawn(move || shared.work(&sender));
            loader.workers.push(worker.map_err(Error::io("start a thread for", "loader".as_ref()))?);
        }
        Ok(loader)
    }

    /// Number of the batch that comes next: where a later run goes on.
    pub fn position(&self) -> u64 {
        self.next_batch
    }

    /// How many batches were not ready when they were asked for.
    pub fn num_waits(&self) -> u64 {
        self.num_waits
    }

    /// The next batch; there is always one.
    ///
    /// # Errors
    /// Those of [`Mixture::sample`]; asking again goes on with the batch after.
    pub fn next_batch(&mut self) -> Result<TrainingBatch, Error> {
        let batch_idx = self.next_batch;
        let batch_size = self.shared.mixture.options().batch_size as u64;
        let slots = batch_idx * batch_size..(batch_idx + 1) * batch_size;
        let mut waited = false;
        let samples: Vec<Made> = slots.map(|slot| self.take(slot, &mut waited)).collect();
        self.num_waits += u64::from(waited);
        self.next_batch += 1;
        self.shared.progress().end += batch_size;
        self.shared.changed.notify_all();
        let mut batch = TrainingBatch {
            batch_idx,
            epoch: batch_idx / self.shared.mixture.batches_per_epoch(),
            pairs: Vec::with_capacity(samples.len()),
            replaced: Vec::<Replaced>::new(),
        };
        for made in samples {
            let (pair, replaced) = made.unwrap_or_else(|panic| resume_unwind(panic))?;
            batch.pairs.push(pair);
            batch.replaced.extend(replaced);
        }
        Ok(batch)
    }

    /// Waits for one sample.
    fn take(&mut self, slot: u64, waited: &mut bool) -> Made {
        loop {
            if let Some(made) = self.early.remove(&slot) {
                return made;
            }
            let received = match self.made.try_recv() {
                Err(TryRecvError::Empty) => {
                    *waited = true;
                    self.made.recv().map_err(|_| ())
                }
                other => other.map_err(|_| ()),
            };
            match received {
                Ok((of, made)) => self.early.insert(of, made),
                // The workers end when the loader is dropped, never before.
                Err(()) => return Err(Box::new("the loader's workers are gone")),
            };
        }
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.shared.progress().stopped = true;
        self.shared.changed.notify_all();
        for worker in self.workers.drain(..) {
            // Its panics are carried to the consumer as they happen.
            let _ = worker.join();
        }
    }
}
