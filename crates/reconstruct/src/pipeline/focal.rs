//! One focal length for both pictures, from the matches alone, where they determine it.
//!
//! The essential matrix of the right camera has two equal singular values; with a wrong focal length no motion explains the matches
//! as well. The cost of the best motion is followed over the focal length; its curvature at the minimum says how well the
//! matches determine it. They do not for parallel viewing directions, for a pure translation, or for a plane: then the curve is
//! flat, and the answer is none.
//!
//! # Source
//! The condition on the singular values: Mendonça & Cipolla 1999, "A simple technique for self-calibration", CVPR; the curvature as
//! variance is that of any least-squares fit.

use super::matcher::Matcher;
use crate::evidence::FocalSource;
use crate::relative_pose::{JudgedMatch, SiftOptions};
use crate::{Error, View};
use selenograph_geometry::{Camera, Point2};
use selenograph_pose::decompose::Motion;
use selenograph_pose::points::Pairs;
use selenograph_pose::refine::{self, Loss};
use selenograph_pose::relative::{self, Match, RelativeOptions};
use selenograph_pose::sampson;

/// Cameras whose focal length the matches tell, or the guessed ones.
pub(super) fn cameras(
    [a, b]: [&View; 2],
    matcher: Matcher<'_>,
    options: &SiftOptions,
) -> Result<([Camera; 2], FocalSource), Error> {
    // With a wrong focal length good matches miss their epipolar lines by pixels.
    let loose = SiftOptions {
        threshold_px: 3.0 * options.threshold_px,
        refined_threshold_px: 3.0 * options.threshold_px,
        ..options.clone()
    };
    let found = matcher.pose(a, b, &loose)?;
    let centred = |m: &JudgedMatch| {
        let [p, q] =
            [(&m.a, &a.camera), (&m.b, &b.camera)].map(|(p, camera)| [p.x - camera.cx, p.y - camera.cy]);
        [p[0], p[1], q[0], q[1]]
    };
    let matches: Vec<Centred> = found.matches.iter().map(centred).collect();
    let width_px = a.camera.width.max(b.camera.width) as f64;
    let cameras = [a.camera.clone(), b.camera.clone()];
    Ok(match estimate(&matches, width_px, options.seed) {
        Some(estimate) => {
            let with = |camera: Camera| Camera { fx: estimate.focal_px, fy: estimate.focal_px, ..camera };
            let source = FocalSource::Estimated { focal_px: estimate.focal_px, sigma_px: estimate.sigma_px };
            (cameras.map(with), source)
        }
        None => {
            let source =
                FocalSource::Assumed { focal_px: a.camera.fx, fov_deg: a.camera.fov_x_rad().to_degrees() };
            (cameras, source)
        }
    })
}

/// A match in pixels from the middle of each picture.
pub type Centred = [f64; 4];

/// A focal length with what is known of its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FocalEstimate {
    /// Pixels.
    pub focal_px: f64,
    /// Standard deviation, pixels.
    pub sigma_px: f64,
}

/// Focal lengths that are tried, in widths of the picture: fields of view of 103° to 7°.
const SHORTEST: f64 = 0.4;
const LONGEST: f64 = 8.0;
const NUM_TRIED: usize = 13;
/// Matches farther than this from their epipolar line say nothing about the focal length, pixels.
const CUTOFF_PX: f64 = 1.5;
/// Matches are correlated and no picture is a perfect pinhole: the sigma of independent noise is too small by about this factor.
const SIGMA_FACTOR: f64 = 3.0;
/// No lens is a pinhole, and no resampled picture exact, to better than this: what all matches share does not average out, pixels.
const NOISE_FLOOR_PX: f64 = 0.1;
/// A focal length known worse than this share of itself is not better than an assumed one.
const LARGEST_SHARE: f64 = 0.05;
/// Fewer matches leave too little beside the six unknowns.
const MIN_MATCHES: usize = 30;
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// Cost of the best motion at a focal length.
struct Fit {
    cost: f64,
    motion: Motion,
}

/// The focal length of both pictures, if the matches determine it to 5 %.
///
/// # Shapes and units
/// Matches in pixels from the principal point (the middle of each picture); `width_px` is the width of the wider picture.
pub fn estimate(matches: &[Centred], width_px: f64, seed: u64) -> Option<FocalEstimate> {
    if matches.len() < MIN_MATCHES {
        return None;
    }
    let ratio = (LONGEST / SHORTEST).powf(1.0 / (NUM_TRIED - 1) as f64);
    let tried: Vec<(f64, Option<Fit>)> = (0..NUM_TRIED)
        .map(|k| width_px * SHORTEST * ratio.powi(k as i32))
        .map(|focal_px| (focal_px, searched(matches, focal_px, seed)))
        .collect();
    let cost_of = |k: usize| tried[k].1.as_ref().map_or(f64::INFINITY, |fit| fit.cost);
    let best = (0..NUM_TRIED).min_by(|i, j| cost_of(*i).total_cmp(&cost_of(*j)))?;
    // A minimum at an end is none: the cost goes on falling beyond.
    if best == 0 || best + 1 == NUM_TRIED {
        return None;
    }
    let start = tried[best].1.as_ref()?.motion;
    let at = |log_focal: f64| refined(matches, log_focal.exp(), &start).cost;
    let log_focal = golden_section(tried[best - 1].0.ln(), tried[best + 1].0.ln(), &at);
    let focal_px = log_focal.exp();
    let fit = refined(matches, focal_px, &start);
    let sigma_px = noise_px(matches, focal_px, &fit.motion).max(NOISE_FLOOR_PX);
    // Second difference of the squared residuals over the logarithm of the focal length.
    let step = 0.05;
    let curvature = (at(log_focal - step) - 2.0 * fit.cost + at(log_focal + step)) / (step * step);
    let share = SIGMA_FACTOR * sigma_px * (2.0 / curvature).sqrt();
    (curvature > 0.0 && share.is_finite() && share < LARGEST_SHARE)
        .then_some(FocalEstimate { focal_px, sigma_px: share * focal_px })
}

