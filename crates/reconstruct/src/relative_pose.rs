//! The relative pose of two pictures: features, matches, robust estimate, subpixel refinement, final estimate.

use crate::features::intensity::Intensity;
use crate::features::{orb, sift};
use crate::matching::{self, Grain, Match};
use crate::subpixel;
use crate::view::View;
use selenograph_geometry::{Camera, Point2, mean_focal_px};
use selenograph_pose::relative::{CannotSay, Order, Refinement, RelativeOptions, RelativePose, estimate};
use selenograph_pose::sampson;
use serde::{Deserialize, Serialize};

/// Matches that an estimate needs at least, as it says itself.
const MIN_MATCHES: usize = 8;

/// Refined matches must be this share of the first inliers, or the first estimate stays: a handful of windows on one crater
/// would be exact and still worse.
const MIN_REFINED_SHARE: f64 = 0.5;

/// What features are off by at least, pixels.
pub(crate) const FEATURE_NOISE_PX: f64 = 0.1;
/// What aligned windows are off by at least, pixels: two pictures from one place show up to 0.02 that is alike in neighbours.
const WINDOW_NOISE_PX: f64 = 0.03;

/// Settings of the chain called `sift`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SiftOptions {
    /// How features are found.
    pub features: sift::Options,
    /// How they are found where the first ones give no pose, or one with fewer inliers than `retry_below`.
    pub retry: sift::Options,
    /// Inliers below which features are looked for again; 0 tries once.
    pub retry_below: usize,
    /// Which of them match.
    pub matching: matching::Options,
    /// Largest Sampson distance of an inlier among feature matches, pixels.
    pub threshold_px: f64,
    /// How windows are aligned; `None` stops at the features' own places.
    pub subpixel: Option<subpixel::Options>,
    /// Largest Sampson distance of an inlier among aligned windows, pixels.
    pub refined_threshold_px: f64,
    /// Seed of the random samples.
    pub seed: u64,
}

impl Default for SiftOptions {
    fn default() -> Self {
        Self {
            features: sift::Options::default(),
            retry: sift::Options {
                first_octave: sift::FirstOctave::Doubled,
                max_keypoints: 4000,
                ..sift::Options::default()
            },
            retry_below: 80,
            matching: matching::Options::default(),
            threshold_px: 1.0,
            subpixel: Some(subpixel::Options::default()),
            refined_threshold_px: 0.3,
            seed: 0,
        }
    }
}

impl SiftOptions {
    fn robust(&self, threshold_px: f64, noise_px: f64, cameras: [&Camera; 2]) -> RelativeOptions {
        let focal_px = mean_focal_px(cameras);
        RelativeOptions {
            threshold: threshold_px / focal_px,
            least_noise: noise_px / focal_px,
            seed: self.seed,
            ..RelativeOptions::default()
        }
    }
}

/// Settings of the paper's baseline. It states none: these are the proposal of its successors' protocol, OpenCV's defaults with 5000
/// features, cross-checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OrbOptions {
    /// How features are found.
    pub features: orb::Options,
    /// Which of them match.
    pub matching: matching::Options,
    /// Largest Sampson distance of an inlier, pixels.
    pub threshold_px: f64,
    /// What is done after the minimal model: nothing in the paper's protocol.
    pub refinement: Refinement,
    /// Probability with which no better sample was missed.
    pub confidence: f64,
    /// Seed of the random samples.
    pub seed: u64,
}

impl Default for OrbOptions {
    fn default() -> Self {
        Self {
            features: orb::Options::default(),
            matching: matching::Options { max_ratio: 1.0 },
            threshold_px: 1.0,
            refinement: Refinement::None,
            confidence: 0.9999,
            seed: 0,
        }
    }
}

/// A match with what the pose leaves of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JudgedMatch {
    /// In picture A, pixels from its corner.
    pub a: Point2<f64>,
    /// In picture B.
    pub b: Point2<f64>,
    /// Signed Sampson distance, pixels; NaN outside a camera's lens model.
    pub residual_px: f64,
    /// Standard deviation by the windows' residual, pixels; `None` for a match of features.
    pub sigma_px: Option<f64>,
    /// Whether it agrees with the pose.
    pub inlier: bool,
}

impl JudgedMatch {
    /// A match that no pose has judged.
    pub fn unjudged(a: Point2<f64>, b: Point2<f64>) -> Self {
        Self { a, b, residual_px: f64::NAN, sigma_px: None, inlier: false }
    }
}

