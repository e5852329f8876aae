//! The similarity that leads from a prediction's unit into metres: one per pair, fitted to the truth.

use rayon::prelude::*;
use selenograph_dataset::rng;
use selenograph_geometry::{CamA, Matrix3, Point3, PredA, Sim3};
use selenograph_pose::similarity;
use selenograph_pose::solvers::umeyama::{Scaling, umeyama};

/// Fewest correspondences that a similarity is fitted to here: below, a prediction has as good as no points.
pub const MIN_POINTS: usize = 16;
/// Most refits; the choice nearly always stands after five.
const MAX_REFITS: usize = 10;
/// Residuals below this share of the largest distance are the rounding of a prediction's f32 (6e-8 per coordinate), which
/// nothing is trimmed by.
const ROUNDING_SHARE: f64 = 1e-6;

/// A similarity with how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// From the prediction's frame to camera A's, metres.
    pub cam_a_from_pred: Sim3<CamA, PredA>,
    /// Share of the correspondences in the last fit.
    pub inlier_share: f64,
    /// Median residual of all correspondences, metres.
    pub residual_median_m: f64,
}

/// Why there is no similarity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoAlignment {
    /// Too few correspondences.
    #[error("{found} points with truth, at least {MIN_POINTS} are needed for an alignment")]
    TooFew {
        /// How many there are.
        found: usize,
    },
    /// The points leave a rotation free, or the best scale is not positive.
    #[error("the predicted points lie on a line or in one place")]
    Degenerate,
}

/// Least squares over all correspondences, then over those whose residual is at most 3 medians, until the choice stands
/// ([`similarity::trimmed`]).
///
/// # Shapes and units
/// `predicted[i]` (the prediction's unit) belongs to `truth[i]` (metres in camera A); all finite.
/// # Errors
/// [`NoAlignment`] for too few or degenerate points.
pub fn robust(predicted: &[Point3<f64>], truth: &[Point3<f64>]) -> Result<Alignment, NoAlignment> {
    if predicted.len() < MIN_POINTS {
        return Err(NoAlignment::TooFew { found: predicted.len() });
    }
    let fit = similarity::trimmed(predicted, truth, MAX_REFITS).map_err(|_| NoAlignment::Degenerate)?;
    let residuals = residuals_m(&fit.to_from, predicted, truth);
    let farthest = truth.iter().map(|p| p.coords.norm_squared()).fold(0.0, f64::max).sqrt();
    let cut = fit.threshold.max(ROUNDING_SHARE * farthest);
    let num_kept = residuals.iter().filter(|r| **r <= cut).count();
    Ok(Alignment {
        cam_a_from_pred: fit.to_from,
        inlier_share: num_kept as f64 / predicted.len() as f64,
        residual_median_m: median_of(residuals),
    })
}

/// The paper's form, as its code has it: consensus over 5000 random correspondences, samples of 4, at most 100 000 rounds,
/// confidence 0.999, and a threshold of 100 km, within which everything agrees, so that it stops after the first
/// sample. What comes out is the least-squares fit of four random points.
///
/// # Errors
/// [`NoAlignment`] for too few or degenerate points.
pub fn ransac_paper(
    predicted: &[Point3<f64>],
    truth: &[Point3<f64>],
    seed: u64,
) -> Result<Alignment, NoAlignment> {
    const NUM_DRAWN: usize = 5000;
    const SAMPLE: usize = 4;
    const MAX_ROUNDS: usize = 100_000;
    const CONFIDENCE: f64 = 0.999;
    const THRESHOLD_M: f64 = 1e5;
    if predicted.len() < MIN_POINTS {
        return Err(NoAlignment::TooFew { found: predicted.len() });
    }
    let drawn = draw(predicted.len(), NUM_DRAWN, seed, "ransac correspondences");
    let pick = |from: &[Point3<f64>]| drawn.iter().map(|&idx| from[idx]).collect::<Vec<_>>();
    let (source, target) = (pick(predicted), pick(truth));
    let mut stream = rng::rng(seed, "evaluate", 0, "ransac samples");
    let mut best: Option<(usize, f64, Sim3<CamA, PredA>)> = None;
    let (mut round, mut needed) = (0, MAX_ROUNDS as f64);
    while round < MAX_ROUNDS && (round as f64) < needed {
        round += 1;
        let sample: [usize; SAMPLE] = std::array::from_fn(|_| stream.index(source.len()));
        let Some(fit) = umeyama(sample.map(|idx| (source[idx], target[idx], 1.0)), Scaling::Free) else {
            continue;
        };
        let inliers: Vec<f64> =
            residuals_m(&fit, &source, &target).into_iter().filter(|r| *r < THRESHOLD_M).collect();
        let rms = (inliers.iter().map(|r| r * r).sum::<f64>() / inliers.len().max(1) as f64).sqrt();
        if best.is_none_or(|(count, least, _)| inliers.len() > count || inliers.len() == count && rms < least)
        {
            best = Some((inliers.len(), rms, fit));
            let share = inliers.len() as f64 / source.len() as f64;
            needed = needed.min((1.0 - CONFIDENCE).ln() / (1.0 - share.powi(SAMPLE as i32)).ln());
        }
    }
    let (count, _, fit) = best.ok_or(NoAlignment::Degenerate)?;
    Ok(Alignment {
        cam_a_from_pred: fit,
        inlier_share: count as f64 / source.len() as f64,
        residual_median_m: median_of(residuals_m(&fit, predicted, truth)),
    })
}

