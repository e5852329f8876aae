//! Methods that see the two pictures and their cameras only.

use crate::pair_metrics::PAPER_ROWS;
use crate::truth::crop_rows;
use nalgebra::Point2;
use selenograph_geometry::{CamA, CamB, Camera, Rigid3, pixel};
use selenograph_pose::relative::{CannotSay, Match, Order, Refinement, RelativeOptions, estimate};
use selenograph_reconstruct::features::orb;
use selenograph_reconstruct::matching;
use selenograph_reconstruct::relative_pose::{self, OrbOptions, PairPose, SiftOptions};
use selenograph_reconstruct::stereo::{self, Completion, StereoOptions};
use selenograph_reconstruct::{Prediction, View};

/// Best matches that the reference protocol keeps.
const NUM_BEST: usize = 2000;
/// Largest Sampson distance of an inlier of the reference protocol, pixels.
const REFERENCE_THRESHOLD_PX: f64 = 1.0;
/// Confidence of the reference protocol's search.
const REFERENCE_CONFIDENCE: f64 = 0.9999;

/// A relative pose, or why there is none.
pub type Pose = Result<Rigid3<CamB, CamA>, CannotSay>;

/// ORB as the paper's baseline is proposed.
pub fn orb([a, b]: &[View; 2]) -> Prediction {
    pose_only(relative_pose::orb(a, b, &OrbOptions::default()))
}

/// The chain called `sift`.
pub fn sift([a, b]: &[View; 2]) -> Prediction {
    pose_only(relative_pose::sift(a, b, &SiftOptions::default()))
}

/// The pose of the chain called `sift`, then depth of every pixel of both views from its inliers on.
pub fn stereo(views: &[View; 2]) -> Prediction {
    let [a, b] = views;
    dense(views, relative_pose::sift(a, b, &SiftOptions::default()))
}

/// Depth of every pixel of both views, from the inliers of a pose on.
pub fn dense([a, b]: &[View; 2], found: Result<PairPose, CannotSay>) -> Prediction {
    let found = match found {
        Ok(found) => found,
        Err(cannot_say) => return Prediction { cam_b_from_cam_a: Err(cannot_say), views: None },
    };
    let inliers = found.matches.iter().filter(|m| m.inlier);
    let seeds: Vec<stereo::Seed> = inliers.map(|m| stereo::Seed { a: m.a, b: m.b }).collect();
    let cam_b_from_cam_a = found.pose.cam_b_from_cam_a;
    // The whole image is judged too: what lies outside the overlap is carried on and marked as completed.
    let options = StereoOptions { completion: Completion::Everywhere, ..StereoOptions::default() };
    match stereo::dense(a, b, &cam_b_from_cam_a, &seeds, &options) {
        Ok(dense) => dense.to_prediction(a, b),
        // The pose stands; its pixels have no answer and count as such.
        Err(_) => Prediction { cam_b_from_cam_a: Ok(cam_b_from_cam_a), views: None },
    }
}

fn pose_only(found: Result<PairPose, CannotSay>) -> Prediction {
    Prediction { cam_b_from_cam_a: found.map(|pair| pair.pose.cam_b_from_cam_a), views: None }
}

/// A match in pixels from the corners, with its score (higher is better).
pub struct Scored {
    pub a: Point2<f64>,
    pub b: Point2<f64>,
    pub score: f64,
}

/// ORB's matches by the reference protocol.
pub fn orb_reference(views: &[View; 2]) -> Pose {
    let [a, b] = &central_rows(views);
    let options = OrbOptions::default();
    let [features_a, features_b] = [a, b].map(|view| orb::detect(&view.image, &options.features));
    let found = matching::orb(&features_a, &features_b, &options.matching);
    let scored = found.iter().map(|m| Scored { a: m.a, b: m.b, score: m.score }).collect();
    reference_pose(scored, [&a.camera, &b.camera], options.seed)
}

/// The matches of the chain called `sift` by the reference protocol: the surest windows are the best.
pub fn sift_reference(views: &[View; 2]) -> Pose {
    let [a, b] = &central_rows(views);
    let options = SiftOptions::default();
    let found = relative_pose::sift(a, b, &options)?;
    let scored =
        found.matches.iter().map(|m| Scored { a: m.a, b: m.b, score: -m.sigma_px.unwrap_or(0.0) }).collect();
    reference_pose(scored, [&a.camera, &b.camera], options.seed)
}

/// The central 384 rows; the views themselves where they have no more.
fn central_rows(views: &[View; 2]) -> [View; 2] {
    views.each_ref().map(|view| {
        let height = view.camera.height;
        let top = height.saturating_sub(PAPER_ROWS) / 2;
        match pixel::crop(&view.camera, 0, top, view.camera.width, PAPER_ROWS) {
            Ok(camera) if height > PAPER_ROWS => {
                View { image: crop_rows(&view.image, top, PAPER_ROWS), camera }
            }
            _ => view.clone(),
        }
    })
}

/// The 2000 best matches, five-point RANSAC within a pixel, nothing refined.
pub fn reference_pose(mut scored: Vec<Scored>, cameras: [&Camera; 2], seed: u64) -> Pose {
    // Stable: among equals the order of the features stays.
    scored.sort_by(|m, n| n.score.total_cmp(&m.score));
    scored.truncate(NUM_BEST);
    let on_plane = |camera: &Camera, at: &Point2<f64>| camera.ray_z1(at).map(|ray| Point2::new(ray.x, ray.y));
    let matches: Vec<Match> = scored
        .iter()
        .filter_map(|m| {
            Some(Match { a: on_plane(cameras[0], &m.a)?, b: on_plane(cameras[1], &m.b)?, score: m.score })
        })
        .collect();
    let focal_px = cameras.iter().map(|camera| camera.fx * camera.fy).product::<f64>().powf(0.25);
    let options = RelativeOptions {
        threshold: REFERENCE_THRESHOLD_PX / focal_px,
        seed,
        confidence: REFERENCE_CONFIDENCE,
        refinement: Refinement::None,
        order: Order::Random,
        ..RelativeOptions::default()
    };
    estimate(&matches, &options).map(|pose| pose.cam_b_from_cam_a)
}
