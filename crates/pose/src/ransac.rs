//! Random sample consensus with local optimisation: one loop for every kind of model.
//!
//! Draws minimal samples, scores each model on the data with a truncated squared error (MSAC), improves every new best one locally (LO) and
//! stops when, at the share of inliers seen, a better sample would have come with the asked confidence. With an order, samples
//! come from a growing set of the best data first (PROSAC).
//!
//! # Source
//! Fischler, Bolles 1981; Torr, Zisserman 2000 (MSAC); Chum, Matas, Kittler 2003 (LO); Chum, Matas 2005 (PROSAC); Lebeda, Matas,
//! Chum 2012, "Fixing the locally optimized RANSAC".

use crate::random::Random;

/// How well a model explains the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// What is minimised.
    pub cost: f64,
    /// Data that agree.
    pub inliers: usize,
}

impl Score {
    /// Worse than any.
    pub const WORST: Self = Self { cost: f64::INFINITY, inliers: 0 };
}

/// What the loop needs to know of a kind of model.
pub trait Estimator {
    /// The model.
    type Model: Copy;
    /// Data in a minimal sample.
    const SAMPLE: usize;

    /// Number of data.
    fn num_data(&self) -> usize;

    /// Appends the models through a minimal sample.
    fn solve(&mut self, sample: &[usize], models: &mut Vec<Self::Model>);

    /// Scores a model; none as soon as it is plain that it will not be better than `best`.
    fn score(&self, model: &Self::Model, best: &Score) -> Option<Score>;

    /// A model nearby that fits its inliers better, if there is one.
    fn improve(&mut self, model: &Self::Model) -> Option<Self::Model>;
}

/// Whether a new best model is improved before it competes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Local {
    /// Models stay as their minimal sample made them.
    Keep,
    /// [`Estimator::improve`] is called.
    Improve,
}

/// How to search.
#[derive(Debug, Clone)]
pub struct Search<'a> {
    /// Seed of the samples.
    pub seed: u64,
    /// Probability with which no better sample was missed.
    pub confidence: f64,
    /// Samples that are always drawn.
    pub min_iterations: usize,
    /// Samples after which the search ends.
    pub max_iterations: usize,
    /// Local optimisation.
    pub local: Local,
    /// Data from the most to the least promising; none where they are all alike.
    pub order: Option<&'a [usize]>,
}

/// What the search found.
#[derive(Debug, Clone, Copy)]
pub struct Found<M> {
    /// The best model.
    pub model: M,
    /// Its score.
    pub score: Score,
    /// Samples drawn.
    pub iterations: usize,
}

/// Samples of PROSAC after which it draws from everything (the paper's `T_N`).
const PROSAC_SAMPLES: f64 = 20_000.0;
/// Improvement is repeated while the cost falls, at most this often.
const MAX_IMPROVEMENTS: usize = 3;

/// Searches; none where there are too few data or no sample gave a model.
pub fn search<E: Estimator>(estimator: &mut E, search: &Search<'_>) -> Option<Found<E::Model>> {
    let n = estimator.num_data();
    if n < E::SAMPLE {
        return None;
    }
    let mut sampler = Sampler::new(search, n, E::SAMPLE);
    let mut models = Vec::with_capacity(16);
    let mut sample = vec![0; E::SAMPLE];
    let mut best: Option<Found<E::Model>> = None;
    let mut best_score = Score::WORST;
    let mut needed = search.max_iterations;
    let mut iteration = 0;
    while iteration < needed.max(search.min_iterations).min(search.max_iterations) {
        iteration += 1;
        sampler.draw(&mut sample);
        models.clear();
        estimator.solve(&sample, &mut models);
        let mut improved = None;
        for model in &models {
            if let Some(score) = estimator.score(model, &best_score)
                && score.cost < best_score.cost
            {
                best_score = score;
                improved = Some(*model);
            }
        }
        let Some(mut model) = improved else { continue };
        if search.local == Local::Improve {
            for _ in 0..MAX_IMPROVEMENTS {
                let Some(next) = estimator.improve(&model) else { break };
                let Some(score) = estimator.score(&next, &best_score) else { break };
                if score.cost >= best_score.cost {
                    break;
                }
                let gain = 1.0 - score.cost / best_score.cost;
                (model, best_score) = (next, score);
                if gain < 0.01 {
                    break;
                }
            }
        }
        best = Some(Found { model, score: best_score, iterations: iteration });
        needed = samples_needed(search.confidence, best_score.inliers as f64 / n as f64, E::SAMPLE);
    }
    best.map(|found| Found { iterations: iteration, ..found })
}

