//! Methods that see the two pictures and their cameras only.

use super::item::{Answer, Item, Pose};
use crate::Error;
use crate::pair_metrics::{PAPER_ROWS, Promise};
use crate::truth::crop_rows;
use selenograph_geometry::{Camera, mean_focal_px, pixel};
use selenograph_pose::relative::{Order, Refinement, RelativeOptions, estimate};
use selenograph_reconstruct::View;
use selenograph_reconstruct::features::orb;
use selenograph_reconstruct::learned::{LearnedInput, LearnedOptions};
use selenograph_reconstruct::matching::{self, Match};
use selenograph_reconstruct::pipeline::{
    Incomplete, Input, Method, Options, ShadingUse, Wanted, reconstruct,
};
use selenograph_reconstruct::priors::Priors;
use selenograph_reconstruct::relative_pose::{self, OrbOptions, SiftOptions};
use selenograph_reconstruct::stereo::{Completion, StereoOptions};

/// Best matches that the reference protocol keeps.
const NUM_BEST: usize = 2000;
/// Largest Sampson distance of an inlier of the reference protocol, pixels.
const REFERENCE_THRESHOLD_PX: f64 = 1.0;
/// Confidence of the reference protocol's search.
const REFERENCE_CONFIDENCE: f64 = 0.9999;

/// What a method of `reconstruct` says of an item: what `selenograph reconstruct` would place and write, but that what is missing is
/// counted and not refused, and that the whole image is judged: what lies outside the overlap is carried on and marked as completed.
pub fn answer(method: Method, promise: Promise, item: &Item<'_>) -> Result<Answer, Error> {
    let session = || item.network.ok_or(Error::NoNetwork);
    let asks = method.needs_network() || (method == Method::Fused && item.lights[0] != item.lights[1]);
    let said = if asks { Some(session()?.said(item.views, item.lights)?) } else { None };
    let mut options = Options {
        method,
        wanted: if promise == Promise::Pose { Wanted::Pose } else { Wanted::Points },
        incomplete: Incomplete::Keep,
        stereo: StereoOptions { completion: Completion::Everywhere, ..item.options.stereo.clone() },
        // `stereo` is stereo alone here, and `fused` the one with shading: they stand side by side in the tables.
        shading_use: ShadingUse::Off,
        ..item.options.clone()
    };
    if let Some(session) = item.network {
        options.learned = session.geometry().clone();
    }
    let input = Input { views: item.views.each_ref(), learned: said.as_deref(), matches: None };
    options.shading.free_offset = item.lighting.is_stretched;
    let priors = Priors { suns: item.lighting.suns, ..Priors::default() };
    let prediction = reconstruct(&input, &priors, &options, |_| {})?.prediction;
    let reference_pose = match (&said, method) {
        (Some(said), _) => said_reference(said, &options.learned),
        (None, Method::Orb) => orb_reference(item.views, &options.orb),
        (None, _) => sift_reference(item.views, &options.sift),
    };
    Ok(Answer { prediction, reference_pose: Some(reference_pose) })
}

/// ORB's matches by the reference protocol.
fn orb_reference(views: &[View; 2], options: &OrbOptions) -> Pose {
    let [a, b] = &central_rows(views);
    let [features_a, features_b] = [a, b].map(|view| orb::detect(&view.image, &options.features));
    let found = matching::orb(&features_a, &features_b, &options.matching);
    reference_pose(found, [&a.camera, &b.camera], options.seed)
}

/// The matches of the chain called `sift` by the reference protocol: the surest windows are the best.
fn sift_reference(views: &[View; 2], options: &SiftOptions) -> Pose {
    let [a, b] = &central_rows(views);
    let found = relative_pose::sift(a, b, options)?;
    let scored = found.matches.iter();
    let scored = scored.map(|m| Match { a: m.a, b: m.b, score: -m.sigma_px.unwrap_or(0.0) }).collect();
    reference_pose(scored, [&a.camera, &b.camera], options.seed)
}

/// A network's matches by the reference protocol: those within the central rows.
fn said_reference(said: &LearnedInput, options: &LearnedOptions) -> Pose {
    let cameras = said.cameras.each_ref();
    let inside = |y: f64, camera: &Camera| {
        let top = camera.height.saturating_sub(PAPER_ROWS) / 2;
        (top as f64..(top + PAPER_ROWS) as f64).contains(&y)
    };
    let is_central = |m: &&Match| inside(m.a.y, cameras[0]) && inside(m.b.y, cameras[1]);
    let central = said.learned.matches.iter().filter(is_central).copied().collect();
    reference_pose(central, cameras, options.seed)
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
fn reference_pose(mut matches: Vec<Match>, cameras: [&Camera; 2], seed: u64) -> Pose {
    // Stable: among equals the order of the features stays.
    matches.sort_by(|m, n| n.score.total_cmp(&m.score));
    matches.truncate(NUM_BEST);
    let options = RelativeOptions {
        threshold: REFERENCE_THRESHOLD_PX / mean_focal_px(cameras),
        seed,
        confidence: REFERENCE_CONFIDENCE,
        refinement: Refinement::None,
        order: Order::Random,
        ..RelativeOptions::default()
    };
    Ok(estimate(&matching::on_plane(cameras, &matches), &options)?.cam_b_from_cam_a)
}
