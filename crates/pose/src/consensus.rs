//! The three searches of a relative pose: essential matrix, homography and rotation.

use crate::decompose::motions_of_essential;
use crate::points::{LANES, Pairs, PairsF32};
use crate::ransac::{Estimator, Score, Tally};
use crate::refine::{Loss, refine};
use crate::sampson;
use crate::solvers::essential_5pt;
use crate::solvers::homography_4pt::{homography_4pt, homography_linear, transfer_squared};
use crate::solvers::rotation::rotation;
use selenograph_geometry::{Matrix3, Vector3};

/// Matches scored between two looks at whether a model can still win.
const BLOCK: usize = 128;
/// Local optimisation looks at this many inliers at most: sixty minimal samples.
const MAX_LOCAL: usize = 300;
/// Steps of a local optimisation.
const LOCAL_STEPS: usize = 4;

/// What a score is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counting {
    /// Truncated squares (MSAC).
    Squares,
    /// Number of inliers (RANSAC).
    Inliers,
}

/// Searches for an essential matrix with five matches.
pub struct EssentialSearch<'a> {
    pairs: &'a Pairs,
    narrow: PairsF32,
    limit: f64,
    counting: Counting,
    near: Pairs,
}

impl<'a> EssentialSearch<'a> {
    /// On pairs in random order, with the inlier threshold of the Sampson distance.
    pub fn new(pairs: &'a Pairs, threshold: f64, counting: Counting) -> Self {
        Self {
            pairs,
            narrow: PairsF32::from(pairs),
            limit: threshold * threshold,
            counting,
            near: Pairs::default(),
        }
    }
}

/// Ranges of whole vectors over padded data, with the number of real data in each.
fn blocks(pairs: &Pairs) -> impl Iterator<Item = (usize, usize, usize)> {
    let (len, padded) = (pairs.len(), pairs.padded_len());
    (0..padded).step_by(BLOCK).map(move |start| {
        let end = (start + BLOCK).min(padded);
        (start, end, end.min(len) - start)
    })
}

impl Estimator for EssentialSearch<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE: usize = 5;

    fn num_data(&self) -> usize {
        self.pairs.len()
    }

    fn solve(&mut self, sample: &[usize], models: &mut Vec<Self::Model>) {
        let a = std::array::from_fn(|k| self.pairs.a(sample[k]));
        let b = std::array::from_fn(|k| self.pairs.b(sample[k]));
        essential_5pt(&a, &b, models);
    }

    fn score(&self, model: &Self::Model, best: &Score) -> Option<Score> {
        let e: [f32; 9] = std::array::from_fn(|i| model[(i / 3, i % 3)] as f32);
        let limit = self.limit as f32;
        let unit = if self.counting == Counting::Squares { self.limit } else { 1.0 };
        let mut tally = Tally::new(unit, self.pairs.len(), best);
        let narrow = &self.narrow;
        for (start, end, data) in blocks(self.pairs) {
            let range = start..end;
            let (cost, count) = sampson::truncated_f32(
                &e,
                &narrow.ax[range.clone()],
                &narrow.ay[range.clone()],
                &narrow.bx[range.clone()],
                &narrow.by[range],
                limit,
            );
            let padding = (end - start - data) as f64 * self.limit;
            let cost = match self.counting {
                Counting::Squares => f64::from(cost) - padding,
                Counting::Inliers => data as f64 - f64::from(count),
            };
            if !tally.add(data, cost, count as usize) {
                return None;
            }
        }
        Some(tally.score())
    }

    fn improve(&mut self, model: &Self::Model) -> Option<Self::Model> {
        // A little wider than the threshold, so that a crooked minimal model reaches the matches it should hold.
        let limit = 4.0 * self.limit;
        let pairs = self.pairs;
        let inside = |i: &usize| sampson::distance(model, &pairs.a(*i), &pairs.b(*i)).powi(2) < limit;
        self.near.refill((0..pairs.len()).filter(inside).take(MAX_LOCAL).map(|i| pairs.at(i)));
        if self.near.len() < 6 {
            return None;
        }
        let [motion, ..] = motions_of_essential(model);
        let loss = Loss::Cauchy { scale_squared: self.limit, cutoff_squared: f64::INFINITY };
        Some(refine(&self.near, &motion, loss, LOCAL_STEPS).motion.essential())
    }
}

/// Searches for a homography with four matches.
pub struct HomographySearch<'a> {
    pairs: &'a Pairs,
    narrow: PairsF32,
    limit: f64,
}

impl<'a> HomographySearch<'a> {
    /// On pairs in random order, with the inlier threshold of the transfer error in B.
    pub fn new(pairs: &'a Pairs, threshold: f64) -> Self {
        Self { pairs, narrow: PairsF32::from(pairs), limit: threshold * threshold }
    }

