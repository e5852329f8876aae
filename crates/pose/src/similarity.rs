//! Robust similarity between two point clouds that correspond point by point.
//!
//! Deterministic and made for a million points: hypotheses come from, and are ranked on, a fixed subsample; the refits use every point.

use crate::random::Random;
use crate::ransac::{Estimator, Local, Score, Search, Tally, search};
use crate::solvers::umeyama::{Moments, Scaling, umeyama};
use selenograph_geometry::{Frame, Point3, Sim3};

/// How to align.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimilarityOptions {
    /// Largest distance of an inlier, in units of the target. None: three times the median distance that the best hypothesis
    /// leaves (found by least median of squares, which bears up to half outliers).
    pub threshold: Option<f64>,
    /// Seed of the subsample and of the samples.
    pub seed: u64,
    /// Probability with which no better sample was missed.
    pub confidence: f64,
    /// Samples after which the search ends.
    pub max_iterations: usize,
    /// Points of the subsample.
    pub subsample: usize,
    /// Refits on all points.
    pub refits: usize,
}

impl Default for SimilarityOptions {
    fn default() -> Self {
        Self {
            threshold: None,
            seed: 0,
            confidence: 0.9999,
            max_iterations: 1000,
            subsample: 2000,
            refits: 5,
        }
    }
}

/// A similarity and what supports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aligned<To: Frame, From: Frame> {
    /// The similarity.
    pub to_from: Sim3<To, From>,
    /// Share of the finite pairs that the last fit kept.
    pub inlier_share: f64,
    /// Pairs with finite coordinates.
    pub num_pairs: usize,
    /// Root mean square distance of the kept pairs, in units of the target.
    pub residual_rms: f64,
    /// Distance up to which pairs were kept.
    pub threshold: f64,
}

/// Why no similarity can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CannotAlign {
    /// The two clouds do not correspond.
    #[error("the clouds have {from} and {to} points, but must correspond one by one")]
    DifferentNumbers {
        /// Points of the source.
        from: usize,
        /// Points of the target.
        to: usize,
    },
    /// Fewer than three pairs have finite coordinates.
    #[error("{found} pairs of points, at least 3 are needed")]
    TooFewPairs {
        /// Pairs that came in.
        found: usize,
    },
    /// All points lie on a line or in one place.
    #[error("the points lie on a line: they fix no rotation")]
    Degenerate,
}

/// The distance of a pair after a similarity.
pub fn distance<To: Frame, From: Frame>(to_from: &Sim3<To, From>, p: &Point3<f64>, q: &Point3<f64>) -> f64 {
    (to_from.point(p) - q).norm()
}

fn finite(from: &[Point3<f64>], to: &[Point3<f64>]) -> Result<Vec<usize>, CannotAlign> {
    if from.len() != to.len() {
        return Err(CannotAlign::DifferentNumbers { from: from.len(), to: to.len() });
    }
    let is_finite = |p: &Point3<f64>| p.iter().all(|v| v.is_finite());
    let usable: Vec<usize> = (0..from.len()).filter(|&i| is_finite(&from[i]) && is_finite(&to[i])).collect();
    if usable.len() < 3 { Err(CannotAlign::TooFewPairs { found: usable.len() }) } else { Ok(usable) }
}

/// Least squares over all pairs, then `refits` times over those with a distance of at most three times the median.
///
/// The recommended alignment where outliers are few: closed form, without a random number. Pairs that are not finite are left out.
/// # Errors
/// [`CannotAlign`].
pub fn trimmed<To: Frame, From: Frame>(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    refits: usize,
) -> Result<Aligned<To, From>, CannotAlign> {
    let usable = finite(from, to)?;
    let all = usable.iter().map(|&i| (from[i], to[i], 1.0));
    let start = umeyama(all, Scaling::Free).ok_or(CannotAlign::Degenerate)?;
    refit(from, to, &usable, start, None, refits)
}

/// Robust similarity: RANSAC on a subsample, then trimmed refits over all pairs.
///
/// # Errors
/// [`CannotAlign`].
pub fn estimate<To: Frame, From: Frame>(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    options: &SimilarityOptions,
) -> Result<Aligned<To, From>, CannotAlign> {
    let usable = finite(from, to)?;
    let mut random = Random::new(options.seed);
    let chosen: Vec<usize> = if usable.len() <= options.subsample.max(3) {
        usable.clone()
    } else {
        // One of each stretch of the cloud: spread evenly over the picture, in which neighbours are alike.
        let num = options.subsample.max(3);
        (0..num)
            .map(|k| {
                let (low, high) = (k * usable.len() / num, (k + 1) * usable.len() / num);
                usable[low + random.below(high - low)]
            })
            .collect()
    };
    // In random order: the search gives hopeless models up early.
    let order = random.permutation(chosen.len());
    let pairs: Vec<(Point3<f64>, Point3<f64>)> =
        order.iter().map(|&k| (from[chosen[k]], to[chosen[k]])).collect();
    let settings = Search {
        seed: options.seed.wrapping_add(1),
        confidence: options.confidence,
        min_iterations: 20,
        max_iterations: options.max_iterations,
        local: Local::Improve,
        order: None,
    };
    let threshold = match options.threshold {
        Some(threshold) => threshold,
        None => 3.0 * least_median::<To, From>(&pairs, &settings).ok_or(CannotAlign::Degenerate)?,
    };
    let mut estimator = SimilaritySearch::<To, From> {
        pairs: &pairs,
        limit: threshold * threshold,
        frames: std::marker::PhantomData,
    };
    let found = search(&mut estimator, &settings).ok_or(CannotAlign::Degenerate)?;
    refit(from, to, &usable, found.model, options.threshold, options.refits)
}

