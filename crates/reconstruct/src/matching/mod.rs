//! Which feature of one picture is which of the other: mutual nearest neighbours that stand out from the second nearest.

mod dot;
mod hamming;
mod nearest;
mod tile;

use crate::features::{Features, orb, sift};
use nearest::Neighbours;
use selenograph_geometry::{Camera, Point2};
use selenograph_pose::relative;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// One place seen in both pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// In picture A, pixels from its corner.
    pub a: Point2<f64>,
    /// In picture B.
    pub b: Point2<f64>,
    /// Higher is better, and only the order is used: of features how far the nearest neighbour stands out from the second, 1 −
    /// the ratio of their distances.
    pub score: f64,
}

/// Matches on the plane `z = 1` of each camera; NaN outside a camera's lens model.
pub fn on_plane(cameras: [&Camera; 2], matches: &[Match]) -> Vec<relative::Match> {
    let outside = Point2::new(f64::NAN, f64::NAN);
    let place =
        |k: usize, at: &Point2<f64>| cameras[k].ray_z1(at).map_or(outside, |ray| Point2::new(ray.x, ray.y));
    matches.iter().map(|m| relative::Match { a: place(0, &m.a), b: place(1, &m.b), score: m.score }).collect()
}

/// How fine a matcher of pixels sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grain {
    /// Side of a matched pixel in pixels of the pictures: above 1 for pictures that were made smaller.
    pub match_px: f64,
    /// Standard deviation that a place has at least, pixels of the pictures: what no number of matches averages out.
    pub noise_px: f64,
    /// Side, in pixels of the pictures, of the parts whose matches are decided together, such as a network's patches; 0 where each
    /// match stands for itself.
    pub patch_px: f64,
}

/// Standard deviation of a place that is rounded to the middle of its pixel, pixels.
const WHOLE_PIXEL_NOISE_PX: f64 = 0.29;

impl Grain {
    /// Of places that are middles of matched pixels.
    pub fn of_pixels(match_px: f64, patch_px: f64) -> Self {
        Self { match_px, noise_px: WHOLE_PIXEL_NOISE_PX * match_px, patch_px }
    }

    /// Matches that share a patch of picture A, on average.
    pub fn per_patch(&self, matches: &[Match]) -> f64 {
        if self.patch_px <= 0.0 || matches.is_empty() {
            return 1.0;
        }
        let patch = |m: &Match| [m.a.x, m.a.y].map(|v| (v / self.patch_px).floor() as i64);
        let patches: BTreeSet<[i64; 2]> = matches.iter().map(patch).collect();
        matches.len() as f64 / patches.len() as f64
    }
}

/// Which pairs of features count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Largest ratio of the distances of the nearest and the second nearest neighbour; 1 asks for none.
    pub max_ratio: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { max_ratio: 0.85 }
    }
}

/// Matches of SIFT features, best first.
pub fn sift(a: &Features<sift::Descriptor>, b: &Features<sift::Descriptor>, options: &Options) -> Vec<Match> {
    let [points_a, points_b] = [a, b].map(|f| positions(&f.keypoints));
    mutual(&points_a, &points_b, &dot::neighbours(&a.descriptors, &b.descriptors), options)
}

/// Matches of ORB features, best first.
pub fn orb(a: &Features<orb::Descriptor>, b: &Features<orb::Descriptor>, options: &Options) -> Vec<Match> {
    let [points_a, points_b] = [a, b].map(|f| positions(&f.keypoints));
    mutual(&points_a, &points_b, &hamming::neighbours(&a.descriptors, &b.descriptors), options)
}

fn positions(keypoints: &[crate::features::Keypoint]) -> Vec<Point2<f64>> {
    keypoints.iter().map(|k| k.at).collect()
}

fn mutual(a: &[Point2<f64>], b: &[Point2<f64>], neighbours: &Neighbours, options: &Options) -> Vec<Match> {
    let mut matches: Vec<Match> = neighbours
        .of_a
        .iter()
        .enumerate()
        .filter(|&(i, nearest)| {
            neighbours.of_b.get(nearest.idx as usize).is_some_and(|&back| back as usize == i)
                && nearest.ratio <= options.max_ratio
        })
        .map(|(i, nearest)| Match { a: a[i], b: b[nearest.idx as usize], score: 1.0 - nearest.ratio })
        .collect();
    // A stable sort: ties keep the order of the features.
    matches.sort_by(|x, y| y.score.total_cmp(&x.score));
    // A place with several directions may match several times.
    let mut seen = std::collections::HashSet::new();
    matches.retain(|m| seen.insert([m.a, m.b].map(|p| [p.x.to_bits(), p.y.to_bits()])));
    matches
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::Keypoint;

    fn features<D>(descriptors: Vec<D>) -> Features<D> {
        let keypoints = (0..descriptors.len())
            .map(|i| Keypoint {
                at: Point2::new(i as f64, 0.0),
                sigma_px: 1.0,
                angle_rad: 0.0,
                response: 1.0,
            })
            .collect();
        Features { keypoints, descriptors }
    }

    fn numbers(seed: u32) -> impl Iterator<Item = u32> {
        std::iter::successors(Some(seed), |s| Some(s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)))
            .skip(1)
            .map(|s| s >> 8)
    }

    fn unit(seed: u32) -> sift::Descriptor {
        let mut d = [0.0f32; sift::DESCRIPTOR_LEN];
        for (d, n) in d.iter_mut().zip(numbers(seed)) {
            *d = n as f32;
        }
        let length = d.iter().map(|d| d * d).sum::<f32>().sqrt();
        d.map(|d| d / length)
    }

    #[test]
    fn shuffled_descriptors_find_each_other() {
        // Not a multiple of any block, so that the padding is tested.
        let a: Vec<_> = (0..137).map(unit).collect();
        let b: Vec<_> = (0..137).map(|i| a[(i * 31) % 137]).chain((500..560).map(unit)).collect();
        let matches = sift(&features(a), &features(b), &Options::default());
        assert_eq!(matches.len(), 137);
        for m in matches {
            assert_eq!(m.a.x as usize, m.b.x as usize * 31 % 137);
        }
    }

    #[test]
    fn bits_find_each_other_and_ambiguity_is_left_out() {
        let mut bits = numbers(7).map(u64::from);
        let mut next = || std::array::from_fn(|_| bits.next().unwrap() | (bits.next().unwrap() << 24));
        let a: Vec<orb::Descriptor> = (0..99).map(|_| next()).collect();
        let mut b: Vec<orb::Descriptor> = a.iter().rev().map(|d| [d[0] ^ 5, d[1], d[2], d[3]]).collect();
        b.push(b[3]);
        let matches = orb(&features(a), &features(b), &Options::default());
        assert_eq!(matches.len(), 98, "one of them has two equal neighbours");
        assert!(matches.iter().all(|m| m.a.x + m.b.x == 98.0));
    }

    #[test]
    fn nothing_matches_nothing() {
        let one = features(vec![unit(1)]);
        let none = features(Vec::new());
        assert!(sift(&one, &none, &Options::default()).is_empty());
        assert!(sift(&none, &one, &Options::default()).is_empty());
    }
}
