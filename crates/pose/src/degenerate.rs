//! When matches say nothing about a motion: agreement by chance, and views without parallax.

use crate::decompose::Motion;
use crate::points::Pairs;
use crate::sampson;
use crate::solvers::homography_4pt::transfer_squared;
use selenograph_geometry::Matrix3;

/// A result counts as chance above this expected number of equally good ones among random matches.
const FALSE_ALARMS: f64 = 1e-3;
/// Comparisons of unrelated points that estimate how often one agrees by chance.
const MAX_COMPARISONS: usize = 4000;

/// How often unrelated points agree: pairs of the same data, shifted against each other.
///
/// `agree` takes a point of A and a point of B as one pair. Half a count is added, so that the answer is never zero.
pub fn chance_share(pairs: &Pairs, agree: impl Fn(&[f64; 4]) -> bool) -> f64 {
    let n = pairs.len();
    let shifts = (MAX_COMPARISONS / n).clamp(1, n - 1);
    let mut count = 0_usize;
    for k in 1..=shifts {
        let shift = (k * n / (shifts + 1)).max(1);
        for i in 0..n {
            let [ax, ay, ..] = pairs.at(i);
            let [.., bx, by] = pairs.at((i + shift) % n);
            count += usize::from(agree(&[ax, ay, bx, by]));
        }
    }
    (count as f64 + 0.5) / ((shifts * n) as f64 + 1.0)
}

/// True where so many of `total` matches agree with a model of a minimal sample as random ones hardly would.
///
/// The bound on the expected number of models with as many agreeing matches: number of minimal samples × Chernoff's bound of the binomial tail.
/// # Source
/// Moisan, Stival 2004, "A probabilistic criterion to detect rigid point matches", IJCV 57(3).
pub fn above_chance(
    inliers: usize,
    total: usize,
    sample: usize,
    models_per_sample: f64,
    chance: f64,
) -> bool {
    if inliers <= sample {
        return false;
    }
    let (k, m) = ((inliers - sample) as f64, (total - sample) as f64);
    let share = k / m;
    if share <= chance {
        return false;
    }
    let rest = if share < 1.0 { (1.0 - share) * ((1.0 - share) / (1.0 - chance)).ln() } else { 0.0 };
    let divergence = share * (share / chance).ln() + rest;
    let mut log_tests = models_per_sample.ln();
    for i in 0..sample {
        log_tests += ((total - i) as f64 / (sample - i) as f64).ln();
    }
    log_tests - m * divergence < FALSE_ALARMS.ln()
}

/// Parallax below this multiple of the noise (of variances) says nothing about a direction. Errors of neighbouring matches are alike,
/// and the motion has taken the direction in which they are least: pictures taken twice from one place show up to 4.2, those with
/// a baseline of a twenty-fifth of the height 21 and more.
const PARALLAX_TO_NOISE: f64 = 4.0;
/// Share of the matches that may lie far from the rotation by chance (outliers on their epipolar lines).
const STRAY_SHARE: f64 = 0.05;

/// What a rotation leaves unexplained, where that is no more than noise; none where the matches show parallax.
///
/// A rotation explains both coordinates of a match, an essential matrix only one: the distance along the epipolar line is free. Without parallax
/// that free part has the size of the constrained one. The two variances are compared over the inliers of the motion; noise is taken
/// as `least_noise` at least.
pub fn without_parallax(
    pairs: &Pairs,
    motion: &Motion,
    rotation: &Matrix3<f64>,
    threshold: f64,
    least_noise: f64,
    chance: f64,
) -> Option<f64> {
    let e = motion.essential();
    let (mut near, mut stray) = (0.0, 0.0);
    let (mut across, mut both) = (0.0, 0.0);
    for i in 0..pairs.len() {
        let r = sampson::distance(&e, &pairs.a(i), &pairs.b(i));
        if r.abs() >= threshold || r.is_nan() {
            continue;
        }
        let transfer = transfer_squared(rotation, &pairs.at(i));
        // Twice: the transfer error holds the noise of both points.
        if transfer > 2.0 * (3.0 * threshold) * (3.0 * threshold) {
            stray += 1.0;
        } else {
            near += 1.0;
            across += r * r;
            both += 0.5 * transfer;
        }
    }
    let total = near + stray;
    let by_chance = 3.0 * chance * (pairs.len() as f64 - total) / (1.0 - chance);
    if near < 6.0 || stray > by_chance.max(STRAY_SHARE * total) {
        return None;
    }
    let noise = (across / (near - 5.0)).max(least_noise * least_noise);
    let along = ((both - across) / near).max(0.0);
    let bound = PARALLAX_TO_NOISE + 6.0 * (2.0 / near).sqrt();
    (along < bound * noise).then(|| (both / near).sqrt())
}
