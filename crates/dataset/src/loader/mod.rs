//! Training pairs from several sources, made by worker threads, in an order that the seed alone decides.
//!
//! | you want to | open |
//! | --- | --- |
//! | name what is learned from | [`Source`], [`Mixture`] |
//! | be fed | [`Loader`]: batches in order, the same for any number of workers |
//! | make one sample again | [`Mixture::sample`] |
//! | know that nothing leaks into validation | [`shared_ground`], [`Source::keep_off`] |
//!
//! Libraries read no clock: how long the consumer waits is for the caller of [`Loader::next_batch`] to measure;
//! [`Loader::num_waits`] counts how often it had to.

mod fetch;
mod flight;
mod ground;
mod order;
mod source;
mod workers;

pub use ground::{SharedGround, shared_ground};
pub use order::{Draw, Order};
pub use source::Source;
pub use workers::Loader;

use crate::Error;
use crate::augment::{Augmentation, UndevelopedView};
use crate::correspondence::{MatchPool, MatchRule, Matches, sights};
use crate::covisibility::Sight;
use crate::plan::Interval;
use crate::plan::interval::check_number;
use crate::rng::rng;
use crate::sample::{Provenance, TrainingPair, TrainingView};
use fetch::{Fetched, Request};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex};

/// What is done about a pair that cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Faults {
    /// Loading ends with an error. Pairs of a campaign that find no place are replaced all the same.
    #[default]
    Refuse,
    /// Another pair of its source takes its place, and the batch tells of it.
    Replace,
}

/// How pairs are loaded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoaderOptions {
    /// Decides order and every draw.
    pub seed: u64,
    /// Pairs in a batch; what an epoch has left over is dropped.
    pub batch_size: usize,
    /// Width and height of the views; each batch has one of these sizes.
    pub sizes: Vec<[usize; 2]>,
    /// Pairs in an epoch; all of every source where absent.
    pub pairs_per_epoch: Option<u64>,
    /// Matches of a pair (0: none).
    pub num_matches: usize,
    /// Share of them that is false.
    pub negative_share: f64,
    /// Which pixels match.
    pub match_rule: MatchRule,
    /// What is done to the views.
    pub augmentation: Augmentation,
    /// What is done about pairs that cannot be used.
    pub faults: Faults,
    /// Threads that make samples.
    pub num_workers: usize,
    /// Batches that wait at most.
    pub queue_batches: usize,
}

impl Default for LoaderOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            batch_size: 2,
            sizes: vec![[512, 512]],
            pairs_per_epoch: None,
            num_matches: 8192,
            negative_share: 0.5,
            match_rule: MatchRule::default(),
            augmentation: Augmentation::default(),
            faults: Faults::default(),
            num_workers: 2,
            queue_batches: 4,
        }
    }
}

impl LoaderOptions {
    fn check(&self) -> Result<(), Error> {
        let at_least_one = Interval::new(1.0, 1e6);
        check_number("loader.batch_size", self.batch_size as f64, at_least_one)?;
        check_number("loader.num_workers", self.num_workers as f64, at_least_one)?;
        check_number("loader.queue_batches", self.queue_batches as f64, at_least_one)?;
        check_number("loader.sizes", self.sizes.len() as f64, at_least_one)?;
        check_number("loader.negative_share", self.negative_share, Interval::new(0.0, 1.0))?;
        for [width, height] in &self.sizes {
            let side = Interval::new(2.0, 65_536.0);
            check_number("loader.sizes", *width as f64, side)?;
            check_number("loader.sizes", *height as f64, side)?;
            let pixels = (width * height) as f64;
            check_number("loader.num_matches", self.num_matches as f64, Interval::new(0.0, pixels))?;
        }
        self.augmentation.check("loader.augmentation")
    }
}

/// A pair that was left out, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Replaced {
    /// Where its place was.
    pub position: u64,
    /// What was wrong with it.
    pub reason: String,
}

/// Pairs of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingBatch {
    /// Number of the batch since the start of training; loading can begin at any.
    pub batch_idx: u64,
    /// Epoch that it belongs to.
    pub epoch: u64,
    /// The pairs.
    pub pairs: Vec<TrainingPair>,
    /// Pairs that others took the place of.
    pub replaced: Vec<Replaced>,
}

/// A sample, and the pairs that it took the place of.
type Sample = (TrainingPair, Vec<Replaced>);

/// Other pairs tried in the place of one that cannot be used.
const MAX_REPLACEMENTS: u64 = 32;

/// Sources, their order, and how samples are made of them.
#[derive(Debug)]
pub struct Mixture {
    sources: Vec<Source>,
    order: Order,
    options: LoaderOptions,
    /// The orders of the epochs in use.
    epochs: Mutex<Vec<(u64, Arc<Vec<Draw>>)>>,
}