/// `count` different positions below `len` in random order (all of them if there are no more): the start of a shuffle.
pub fn draw(len: usize, count: usize, seed: u64, purpose: &str) -> Vec<usize> {
    let mut stream = rng::rng(seed, "evaluate", 0, purpose);
    let mut positions: Vec<usize> = (0..len).collect();
    let count = count.min(len);
    for idx in 0..count {
        positions.swap(idx, idx + stream.index(len - idx));
    }
    positions.truncate(count);
    positions
}

/// Distances of the carried points to the truth, metres.
fn residuals_m(fit: &Sim3<CamA, PredA>, predicted: &[Point3<f64>], truth: &[Point3<f64>]) -> Vec<f64> {
    let carry = Carry::new(fit);
    predicted.par_iter().zip(truth).map(|(p, t)| (carry.point(p) - t).norm()).collect()
}

/// A similarity as one matrix: half the work per point.
#[derive(Debug, Clone, Copy)]
pub struct Carry {
    matrix: Matrix3<f64>,
    origin: Point3<f64>,
}

impl Carry {
    /// From a similarity.
    pub fn new(similarity: &Sim3<CamA, PredA>) -> Self {
        Self { matrix: similarity.rotation() * similarity.scale(), origin: similarity.origin() }
    }

    /// Carries a point.
    #[inline]
    pub fn point(&self, point: &Point3<f64>) -> Point3<f64> {
        self.origin + self.matrix * point.coords
    }
}

fn median_of(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use selenograph_geometry::{Rigid3, Rotation3, Vector3};

    /// Rounding of f64 at the distances used, far below anything measured.
    const EXACT_M: f64 = 1e-6;

    /// Relief of a few hundred metres, 30 km away.
    fn relief(count: usize) -> Vec<Point3<f64>> {
        (0..count)
            .map(|i| {
                let (x, y) = ((i % 40) as f64 - 20.0, (i / 40) as f64 - 20.0);
                Point3::new(500.0 * x, 500.0 * y, 30_000.0 + 300.0 * (0.3 * x).sin() * (0.2 * y).cos())
            })
            .collect()
    }

    fn pred_from_truth(scale: f64, turn: [f64; 3], origin: [f64; 3]) -> Sim3<PredA, CamA> {
        let rotation = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
        Sim3::new(scale, Rigid3::new(rotation, Point3::from(origin))).unwrap()
    }

    proptest! {
        #[test]
        fn any_similarity_is_undone(
            scale in 1e-5..1e3f64,
            turn in prop::array::uniform3(-3.0..3.0f64),
            origin in prop::array::uniform3(-10.0..10.0f64),
        ) {
            let truth = relief(1600);
            let pred_from_truth = pred_from_truth(scale, turn, origin);
            let predicted: Vec<_> = truth.iter().map(|p| pred_from_truth.point(p)).collect();
            for fit in [robust(&predicted, &truth).unwrap(), ransac_paper(&predicted, &truth, 42).unwrap()] {
                prop_assert!((fit.cam_a_from_pred.scale() * scale - 1.0).abs() < 1e-9);
                prop_assert!(fit.residual_median_m < EXACT_M);
                prop_assert_eq!(fit.inlier_share, 1.0);
            }
        }
    }

    #[test]
    fn gross_errors_do_not_move_the_robust_fit() {
        let truth = relief(1600);
        let pred_from_truth = pred_from_truth(0.001, [0.1, 0.2, 0.3], [1.0, 2.0, 3.0]);
        let mut predicted: Vec<_> = truth.iter().map(|p| pred_from_truth.point(p)).collect();
        for (i, p) in predicted.iter_mut().enumerate() {
            // Noise of metres everywhere, kilometres at one point in eight.
            *p += Vector3::new(0.0, 0.0, 0.002 * ((i * 7919 % 101) as f64 / 50.0 - 1.0));
            if i % 8 == 0 {
                *p += Vector3::new(0.0, 0.0, 4.0 + (i % 5) as f64);
            }
        }
        let fit = robust(&predicted, &truth).unwrap();
        assert!((fit.cam_a_from_pred.scale() / 1000.0 - 1.0).abs() < 1e-3, "{fit:?}");
        assert!((fit.inlier_share - 0.875).abs() < 0.01, "{fit:?}");
        assert!(fit.residual_median_m < 2.0, "{fit:?}");
    }

    #[test]
    fn points_without_a_similarity_are_refused() {
        let truth = relief(100);
        assert_eq!(robust(&truth[..5], &truth[..5]), Err(NoAlignment::TooFew { found: 5 }));
        let line: Vec<_> = (0..100).map(|i| Point3::new(f64::from(i), 0.0, 1.0)).collect();
        assert_eq!(robust(&line, &truth), Err(NoAlignment::Degenerate));
        assert_eq!(robust(&vec![truth[0]; 100], &truth), Err(NoAlignment::Degenerate));
        assert_eq!(ransac_paper(&vec![truth[0]; 100], &truth, 1), Err(NoAlignment::Degenerate));
    }

    #[test]
    fn draws_are_different_positions_and_repeat() {
        let drawn = draw(1000, 100, 42, "a");
        assert_eq!(drawn, draw(1000, 100, 42, "a"));
        assert_ne!(drawn, draw(1000, 100, 42, "b"));
        let unique: std::collections::BTreeSet<_> = drawn.iter().collect();
        assert_eq!(unique.len(), 100);
        assert_eq!(draw(3, 10, 1, "a").len(), 3);
    }
}
