//! Two pictures and whatever is known beforehand into a placed prediction: the whole way, for a command or a program.

mod answer;
mod focal;
mod given;
mod learned;
mod rays;

pub use answer::{FocalSource, PoseSource, Reconstruction, Warning};
pub(crate) use given::TOLERANCE_PX as GIVEN_TOLERANCE_PX;
pub use learned::{LearnedInput, reconstruct_learned};

use crate::learned::Learned;
use crate::matching::{Grain, Match};
use crate::priors::Priors;
use crate::relative_pose::{self, PairPose, SiftOptions};
use crate::stereo::{self, Seed, StereoOptions};
use crate::{Error, PredictedView, Prediction, View, triangulate};
use given::Start;
use selenograph_geometry::Camera;
use selenograph_pose::relative::CannotSay;
use serde::{Deserialize, Serialize};

/// How points are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Features only: the pose, and a point per match.
    Sift,
    /// The pose from features, then a point per pixel.
    #[default]
    Stereo,
}

/// What is done where nothing was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Completion {
    /// Nothing: the points are absent.
    #[default]
    Absent,
    /// Filled smoothly from the surroundings, and marked.
    Smooth,
}

/// Whether the cameras' focal lengths are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FocalKnowledge {
    /// The views' cameras are what they say.
    #[default]
    Known,
    /// The views' cameras hold a guess: it is replaced where the matches tell better.
    Guessed,
}

/// Settings of the whole way.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// How points are found.
    pub method: Method,
    /// What is done where nothing was measured.
    pub completion: Completion,
    /// Whether the focal lengths are known.
    pub focal: FocalKnowledge,
    /// Features, matches and the robust estimate.
    pub sift: SiftOptions,
    /// Dense stereo.
    pub stereo: StereoOptions,
}

/// A step of the work that begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The focal length from the matches.
    Focal,
    /// Features, matches, relative pose.
    Pose,
    /// A point per pixel.
    Dense,
    /// Size and place.
    Placement,
}

impl Stage {
    /// In words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Focal => "focal length",
            Self::Pose => "matches and pose",
            Self::Dense => "dense stereo",
            Self::Placement => "scale and place",
        }
    }
}

/// Whose matches the pose rests on.
#[derive(Clone, Copy)]
enum Matcher<'a> {
    /// Those of features.
    Sift,
    /// Given ones.
    Given(&'a [Match], Grain),
}

impl Matcher<'_> {
    fn pose(self, a: &View, b: &View, options: &SiftOptions) -> Result<PairPose, CannotSay> {
        match self {
            Self::Sift => relative_pose::sift(a, b, options),
            Self::Given(found, grain) => relative_pose::of_matches(a, b, found, grain, options),
        }
    }
}

/// Reconstructs what two pictures show.
///
/// `progress` is told of each step that begins.
///
/// # Errors
/// [`Error::CannotSay`] where the pictures do not tell a relative pose (too little in common, no parallax) and none is given;
/// [`Error::SizeMismatch`] for a camera of another size than its picture; those of dense stereo and of the scale source.
pub fn reconstruct(
    a: &View,
    b: &View,
    priors: &Priors,
    options: &Options,
    mut progress: impl FnMut(Stage),
) -> Result<Reconstruction, Error> {
    with_matcher([a, b], Matcher::Sift, priors, options, &mut progress)
}

/// [`reconstruct`] from the matches of a network or of any matcher on, in place of those of features. Points that it gave
/// are not looked at.
///
/// # Errors
/// As [`reconstruct`].
pub fn reconstruct_matched(
    a: &View,
    b: &View,
    learned: &Learned,
    priors: &Priors,
    options: &Options,
    mut progress: impl FnMut(Stage),
) -> Result<Reconstruction, Error> {
    let matcher = Matcher::Given(&learned.matches, learned.grain);
    with_matcher([a, b], matcher, priors, options, &mut progress)
}