    /// A linear fit to at most `take` pairs near a homography, weighted by Cauchy's function at the threshold.
    pub fn fit(&self, model: &Matrix3<f64>, take: usize) -> Option<Matrix3<f64>> {
        let near = (0..self.pairs.len())
            .map(|i| (self.pairs.at(i), transfer_squared(model, &self.pairs.at(i)) / self.limit))
            .filter(|(_, u)| *u < 16.0)
            .take(take)
            .map(|(pair, u)| (pair, 1.0 / (1.0 + u)));
        homography_linear(near)
    }
}

impl Estimator for HomographySearch<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE: usize = 4;

    fn num_data(&self) -> usize {
        self.pairs.len()
    }

    fn solve(&mut self, sample: &[usize], models: &mut Vec<Self::Model>) {
        let a: [Vector3<f64>; 4] = std::array::from_fn(|k| self.pairs.a(sample[k]));
        let b: [Vector3<f64>; 4] = std::array::from_fn(|k| self.pairs.b(sample[k]));
        models.extend(homography_4pt(&a, &b));
    }

    fn score(&self, model: &Self::Model, best: &Score) -> Option<Score> {
        score_transfer(self.pairs, &self.narrow, model, self.limit, best)
    }

    fn improve(&mut self, model: &Self::Model) -> Option<Self::Model> {
        self.fit(model, MAX_LOCAL)
    }
}

/// Searches for a rotation with two matches.
pub struct RotationSearch<'a> {
    pairs: &'a Pairs,
    narrow: PairsF32,
    limit: f64,
}

impl<'a> RotationSearch<'a> {
    /// On pairs in random order, with the inlier threshold of the transfer error in B.
    pub fn new(pairs: &'a Pairs, threshold: f64) -> Self {
        Self { pairs, narrow: PairsF32::from(pairs), limit: threshold * threshold }
    }
}

impl Estimator for RotationSearch<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE: usize = 2;

    fn num_data(&self) -> usize {
        self.pairs.len()
    }

    fn solve(&mut self, sample: &[usize], models: &mut Vec<Self::Model>) {
        let directions =
            sample.iter().map(|&i| (self.pairs.a(i).normalize(), self.pairs.b(i).normalize(), 1.0));
        models.extend(rotation(directions));
    }

    fn score(&self, model: &Self::Model, best: &Score) -> Option<Score> {
        score_transfer(self.pairs, &self.narrow, model, self.limit, best)
    }

    fn improve(&mut self, model: &Self::Model) -> Option<Self::Model> {
        fit_rotation(self.pairs, model, self.limit)
    }
}

/// The rotation that fits the pairs near a given one, weighted by Cauchy's function.
pub fn fit_rotation(pairs: &Pairs, start: &Matrix3<f64>, limit: f64) -> Option<Matrix3<f64>> {
    let weighted = (0..pairs.len()).filter_map(|i| {
        let u = transfer_squared(start, &pairs.at(i)) / limit;
        (u < 16.0).then(|| (pairs.a(i).normalize(), pairs.b(i).normalize(), 1.0 / (1.0 + u)))
    });
    rotation(weighted)
}

fn score_transfer(
    pairs: &Pairs,
    narrow: &PairsF32,
    h: &Matrix3<f64>,
    limit: f64,
    best: &Score,
) -> Option<Score> {
    let mut tally = Tally::new(limit, pairs.len(), best);
    let h: [f32; 9] = std::array::from_fn(|i| h[(i / 3, i % 3)] as f32);
    for (start, end, data) in blocks(pairs) {
        let range = start..end;
        let (cost, inliers) = truncated_transfer(
            &h,
            &narrow.ax[range.clone()],
            &narrow.ay[range.clone()],
            &narrow.bx[range.clone()],
            &narrow.by[range],
            limit as f32,
        );
        let padding = (end - start - data) as f64 * limit;
        if !tally.add(data, f64::from(cost) - padding, inliers as usize) {
            return None;
        }
    }
    Some(tally.score())
}

/// Truncated cost of the transfer errors and the number below the limit, as [`sampson::truncated_f32`] has it.
fn truncated_transfer(
    h: &[f32; 9],
    ax: &[f32],
    ay: &[f32],
    bx: &[f32],
    by: &[f32],
    limit: f32,
) -> (f32, u32) {
    let mut cost = [0.0_f32; LANES];
    let mut count = [0_u32; LANES];
    let chunks = ax
        .chunks_exact(LANES)
        .zip(ay.chunks_exact(LANES))
        .zip(bx.chunks_exact(LANES))
        .zip(by.chunks_exact(LANES));
    for (((ax, ay), bx), by) in chunks {
        for k in 0..LANES {
            let w = 1.0 / (h[6] * ax[k] + h[7] * ay[k] + h[8]);
            let dx = (h[0] * ax[k] + h[1] * ay[k] + h[2]) * w - bx[k];
            let dy = (h[3] * ax[k] + h[4] * ay[k] + h[5]) * w - by[k];
            let squared = dx * dx + dy * dy;
            let close = squared < limit;
            cost[k] += if close { squared } else { limit };
            count[k] += u32::from(close);
        }
    }
    (cost.iter().sum(), count.iter().sum())
}