/// How many there were after each step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Counts {
    /// Features of A and of B.
    pub features: [usize; 2],
    /// Matches of features.
    pub matches: usize,
    /// Those that agree with the first estimate.
    pub first_inliers: usize,
    /// Aligned windows.
    pub refined: usize,
    /// Matches that agree with the pose.
    pub inliers: usize,
}

/// A relative pose and the matches it rests on.
#[derive(Debug, Clone)]
pub struct PairPose {
    /// The pose, its translation of length 1; its list of inliers goes with `matches`.
    pub pose: RelativePose,
    /// The matches of the last step that had enough of them.
    pub matches: Vec<JudgedMatch>,
    /// How many there were after each step.
    pub counts: Counts,
}

/// The whole chain: SIFT, mutual nearest neighbours, LO-RANSAC, aligned windows, Sampson refinement over all of them.
///
/// # Errors
/// [`CannotSay`] with the reason, also for pictures that show nothing.
pub fn sift(a: &View, b: &View, options: &SiftOptions) -> Result<PairPose, CannotSay> {
    let mut counts = Counts::default();
    let (Some(seen_a), Some(seen_b)) = rayon::join(|| Intensity::new(&a.image), || Intensity::new(&b.image))
    else {
        return Err(CannotSay::TooFewMatches { found: 0, needed: MIN_MATCHES });
    };
    let cameras = [&a.camera, &b.camera];
    let mut attempt = |features: &sift::Options| {
        let found = matched([&seen_a, &seen_b], features, &options.matching, &mut counts);
        let robust = options.robust(options.threshold_px, FEATURE_NOISE_PX, cameras);
        let estimated = Estimated::new(&found, None, cameras, &robust);
        estimated.map(|estimated| (found, estimated))
    };
    let mut first = attempt(&options.features);
    let scarce = first.as_ref().map_or(true, |(_, first)| first.num_inliers() < options.retry_below);
    if scarce && options.features != options.retry {
        let again = attempt(&options.retry);
        let better = |(_, again): &(_, Estimated)| {
            first.as_ref().map_or(true, |(_, first)| again.num_inliers() > first.num_inliers())
        };
        if again.as_ref().is_ok_and(better) {
            first = again;
        }
    }
    let (found, first) = first?;
    first.aligned(&found, [&seen_a, &seen_b], cameras, options, counts)
}

/// The chain from any matcher's matches on, robust estimate, aligned windows, Sampson refinement. Of `options` only what comes after the matching counts, `threshold_px` in pixels of the matcher.
///
/// # Errors
/// As [`sift()`].
pub fn of_matches(
    a: &View,
    b: &View,
    found: &[Match],
    grain: Grain,
    options: &SiftOptions,
) -> Result<PairPose, CannotSay> {
    let mut counts = Counts::default();
    let (Some(seen_a), Some(seen_b)) = rayon::join(|| Intensity::new(&a.image), || Intensity::new(&b.image))
    else {
        return Err(CannotSay::TooFewMatches { found: 0, needed: MIN_MATCHES });
    };
    let cameras = [&a.camera, &b.camera];
    let threshold_px = options.threshold_px * grain.match_px;
    let robust = RelativeOptions {
        per_evidence: grain.per_patch(found),
        ..options.robust(threshold_px, grain.noise_px, cameras)
    };
    let first = Estimated::new(found, None, cameras, &robust)?;
    counts.matches = found.len();
    first.aligned(found, [&seen_a, &seen_b], cameras, options, counts)
}

/// Features of both pictures and their matches.
fn matched(
    [a, b]: [&Intensity; 2],
    features: &sift::Options,
    matching: &matching::Options,
    counts: &mut Counts,
) -> Vec<Match> {
    let (a, b) = rayon::join(|| sift::detect_in(a, features), || sift::detect_in(b, features));
    let found = matching::sift(&a, &b, matching);
    counts.features = [a.keypoints.len(), b.keypoints.len()];
    counts.matches = found.len();
    found
}