/// Samples after which all-inlier ones were drawn with the given confidence.
pub fn samples_needed(confidence: f64, inlier_share: f64, sample: usize) -> usize {
    let good = inlier_share.powi(sample as i32);
    if good >= 1.0 {
        return 1;
    }
    let needed = ((1.0 - confidence).ln() / (-good).ln_1p()).ceil();
    if needed.is_finite() && needed >= 0.0 { needed as usize } else { usize::MAX }
}

/// Draws samples, uniformly or from a growing set of the best.
struct Sampler<'a> {
    random: Random,
    order: Option<&'a [usize]>,
    num: usize,
    size: usize,
    drawn: f64,
    subset: usize,
    subset_until: f64,
    growth: f64,
}

impl<'a> Sampler<'a> {
    fn new(search: &Search<'a>, num: usize, size: usize) -> Self {
        let order = search.order.filter(|order| order.len() == num);
        // T_m: how many of T_N uniform samples would come from the best m alone.
        let mut growth = PROSAC_SAMPLES;
        for i in 0..size {
            growth *= (size - i) as f64 / (num - i) as f64;
        }
        Self {
            random: Random::new(search.seed),
            order,
            num,
            size,
            drawn: 0.0,
            subset: size,
            subset_until: 1.0,
            growth,
        }
    }

    fn draw(&mut self, sample: &mut [usize]) {
        let Some(order) = self.order else {
            self.random.distinct(self.num, sample);
            return;
        };
        self.drawn += 1.0;
        while self.drawn > self.subset_until && self.subset < self.num {
            let next = self.growth * (self.subset + 1) as f64 / (self.subset + 1 - self.size) as f64;
            self.subset_until += (next - self.growth).ceil();
            self.growth = next;
            self.subset += 1;
        }
        if self.subset >= self.num {
            self.random.distinct(self.num, sample);
        } else {
            // Every sample of this round holds the newest datum, so that none is drawn twice in effect.
            let last = self.size - 1;
            self.random.distinct((self.subset - 1).max(last), &mut sample[..last]);
            sample[last] = self.subset - 1;
        }
        for index in sample {
            *index = order[*index];
        }
    }
}

/// Adds up block scores and gives up early where a model cannot win.
///
/// A model is dropped when what it has cost already exceeds the best one's whole cost, or when its rate so far is above the best
/// one's by more than five standard deviations of a sum of that many terms in [0, limit] (data must come in random order).
pub struct Tally {
    limit: f64,
    total: usize,
    best: f64,
    seen: usize,
    cost: f64,
    inliers: usize,
}

impl Tally {
    /// For `total` data whose costs are at most `limit`, against a best cost.
    pub fn new(limit: f64, total: usize, best: &Score) -> Self {
        Self { limit, total, best: best.cost, seen: 0, cost: 0.0, inliers: 0 }
    }

    /// Takes a block in; false where the model is to be dropped.
    pub fn add(&mut self, data: usize, cost: f64, inliers: usize) -> bool {
        self.seen += data;
        self.cost += cost;
        self.inliers += inliers;
        if self.cost >= self.best {
            return false;
        }
        let expected = self.best * self.seen as f64 / self.total as f64;
        self.best.is_infinite() || self.cost < expected + 2.5 * self.limit * (self.seen as f64).sqrt()
    }

    /// The whole score.
    pub fn score(&self) -> Score {
        Score { cost: self.cost, inliers: self.inliers }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needed_samples_are_those_of_the_formula() {
        // ln(1e-4) / ln(1 − 0.7⁵) = 50.05
        assert_eq!(samples_needed(0.9999, 0.7, 5), 51);
        assert_eq!(samples_needed(0.9999, 1.0, 5), 1);
        assert_eq!(samples_needed(0.9999, 0.0, 5), usize::MAX);
    }

    #[test]
    fn ordered_samples_start_with_the_best() {
        let order: Vec<usize> = (0..1000).rev().collect();
        let search = Search {
            seed: 1,
            confidence: 0.99,
            min_iterations: 0,
            max_iterations: 100,
            local: Local::Keep,
            order: Some(&order),
        };
        let mut sampler = Sampler::new(&search, 1000, 5);
        let mut sample = [0; 5];
        sampler.draw(&mut sample);
        let mut first = sample;
        first.sort_unstable();
        assert_eq!(first, [995, 996, 997, 998, 999]);
        for _ in 0..200 {
            sampler.draw(&mut sample);
            let mut sorted = sample;
            sorted.sort_unstable();
            assert!(sorted.windows(2).all(|w| w[0] < w[1]) && sorted[4] < 1000);
        }
    }
}