fn pairs(matches: &[Centred], focal_px: f64) -> Pairs {
    Pairs::new(matches.iter().map(|m| m.map(|v| v / focal_px)))
}

/// From nothing: the robust search at this focal length.
fn searched(matches: &[Centred], focal_px: f64, seed: u64) -> Option<Fit> {
    let normalised: Vec<Match> = matches
        .iter()
        .map(|m| m.map(|v| v / focal_px))
        .map(|[ax, ay, bx, by]| Match { a: Point2::new(ax, ay), b: Point2::new(bx, by), score: 0.0 })
        .collect();
    let options = RelativeOptions { threshold: CUTOFF_PX / focal_px, seed, ..RelativeOptions::default() };
    let found = relative::estimate(&normalised, &options).ok()?;
    let motion = Motion {
        rotation: found.cam_b_from_cam_a.rotation(),
        translation: found.cam_b_from_cam_a.origin().coords,
    };
    Some(refined(matches, focal_px, &motion))
}

/// From a motion nearby; the cost is in squared pixels, each match's bounded.
fn refined(matches: &[Centred], focal_px: f64, start: &Motion) -> Fit {
    let pairs = pairs(matches, focal_px);
    let scale = (0.5 * CUTOFF_PX / focal_px).powi(2);
    let refined = refine::refine(
        &pairs,
        start,
        Loss::Cauchy { scale_squared: scale, cutoff_squared: (CUTOFF_PX / focal_px).powi(2) },
        20,
    );
    let e = refined.motion.essential();
    let bound = CUTOFF_PX * CUTOFF_PX;
    let cost = (0..pairs.len())
        .map(|i| (sampson::distance(&e, &pairs.a(i), &pairs.b(i)) * focal_px).powi(2).min(bound))
        .sum();
    Fit { cost, motion: refined.motion }
}

fn noise_px(matches: &[Centred], focal_px: f64, motion: &Motion) -> f64 {
    refine::robust_sigma(&pairs(matches, focal_px), &motion.essential(), CUTOFF_PX / focal_px) * focal_px
}

/// The place of a minimum between two ends.
fn golden_section(mut low: f64, mut high: f64, cost: &impl Fn(f64) -> f64) -> f64 {
    let inside = |low: f64, high: f64| [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let [mut left, mut right] = inside(low, high);
    let (mut at_left, mut at_right) = (cost(left), cost(right));
    for _ in 0..24 {
        if at_left < at_right {
            (high, right, at_right) = (right, left, at_left);
            left = inside(low, high)[0];
            at_left = cost(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = inside(low, high)[1];
            at_right = cost(right);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Rotation3, Vector3};

    /// Matches of 300 points on rough ground, with noise of about 0.2 pixels; the second camera turned and shifted.
    fn matches(focal_px: f64, turn: [f64; 3], shift: Vector3<f64>, roughness: f64) -> Vec<Centred> {
        let rotation = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
        let share = |k: usize, n: usize| (k * n % 997) as f64 / 997.0 - 0.5;
        (0..300)
            .map(|k| {
                let z = 10.0 + roughness * share(k, 617);
                let a = Vector3::new(share(k, 101) * 0.8 * z, share(k, 389) * 0.8 * z, z);
                let b = rotation * a + shift;
                let noise = |n: usize| 0.7 * share(k, n);
                [
                    focal_px * a.x / a.z + noise(53),
                    focal_px * a.y / a.z + noise(71),
                    focal_px * b.x / b.z + noise(211),
                    focal_px * b.y / b.z + noise(307),
                ]
            })
            .collect()
    }

    #[test]
    fn a_turned_view_of_rough_ground_tells_the_focal_length() {
        let matches = matches(600.0, [0.05, 0.45, 0.3], Vector3::new(-4.5, 0.4, 1.0), 4.0);
        let found = estimate(&matches, 512.0, 1).unwrap();
        assert!((found.focal_px - 600.0).abs() < 2.0 * found.sigma_px, "{found:?}");
        assert!(found.sigma_px < 30.0, "{found:?}");
    }

    #[test]
    fn what_cannot_tell_it_does_not() {
        // A pure translation fits every focal length.
        assert_eq!(estimate(&matches(600.0, [0.0; 3], Vector3::new(-3.0, 0.2, 0.1), 4.0), 512.0, 1), None);
        // So does a plane.
        let plane = matches(600.0, [0.05, 0.45, 0.3], Vector3::new(-4.5, 0.4, 1.0), 0.0);
        assert_eq!(estimate(&plane, 512.0, 1), None);
        assert_eq!(estimate(&plane[..20], 512.0, 1), None);
    }
}