fn with_matcher(
    [a, b]: [&View; 2],
    matcher: Matcher<'_>,
    priors: &Priors,
    options: &Options,
    progress: &mut impl FnMut(Stage),
) -> Result<Reconstruction, Error> {
    check([a, b])?;
    // Before minutes of work: a source that is asked for must be there.
    priors.scale_from()?;
    let (cameras, focal) = match options.focal {
        FocalKnowledge::Known => ([a.camera.clone(), b.camera.clone()], FocalSource::Known),
        FocalKnowledge::Guessed => {
            progress(Stage::Focal);
            guessed_cameras(a, b, matcher, options)?
        }
    };
    let mut warnings: Vec<Warning> = focal.warning().into_iter().collect();
    let [a, b] = [(a, &cameras[0]), (b, &cameras[1])]
        .map(|(view, camera)| View { camera: camera.clone(), ..view.clone() });
    progress(Stage::Pose);
    let start = match &priors.cam_b_from_cam_a {
        Some(known) => given::start(&a, &b, known, matcher, &options.sift)?,
        None => estimated(matcher.pose(&a, &b, &options.sift)?),
    };
    warnings.extend(start.source.warning());
    let views = match options.method {
        Method::Sift => triangulate::matched([&a.camera, &b.camera], &start.cam_b_from_cam_a, &start.matches),
        Method::Stereo => dense(&a, &b, &start, options, progress)?,
    };
    let prediction = Prediction { cam_b_from_cam_a: Ok(start.cam_b_from_cam_a), views: Some(views) };
    progress(Stage::Placement);
    let placement = priors.place(&prediction)?;
    warnings.extend(answer::disagreements(priors, &prediction, &placement));
    if !placement.metric {
        warnings.push(Warning::NotMetric);
    }
    let Start { source, matches, counts, .. } = start;
    Ok(Reconstruction { prediction, pose: source, matches, counts, placement, cameras, focal, warnings })
}

/// Whether each camera is of its picture's size.
fn check(views: [&View; 2]) -> Result<(), Error> {
    for (what, view) in ["camera of picture A", "camera of picture B"].into_iter().zip(views) {
        let size = |width: usize, height: usize| format!("{width}×{height}");
        let (image, camera) = (&view.image, &view.camera);
        if (image.width, image.height) != (camera.width, camera.height) {
            let expected = size(image.width, image.height);
            return Err(Error::SizeMismatch { what, expected, found: size(camera.width, camera.height) });
        }
    }
    Ok(())
}

/// What an estimated pose gives the rest of the way.
fn estimated(found: PairPose) -> Start {
    let PairPose { pose, matches, counts, .. } = found;
    Start {
        cam_b_from_cam_a: pose.cam_b_from_cam_a,
        source: PoseSource::Estimated(Box::new(pose)),
        matches,
        counts,
    }
}

/// Cameras whose focal length the matches tell, or the guessed ones.
fn guessed_cameras(
    a: &View,
    b: &View,
    matcher: Matcher<'_>,
    options: &Options,
) -> Result<([Camera; 2], FocalSource), Error> {
    // With a wrong focal length good matches miss their epipolar lines by pixels.
    let loose = SiftOptions {
        threshold_px: 3.0 * options.sift.threshold_px,
        refined_threshold_px: 3.0 * options.sift.threshold_px,
        ..options.sift.clone()
    };
    let found = matcher.pose(a, b, &loose)?;
    let centred = |m: &relative_pose::PairMatch| {
        let [p, q] =
            [(&m.a, &a.camera), (&m.b, &b.camera)].map(|(p, camera)| [p.x - camera.cx, p.y - camera.cy]);
        [p[0], p[1], q[0], q[1]]
    };
    let matches: Vec<focal::Centred> = found.matches.iter().map(centred).collect();
    let width_px = a.camera.width.max(b.camera.width) as f64;
    let cameras = [a.camera.clone(), b.camera.clone()];
    Ok(match focal::estimate(&matches, width_px, options.sift.seed) {
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

/// A point per pixel.
fn dense(
    a: &View,
    b: &View,
    start: &Start,
    options: &Options,
    progress: &mut impl FnMut(Stage),
) -> Result<[PredictedView; 2], Error> {
    progress(Stage::Dense);
    let seeds: Vec<Seed> =
        start.matches.iter().filter(|m| m.inlier).map(|m| Seed { a: m.a, b: m.b }).collect();
    let completion = match options.completion {
        Completion::Absent => stereo::Completion::None,
        Completion::Smooth => stereo::Completion::Everywhere,
    };
    let settings = StereoOptions { completion, ..options.stereo.clone() };
    let dense = stereo::dense(a, b, &start.cam_b_from_cam_a, &seeds, &settings)?;
    Ok(rays::predicted(&dense, [&a.camera, &b.camera], &start.cam_b_from_cam_a))
}