impl Mixture {
    /// Of sources, in proportion to their weights.
    ///
    /// # Errors
    /// [`Error::Value`] for options outside their range, and those of [`Order::new`].
    pub fn new(sources: Vec<Source>, options: LoaderOptions) -> Result<Self, Error> {
        options.check()?;
        let counts = sources.iter().map(Source::num_pairs).collect();
        let weights: Vec<f64> = match options.pairs_per_epoch {
            // Where an epoch is all pairs, a weight says how many times each comes in it.
            None => sources.iter().map(|source| source.weight * source.num_pairs() as f64).collect(),
            Some(_) => sources.iter().map(|source| source.weight).collect(),
        };
        let order = Order::new(counts, &weights, options.pairs_per_epoch, options.seed)?;
        if order.pairs_per_epoch() < options.batch_size as u64 {
            return Err(Error::Value {
                key: "loader.batch_size".into(),
                expected: format!("at most {}, the pairs of an epoch", order.pairs_per_epoch()),
                found: options.batch_size.to_string(),
            });
        }
        Ok(Self { sources, order, options, epochs: Mutex::default() })
    }

    /// The sources.
    pub fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// How pairs are loaded.
    pub fn options(&self) -> &LoaderOptions {
        &self.options
    }

    /// The order of the pairs.
    pub fn order(&self) -> &Order {
        &self.order
    }

    /// Whole batches in an epoch.
    pub fn batches_per_epoch(&self) -> u64 {
        self.order.pairs_per_epoch() / self.options.batch_size as u64
    }

    /// The size of a batch's views.
    pub fn size_of_batch(&self, batch_idx: u64) -> [usize; 2] {
        let mut stream = rng(self.options.seed, "batch", batch_idx, "size");
        self.options.sizes[stream.index(self.options.sizes.len())]
    }

    /// Makes pair number `idx_in_batch` of a batch; again the same whenever it is asked for.
    ///
    /// # Errors
    /// [`Error::Unusable`] and the errors of reading for a pair that cannot be used, or too many one after the other.
    pub fn sample(&self, batch_idx: u64, idx_in_batch: usize) -> Result<Sample, Error> {
        let (epoch, batch) = (batch_idx / self.batches_per_epoch(), batch_idx % self.batches_per_epoch());
        let in_epoch = batch * self.options.batch_size as u64 + idx_in_batch as u64;
        let first = self.draws(epoch)[in_epoch as usize];
        let position = epoch * self.order.pairs_per_epoch() + in_epoch;
        let size = self.size_of_batch(batch_idx);
        let (mut draw, mut replaced) = (first, Vec::new());
        loop {
            let error = match self.make(&draw, position, size) {
                Ok(pair) => return Ok((pair, replaced)),
                Err(error) => error,
            };
            let of_campaign = matches!(self.sources[draw.source_idx].kind, source::Kind::Flight(_));
            let may_replace = self.options.faults == Faults::Replace
                || (of_campaign && matches!(error, Error::Unusable { .. }));
            if !may_replace || replaced.len() as u64 >= MAX_REPLACEMENTS {
                return Err(error);
            }
            replaced.push(Replaced { position, reason: error.to_string() });
            draw = self.order.substitute(&first, position, replaced.len() as u64);
        }
    }

    fn draws(&self, epoch: u64) -> Arc<Vec<Draw>> {
        // A thread that panicked here has left a whole list behind.
        let mut epochs = self.epochs.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, draws)) = epochs.iter().find(|(known, _)| *known == epoch) {
            return draws.clone();
        }
        let draws = Arc::new(self.order.epoch(epoch));
        // Workers are at most one epoch apart.
        epochs.retain(|(known, _)| known.abs_diff(epoch) <= 1);
        epochs.push((epoch, draws.clone()));
        draws
    }

    fn make(&self, draw: &Draw, position: u64, size: [usize; 2]) -> Result<TrainingPair, Error> {
        let LoaderOptions { seed, augmentation, match_rule, .. } = &self.options;
        let (source, seed) = (&self.sources[draw.source_idx], *seed);
        let request = Request { augmentation, match_rule: *match_rule, size, seed, position };
        let Fetched { pair_id, lights, views, has_depth, sights: cast, is_shaped } =
            source.fetch(draw, &request)?;
        let (views, is_copy) = augmentation.reshape(views, is_shaped, size, seed, position)?;
        let matches = if has_depth {
            self.matches(&views, cast.filter(|_| !is_copy), position)?
        } else {
            Matches::default()
        };
        let [a, b] = views;
        let develop = |view, which| -> TrainingView { augmentation.develop(view, seed, position, which) };
        Ok(TrainingPair {
            views: [develop(a, "a"), develop(b, "b")],
            matches,
            is_metric: source.is_metric,
            provenance: Provenance { source: source.name.clone(), pair_id, position, lights },
        })
    }

    fn matches(
        &self,
        views: &[UndevelopedView; 2],
        cast: Option<[Vec<Sight>; 2]>,
        position: u64,
    ) -> Result<Matches, Error> {
        let [a, b] = views.each_ref().map(UndevelopedView::sighted);
        if self.options.num_matches == 0 {
            return Ok(Matches::default());
        }
        let pool = match self.options.match_rule {
            MatchRule::Reciprocal => MatchPool::reciprocal(a, b),
            MatchRule::Seen => {
                let [a_in_b, b_in_a] = cast.unwrap_or_else(|| [sights(a, b), sights(b, a)]);
                MatchPool::seen(a, b, &a_in_b, &b_in_a)
            }
        };
        let mut stream = rng(self.options.seed, "sample", position, "matches");
        pool.sample(self.options.num_matches, self.options.negative_share, &mut stream)
    }
}

#[cfg(test)]
mod tests;
