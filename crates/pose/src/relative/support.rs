//! Which matches support a motion.

use super::hypotheses::in_front_or_far;
use crate::decompose::Motion;
use crate::degenerate::chance_share;
use crate::points::Pairs;
use crate::sampson;
use crate::solvers::homography_4pt::transfer_squared;
use selenograph_geometry::robust::MAD_TO_SIGMA;
use selenograph_geometry::{Matrix3, Vector3};

/// Distances from the plane are drawn in by this many robust sigmas.
const FAR_SIGMAS: f64 = 8.0;
/// The plane must explain this share of the inliers for distances from it to mean anything.
const PLANE_SHARE: f64 = 0.5;
/// Far matches are taken as strays while they are at most this many times as many as chance explains.
const STRAY_FACTOR: f64 = 3.0;

/// A motion and the tests that its matches must pass.
///
/// An outlier on its epipolar line passes the Sampson test. Where the scene is nearly a plane such strays decide the answer: they seem to lie far
/// off the plane, where a match says most about the direction, while thousands of true ones say little. So the distance
/// from the dominant plane is looked at too: matches far off it are left out if there are no more of them than chance
/// brings. More of them are a mountain, and stay.
pub struct Support<'a> {
    motion: &'a Motion,
    essential: Matrix3<f64>,
    threshold: f64,
    plane: Option<(Matrix3<f64>, f64)>,
    /// Share of the inliers that the dominant plane explains within the threshold.
    pub plane_share: f64,
    /// How often unrelated points pass the Sampson test and lie in front.
    pub chance: f64,
}

impl<'a> Support<'a> {
    /// Of a motion whose translation has its sign, with the homography that explains most of its matches.
    pub fn new(pairs: &Pairs, motion: &'a Motion, plane: Option<&Matrix3<f64>>, threshold: f64) -> Self {
        let essential = motion.essential();
        let mut support = Self { motion, essential, threshold, plane: None, plane_share: 0.0, chance: 0.0 };
        support.chance = chance_share(pairs, |pair| support.agrees(pair));
        if let Some(h) = plane {
            support.look_at_plane(pairs, h);
        }
        support
    }

    fn look_at_plane(&mut self, pairs: &Pairs, h: &Matrix3<f64>) {
        let n = pairs.len();
        let mut distances: Vec<f64> = (0..n)
            .map(|i| pairs.at(i))
            .filter(|p| self.agrees(p))
            .map(|p| transfer_squared(h, &p).sqrt())
            .collect();
        if distances.is_empty() {
            return;
        }
        let num = distances.len() as f64;
        let within = std::f64::consts::SQRT_2 * self.threshold;
        self.plane_share = distances.iter().filter(|d| **d < within).count() as f64 / num;
        let middle = distances.len() / 2;
        let sigma = MAD_TO_SIGMA * *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        let bound = (FAR_SIGMAS * sigma).max(2.0 * within);
        let far = distances.iter().filter(|d| **d >= bound).count() as f64;
        let expected = self.chance * (n as f64 - num) / (1.0 - self.chance);
        if self.plane_share >= PLANE_SHARE && far <= STRAY_FACTOR * expected + 2.0 {
            self.plane = Some((*h, bound * bound));
        }
    }

    /// True where a match passes all tests.
    pub fn agrees(&self, pair: &[f64; 4]) -> bool {
        let a = Vector3::new(pair[0], pair[1], 1.0);
        let b = Vector3::new(pair[2], pair[3], 1.0);
        let close = sampson::distance(&self.essential, &a, &b).abs() < self.threshold;
        if !close || self.plane.is_some_and(|(h, bound)| transfer_squared(&h, pair) >= bound) {
            return false;
        }
        in_front_or_far(self.motion, &a, &b, self.threshold * self.threshold)
    }

    /// The matches that are not far from the plane, whatever the motion says of them; all, where there is no such plane.
    pub fn near_plane(&self, pairs: &Pairs) -> Pairs {
        let near = |pair: &[f64; 4]| self.plane.is_none_or(|(h, bound)| transfer_squared(&h, pair) < bound);
        Pairs::new((0..pairs.len()).map(|i| pairs.at(i)).filter(near))
    }

    /// The matches that agree.
    pub fn agreeing(&self, pairs: &Pairs) -> Pairs {
        Pairs::new((0..pairs.len()).map(|i| pairs.at(i)).filter(|pair| self.agrees(pair)))
    }
}
