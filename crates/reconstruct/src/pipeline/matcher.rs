//! Whose matches a pose rests on.

use crate::View;
use crate::features::intensity::Intensity;
use crate::features::{orb, sift};
use crate::matching::{self, Grain, Match};
use crate::relative_pose::{self, OrbOptions, PairPose, SiftOptions};
use selenograph_pose::relative::CannotSay;

/// Whose matches the pose rests on.
#[derive(Clone, Copy)]
pub(super) enum Matcher<'a> {
    /// Those of ORB features.
    Orb(&'a OrbOptions),
    /// Those of SIFT features.
    Sift,
    /// Those of a network, or of any matcher.
    Given(&'a [Match], Grain),
}

/// Matches that no pose has judged, and where they come from.
pub(super) struct Found {
    pub(super) matches: Vec<Match>,
    /// Features of A and of B.
    pub(super) features: [usize; 2],
    /// Side of a matched pixel in pixels of the pictures.
    pub(super) match_px: f64,
}

impl Matcher<'_> {
    /// The pose that the matches tell.
    pub(super) fn pose(self, a: &View, b: &View, options: &SiftOptions) -> Result<PairPose, CannotSay> {
        match self {
            Self::Orb(orb) => relative_pose::orb(a, b, orb),
            Self::Sift => relative_pose::sift(a, b, options),
            Self::Given(matches, grain) => relative_pose::of_matches(a, b, matches, grain, options),
        }
    }

    /// The matches alone.
    pub(super) fn matches(self, [a, b]: [&View; 2], seen: [&Intensity; 2], options: &SiftOptions) -> Found {
        match self {
            Self::Orb(orb) => {
                let detect = |view: &View| orb::detect(&view.image, &orb.features);
                let (a, b) = rayon::join(|| detect(a), || detect(b));
                let features = [a.keypoints.len(), b.keypoints.len()];
                Found { matches: matching::orb(&a, &b, &orb.matching), features, match_px: 1.0 }
            }
            Self::Sift => {
                let detect = |seen: &Intensity| sift::detect_in(seen, &options.features);
                let (a, b) = rayon::join(|| detect(seen[0]), || detect(seen[1]));
                let features = [a.keypoints.len(), b.keypoints.len()];
                Found { matches: matching::sift(&a, &b, &options.matching), features, match_px: 1.0 }
            }
            Self::Given(matches, grain) => {
                Found { matches: matches.to_vec(), features: [0, 0], match_px: grain.match_px }
            }
        }
    }
}