/// The paper's baseline: ORB, cross-checked Hamming neighbours, five-point RANSAC; `options.refinement` decides whether anything follows.
///
/// # Errors
/// [`CannotSay`] with the reason, also for pictures that show nothing.
pub fn orb(a: &View, b: &View, options: &OrbOptions) -> Result<PairPose, CannotSay> {
    let (features_a, features_b) =
        rayon::join(|| orb::detect(&a.image, &options.features), || orb::detect(&b.image, &options.features));
    let found = matching::orb(&features_a, &features_b, &options.matching);
    let cameras = [&a.camera, &b.camera];
    let robust = RelativeOptions {
        threshold: options.threshold_px / mean_focal_px(cameras),
        least_noise: FEATURE_NOISE_PX / mean_focal_px(cameras),
        seed: options.seed,
        confidence: options.confidence,
        refinement: options.refinement,
        order: if options.refinement == Refinement::None { Order::Random } else { Order::Prosac },
        ..RelativeOptions::default()
    };
    let estimated = Estimated::new(&found, None, cameras, &robust)?;
    let counts = Counts {
        features: [features_a.keypoints.len(), features_b.keypoints.len()],
        matches: found.len(),
        first_inliers: estimated.inliers(&found).len(),
        ..Counts::default()
    };
    Ok(estimated.into_pair(counts))
}

/// An estimate with the matches it came from.
struct Estimated {
    pose: RelativePose,
    matches: Vec<JudgedMatch>,
}

impl Estimated {
    fn new(
        found: &[Match],
        sigmas_px: Option<&[f64]>,
        cameras: [&Camera; 2],
        options: &RelativeOptions,
    ) -> Result<Self, CannotSay> {
        let matches = matching::on_plane(cameras, found);
        let pose = estimate(&matches, options)?;
        let motion = selenograph_pose::decompose::Motion {
            rotation: pose.cam_b_from_cam_a.rotation(),
            translation: pose.cam_b_from_cam_a.origin().coords,
        };
        let (essential, focal_px) = (motion.essential(), mean_focal_px(cameras));
        let matches = (0..found.len())
            .map(|i| {
                let [a, b] =
                    [&matches[i].a, &matches[i].b].map(|p| selenograph_geometry::Vector3::new(p.x, p.y, 1.0));
                JudgedMatch {
                    a: found[i].a,
                    b: found[i].b,
                    residual_px: sampson::distance(&essential, &a, &b) * focal_px,
                    sigma_px: sigmas_px.map(|sigmas| sigmas[i]),
                    inlier: pose.inliers[i],
                }
            })
            .collect();
        Ok(Self { pose, matches })
    }

    fn inliers(&self, found: &[Match]) -> Vec<Match> {
        found.iter().zip(&self.pose.inliers).filter(|(_, inlier)| **inlier).map(|(m, _)| *m).collect()
    }

    /// The estimate again from the windows of its inliers, aligned to subpixels, or itself where too few can be.
    fn aligned(
        self,
        found: &[Match],
        [a, b]: [&Intensity; 2],
        cameras: [&Camera; 2],
        options: &SiftOptions,
        mut counts: Counts,
    ) -> Result<PairPose, CannotSay> {
        let seeds = self.inliers(found);
        counts.first_inliers = seeds.len();
        let refined = match &options.subpixel {
            Some(options) => subpixel::refine(a, b, &seeds, options),
            None => Vec::new(),
        };
        counts.refined = refined.len();
        let is_enough =
            refined.len() >= MIN_MATCHES && refined.len() as f64 >= MIN_REFINED_SHARE * seeds.len() as f64;
        let second = is_enough.then(|| {
            let sigmas: Vec<f64> = refined.iter().map(|r| r.sigma_px).collect();
            let aligned: Vec<Match> =
                refined.iter().map(|r| Match { a: r.a, b: r.b, score: -r.sigma_px }).collect();
            let robust = options.robust(options.refined_threshold_px, WINDOW_NOISE_PX, cameras);
            Self::new(&aligned, Some(&sigmas), cameras, &robust)
        });
        match second {
            Some(Ok(second)) => Ok(second.into_pair(counts)),
            // What looked like a motion was the noise of the features.
            Some(Err(none @ CannotSay::NoParallax { .. })) => Err(none),
            Some(Err(_)) | None => Ok(self.into_pair(counts)),
        }
    }

    fn num_inliers(&self) -> usize {
        self.pose.inliers.iter().filter(|inlier| **inlier).count()
    }

    fn into_pair(self, counts: Counts) -> PairPose {
        let counts = Counts { inliers: self.num_inliers(), ..counts };
        PairPose { pose: self.pose, matches: self.matches, counts }
    }
}
