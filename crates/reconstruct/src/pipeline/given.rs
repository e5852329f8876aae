//! A relative pose that was given: matches that agree with it, as seeds of the surface and as a check of the pose.

use super::{PoseSource, Warning};
use crate::features::intensity::Intensity;
use crate::features::sift;
use crate::matching::{self, Match};
use crate::priors::KnownPose;
use crate::relative_pose::{Counts, PairMatch, SiftOptions};
use crate::{Error, View, subpixel};
use nalgebra::{Matrix3, Vector3};
use selenograph_geometry::{CamA, CamB, Camera, Point2, Rigid3};
use selenograph_pose::decompose::Motion;
use selenograph_pose::relative::CannotSay;
use selenograph_pose::{cheirality, sampson};

/// What the rest of the way begins with.
pub(super) struct Start {
    pub(super) cam_b_from_cam_a: Rigid3<CamB, CamA>,
    pub(super) source: PoseSource,
    pub(super) matches: Vec<PairMatch>,
    pub(super) counts: Counts,
}

/// Poses from navigation are off by pixels: matches are judged by this many pixels, in place of the threshold of an estimate.
pub(super) const TOLERANCE_PX: f64 = 3.0;
/// Fewer matches that agree are as good as chance.
const MIN_AGREEING: usize = 8;
/// A smaller share of agreeing matches is said.
const GOOD_SHARE: f64 = 0.5;

impl Start {
    pub(super) fn warnings(&self) -> Option<Warning> {
        match self.source {
            PoseSource::Given { agreeing, matches, residual_px }
                if (agreeing as f64) < GOOD_SHARE * matches as f64 || residual_px > 0.5 * TOLERANCE_PX =>
            {
                Some(Warning::PoseDisagrees { agreeing, matches, residual_px })
            }
            _ => None,
        }
    }
}

/// Matches that agree with a given pose, aligned to a fraction of a pixel.
pub(super) fn start(a: &View, b: &View, known: &KnownPose, options: &SiftOptions) -> Result<Start, Error> {
    let too_few = |found: usize| CannotSay::TooFewMatches { found, needed: MIN_AGREEING };
    let (seen_a, seen_b) = rayon::join(|| Intensity::new(&a.image), || Intensity::new(&b.image));
    let (Some(seen_a), Some(seen_b)) = (seen_a, seen_b) else { return Err(too_few(0).into()) };
    let (features_a, features_b) = rayon::join(
        || sift::detect_in(&seen_a, &options.features),
        || sift::detect_in(&seen_b, &options.features),
    );
    let found = matching::sift(&features_a, &features_b, &options.matching);
    let judge = Judge::new(&known.cam_b_from_cam_a, [&a.camera, &b.camera]);
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
    let matches: Vec<PairMatch> = agreeing
        .iter()
        .zip(sigmas)
        .map(|(m, sigma_px)| PairMatch {
            a: m.a,
            b: m.b,
            residual_px: judge.residual_px(&m.a, &m.b),
            sigma_px,
            inlier: judge.agrees(&m.a, &m.b),
        })
        .collect();
    let inliers = matches.iter().filter(|m| m.inlier).count();
    let squares: f64 = matches.iter().filter(|m| m.inlier).map(|m| m.residual_px.powi(2)).sum();
    let counts = Counts {
        features: [features_a.keypoints.len(), features_b.keypoints.len()],
        matches: found.len(),
        first_inliers: num_agreeing,
        refined,
        inliers,
    };
    let source = PoseSource::Given {
        agreeing: num_agreeing,
        matches: found.len(),
        residual_px: (squares / inliers.max(1) as f64).sqrt(),
    };
    Ok(Start { cam_b_from_cam_a: known.cam_b_from_cam_a, source, matches, counts })
}

/// Whether matches agree with a motion.
struct Judge<'a> {
    motion: Motion,
    essential: Matrix3<f64>,
    cameras: [&'a Camera; 2],
    focal_px: f64,
}

impl<'a> Judge<'a> {
    fn new(cam_b_from_cam_a: &Rigid3<CamB, CamA>, cameras: [&'a Camera; 2]) -> Self {
        let translation = cam_b_from_cam_a.origin().coords;
        let motion = Motion {
            rotation: cam_b_from_cam_a.rotation(),
            translation: translation.try_normalize(0.0).unwrap_or(translation),
        };
        let focal_px = cameras.iter().map(|camera| camera.fx * camera.fy).product::<f64>().powf(0.25);
        Self { motion, essential: motion.essential(), cameras, focal_px }
    }

    fn rays(&self, a: &Point2<f64>, b: &Point2<f64>) -> Option<[Vector3<f64>; 2]> {
        Some([self.cameras[0].ray_z1(a)?, self.cameras[1].ray_z1(b)?])
    }

    fn residual_px(&self, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
        self.rays(a, b).map_or(f64::NAN, |[a, b]| sampson::distance(&self.essential, &a, &b) * self.focal_px)
    }

    fn agrees(&self, a: &Point2<f64>, b: &Point2<f64>) -> bool {
        self.rays(a, b).is_some_and(|[ray_a, ray_b]| {
            self.residual_px(a, b).abs() < TOLERANCE_PX && cheirality::in_front(&self.motion, &ray_a, &ray_b)
        })
    }
}
