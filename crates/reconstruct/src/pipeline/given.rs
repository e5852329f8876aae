//! A relative pose that was given: matches that agree with it, as seeds of the surface and as a check of the pose.

use super::matcher::{Found, Matcher};
use crate::evidence::PoseSource;
use crate::features::intensity::Intensity;
use crate::judge::{GIVEN_TOLERANCE_PX, Judge};
use crate::matching::Match;
use crate::priors::KnownPose;
use crate::relative_pose::{Counts, JudgedMatch, PairPose, SiftOptions};
use crate::{Error, View, subpixel};
use selenograph_geometry::{CamA, CamB, Rigid3};
use selenograph_pose::relative::CannotSay;

/// A pose and the matches that it rests on, or is checked with.
pub(super) struct Start {
    pub(super) cam_b_from_cam_a: Rigid3<CamB, CamA>,
    pub(super) source: PoseSource,
    pub(super) matches: Vec<JudgedMatch>,
    pub(super) counts: Counts,
}

impl From<PairPose> for Start {
    fn from(PairPose { pose, matches, counts }: PairPose) -> Self {
        let cam_b_from_cam_a = pose.cam_b_from_cam_a;
        Self { cam_b_from_cam_a, source: PoseSource::Estimated(Box::new(pose)), matches, counts }
    }
}

/// Fewer matches that agree are as good as chance.
const MIN_AGREEING: usize = 8;

/// Matches that agree with a given pose, aligned to a fraction of a pixel.
pub(super) fn start(
    a: &View,
    b: &View,
    known: &KnownPose,
    matcher: Matcher<'_>,
    options: &SiftOptions,
) -> Result<Start, Error> {
    let too_few = |found: usize| CannotSay::TooFewMatches { found, needed: MIN_AGREEING };
    let (seen_a, seen_b) = rayon::join(|| Intensity::new(&a.image), || Intensity::new(&b.image));
    let (Some(seen_a), Some(seen_b)) = (seen_a, seen_b) else { return Err(too_few(0).into()) };
    let Found { matches: found, features, match_px } = matcher.matches([a, b], [&seen_a, &seen_b], options);
    let tolerance_px = GIVEN_TOLERANCE_PX * match_px;
    let judge = Judge::new(&known.cam_b_from_cam_a, [&a.camera, &b.camera], tolerance_px);
    let mut agreeing: Vec<Match> = found.iter().filter(|m| judge.agrees(&m.a, &m.b)).copied().collect();
    let num_agreeing = agreeing.len();
    if num_agreeing < MIN_AGREEING {
        return Err(CannotSay::NoConsensus { inliers: num_agreeing, matches: found.len() }.into());
    }
    let mut refined = 0;
    let mut sigmas = vec![None; agreeing.len()];
    if let Some(options) = &options.subpixel {
        let aligned = subpixel::refine(&seen_a, &seen_b, &agreeing, options);
        refined = aligned.len();
        if aligned.len() >= MIN_AGREEING {
            sigmas = aligned.iter().map(|r| Some(r.sigma_px)).collect();
            agreeing = aligned.iter().map(|r| Match { a: r.a, b: r.b, score: -r.sigma_px }).collect();
        }
    }
    let places = agreeing.iter().zip(sigmas);
    let matches: Vec<JudgedMatch> = places.map(|(m, sigma_px)| judge.judged(m.a, m.b, sigma_px)).collect();
    let inliers = matches.iter().filter(|m| m.inlier).count();
    let squares: f64 = matches.iter().filter(|m| m.inlier).map(|m| m.residual_px.powi(2)).sum();
    let counts = Counts { features, matches: found.len(), first_inliers: num_agreeing, refined, inliers };
    let source = PoseSource::Given {
        agreeing: num_agreeing,
        matches: found.len(),
        residual_px: (squares / inliers.max(1) as f64).sqrt(),
    };
    Ok(Start { cam_b_from_cam_a: known.cam_b_from_cam_a, source, matches, counts })
}