/// The least median distance among random minimal samples (Rousseeuw 1984): a scale that half outliers do not spoil.
fn least_median<To: Frame, From: Frame>(
    pairs: &[(Point3<f64>, Point3<f64>)],
    settings: &Search<'_>,
) -> Option<f64> {
    /// Fixed: with half of the data wrong, a hundred samples of three miss with a chance of 2e-6.
    const SAMPLES: usize = 100;
    let mut random = Random::new(settings.seed.wrapping_add(1));
    let mut sample = [0; 3];
    let mut distances = vec![0.0; pairs.len()];
    let mut best: Option<f64> = None;
    for _ in 0..SAMPLES {
        random.distinct(pairs.len(), &mut sample);
        let three = sample.iter().map(|&k| (pairs[k].0, pairs[k].1, 1.0));
        let Some(model) = umeyama::<To, From>(three, Scaling::Free) else { continue };
        for (d, (p, q)) in distances.iter_mut().zip(pairs) {
            *d = distance(&model, p, q);
        }
        let middle = distances.len() / 2;
        let median = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        if best.is_none_or(|b| median < b) {
            best = Some(median);
        }
    }
    best
}

struct SimilaritySearch<'a, To, From> {
    pairs: &'a [(Point3<f64>, Point3<f64>)],
    limit: f64,
    frames: std::marker::PhantomData<fn(From) -> To>,
}

impl<To: Frame, From: Frame> Estimator for SimilaritySearch<'_, To, From> {
    type Model = Sim3<To, From>;
    const SAMPLE: usize = 3;

    fn num_data(&self) -> usize {
        self.pairs.len()
    }

    fn solve(&mut self, sample: &[usize], models: &mut Vec<Self::Model>) {
        let three = sample.iter().map(|&k| (self.pairs[k].0, self.pairs[k].1, 1.0));
        models.extend(umeyama(three, Scaling::Free));
    }

    fn score(&self, model: &Self::Model, best: &Score) -> Option<Score> {
        let matrix = model.rotation() * model.scale();
        let origin = model.origin().coords;
        let mut tally = Tally::new(self.limit, self.pairs.len(), best);
        for block in self.pairs.chunks(64) {
            let (mut cost, mut inliers) = (0.0, 0);
            for (p, q) in block {
                let squared = (matrix * p.coords + origin - q.coords).norm_squared();
                cost += squared.min(self.limit);
                inliers += usize::from(squared < self.limit);
            }
            if !tally.add(block.len(), cost, inliers) {
                return None;
            }
        }
        Some(tally.score())
    }

    fn improve(&mut self, model: &Self::Model) -> Option<Self::Model> {
        let near = self.pairs.iter().filter(|(p, q)| (model.point(p) - q).norm_squared() < self.limit);
        umeyama(near.map(|(p, q)| (*p, *q, 1.0)), Scaling::Free)
    }
}

/// Refits over the pairs within the threshold (or three times the median), until the kept pairs stay the same.
fn refit<To: Frame, From: Frame>(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    usable: &[usize],
    start: Sim3<To, From>,
    threshold: Option<f64>,
    refits: usize,
) -> Result<Aligned<To, From>, CannotAlign> {
    let mut model = start;
    let mut scratch = vec![0.0; usable.len()];
    let mut distances = vec![0.0; usable.len()];
    let mut kept_before = 0;
    for round in 0..=refits {
        let (matrix, origin) = (model.rotation() * model.scale(), model.origin().coords);
        for (d, &i) in distances.iter_mut().zip(usable) {
            *d = (matrix * from[i].coords + origin - to[i].coords).norm();
        }
        scratch.copy_from_slice(&distances);
        let middle = scratch.len() / 2;
        let bound =
            threshold.unwrap_or_else(|| 3.0 * *scratch.select_nth_unstable_by(middle, f64::total_cmp).1);
        let mut moments = Moments::about(&from[usable[0]], &to[usable[0]]);
        let (mut kept, mut squares) = (0_usize, 0.0);
        for (d, &i) in distances.iter().zip(usable) {
            if *d <= bound {
                kept += 1;
                squares += d * d;
                moments.add(&from[i], &to[i], 1.0);
            }
        }
        if round == refits || kept == kept_before || kept < 3 {
            return Ok(Aligned {
                to_from: model,
                inlier_share: kept as f64 / usable.len() as f64,
                num_pairs: usable.len(),
                residual_rms: (squares / (kept.max(1)) as f64).sqrt(),
                threshold: bound,
            });
        }
        kept_before = kept;
        model = moments.solve(Scaling::Free).ok_or(CannotAlign::Degenerate)?;
    }
    Err(CannotAlign::Degenerate)
}
