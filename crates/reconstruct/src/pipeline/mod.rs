//! The one way from pictures to a placed prediction, for commands, programs and the evaluation: what the pictures are, what is
//! known, which method, what is wanted.

mod focal;
mod given;
mod matcher;
mod shading;
mod surface;

use crate::evidence::{FocalKnowledge, FocalSource, PoseSource, Warning};
use crate::learned::{self, LearnedInput, LearnedOptions, Solved};
use crate::matches_file::GivenMatches;
use crate::prediction::NoPose;
use crate::priors::Priors;
use crate::relative_pose::{Counts, JudgedMatch, OrbOptions, SiftOptions};
use crate::scale::{Placement, ScaleSource};
use crate::shading::ShadingOptions;
use crate::stereo::{Completion, StereoOptions};
use crate::{Error, Prediction, View, triangulate};
use given::Start;
use matcher::Matcher;
use selenograph_geometry::Camera;
use selenograph_pose::relative::CannotSay;
use serde::{Deserialize, Serialize};
pub use surface::{ShadedSurface, ShadingOutcome, ShadingUse};

/// How pose and points are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's baseline: ORB features, the pose unrefined, and a point per match
    Orb,
    /// SIFT features only: the pose, and a point per match
    Sift,
    /// The pose from SIFT features, then a point per pixel
    #[default]
    Stereo,
    /// A network of the MASt3R family: matches and a point per pixel
    Mast3r,
    /// The matches of such a network in place of features, then a point per pixel as `stereo`
    Mast3rStereo,
    /// `stereo` with shading in any case: one surface whose renderings equal the pictures, under one Sun or two; the matches are SIFT's,
    /// or the network's where those tell no pose
    Fused,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Orb, Self::Sift, Self::Stereo, Self::Mast3r, Self::Mast3rStereo, Self::Fused];

    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Orb => "orb",
            Self::Sift => "sift",
            Self::Stereo => "stereo",
            Self::Mast3r => "mast3r",
            Self::Mast3rStereo => "mast3r-stereo",
            Self::Fused => "fused",
        }
    }

    /// Whether it needs what a network says of the pictures.
    pub fn needs_network(self) -> bool {
        matches!(self, Self::Mast3r | Self::Mast3rStereo)
    }

    /// Whether it takes given matches in place of features.
    pub fn takes_matches(self) -> bool {
        matches!(self, Self::Sift | Self::Stereo | Self::Fused)
    }
}

/// What the answer is to hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wanted {
    /// The relative pose alone.
    Pose,
    /// Pose and points.
    #[default]
    Points,
}

/// What is done where a part of the answer cannot be given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Incomplete {
    /// There is no answer: the reason is the error.
    #[default]
    Refuse,
    /// What there is, is given: a pose without points, points without a pose, or neither; the prediction says why. It is what an
    /// evaluation wants, which counts what is missing.
    Keep,
}

/// Settings of the whole way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// How pose and points are found.
    pub method: Method,
    /// What the answer is to hold.
    pub wanted: Wanted,
    /// What is done where a part of it cannot be given.
    pub incomplete: Incomplete,
    /// Whether the focal lengths of the views' cameras are known.
    pub focal: FocalKnowledge,
    /// ORB features, matches and the robust estimate.
    pub orb: OrbOptions,
    /// SIFT features, matches and the robust estimate; of given matches what comes after the matching.
    pub sift: SiftOptions,
    /// Dense stereo. Where nothing was measured nothing is given, unless `completion` says otherwise.
    pub stereo: StereoOptions,
    /// What follows from a network's arrays.
    pub learned: LearnedOptions,
    /// Whether shading joins dense stereo.
    pub shading_use: ShadingUse,
    /// Shading, where it does.
    pub shading: ShadingOptions,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::default(),
            wanted: Wanted::default(),
            incomplete: Incomplete::default(),
            focal: FocalKnowledge::default(),
            orb: OrbOptions::default(),
            sift: SiftOptions::default(),
            stereo: StereoOptions { completion: Completion::None, ..StereoOptions::default() },
            learned: LearnedOptions::default(),
            shading_use: ShadingUse::default(),
            shading: ShadingOptions::default(),
        }
    }
}

impl Options {
    /// Whether shading takes part: the one place where method and choice come together.
    pub fn shading_use(&self, priors: &Priors) -> ShadingUse {
        let asked = match self.method {
            Method::Fused => ShadingUse::On,
            Method::Stereo | Method::Mast3rStereo => self.shading_use,
            Method::Orb | Method::Sift | Method::Mast3r => ShadingUse::Off,
        };
        match asked {
            ShadingUse::Auto if priors.suns.iter().any(Option::is_none) => ShadingUse::Off,
            asked => asked,
        }
    }

    /// With one seed for every random sample.
    #[must_use]
    pub fn seeded(mut self, seed: u64) -> Self {
        self.orb.seed = seed;
        self.sift.seed = seed;
        self.learned.seed = seed;
        self
    }
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
    /// One surface that explains the pictures' shading.
    Shading,
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
            Self::Shading => "shading",
            Self::Placement => "scale and place",
        }
    }
}

/// What the pictures are.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a> {
    /// Both pictures with their cameras.
    pub views: [&'a View; 2],
    /// What a network says of them: for the methods that need it; with shading its matches are taken where features tell nothing.
    pub learned: Option<&'a LearnedInput>,
    /// Matches of any matcher in place of features, for the methods `sift` and `stereo`.
    pub matches: Option<&'a GivenMatches>,
}

/// A placed prediction and what it rests on.
#[derive(Debug, Clone)]
pub struct Reconstruction {
    /// Pose and points in the method's own unit.
    pub prediction: Prediction,
    /// Where the pose comes from.
    pub pose: PoseSource,
    /// The matches it rests on, or is checked with.
    pub matches: Vec<JudgedMatch>,
    /// How many there were after each step.
    pub counts: Counts,
    /// Size and place.
    pub placement: Placement,
    /// The cameras that were used.
    pub cameras: [Camera; 2],
    /// Where their focal lengths come from.
    pub focal: FocalSource,
    /// What shading did.
    pub shading: ShadingOutcome,
    /// What must be said.
    pub warnings: Vec<Warning>,
}

/// Whether features have left open what a network's matches may tell: no pose, or none with which a surface explains the pictures. Features
/// are of light and shade: two Suns take both away.
pub fn features_fail(found: Result<&ShadingOutcome, &Error>) -> bool {
    match found {
        Ok(shading) => matches!(shading, ShadingOutcome::LeftOut(_)),
        Err(error) => matches!(error, Error::CannotSay(_) | Error::NotShaded(_)),
    }
}

/// Reconstructs what two pictures show.
///
/// `progress` is told of each step that begins.
///
/// # Errors
/// [`Error::NoNetworkOutput`] for a method that needs it; [`Error::Value`] for given matches with a method that does not take them; [`Error::SizeMismatch`] for a camera or a pointmap of another size than its
/// picture; those of the scale source. Unless incomplete answers are kept: [`Error::CannotSay`] where the pictures do not tell a
/// relative pose (too little in common, no parallax) and one is asked for, [`Error::NotShaded`] where shading must carry the answer under
/// two Suns and does not, and those of dense stereo.
pub fn reconstruct(
    input: &Input<'_>,
    priors: &Priors,
    options: &Options,
    mut progress: impl FnMut(Stage),
) -> Result<Reconstruction, Error> {
    check(input.views)?;
    // Before minutes of work: a source that is asked for must be there.
    priors.scale_from()?;
    if input.matches.is_some() && !options.method.takes_matches() {
        return Err(Error::Value {
            key: "matches",
            expected: "the method `sift` or `stereo` with them",
            found: format!("`{}`", options.method.as_str()),
        });
    }
    let matcher = match (options.method, input.learned) {
        (Method::Orb, _) => Matcher::Orb(&options.orb),
        (Method::Sift | Method::Stereo | Method::Fused, _) => match input.matches {
            Some(given) => Matcher::Given(&given.matches, given.grain),
            None => Matcher::Sift,
        },
        (Method::Mast3rStereo, Some(said)) => Matcher::Given(&said.learned.matches, said.learned.grain),
        (Method::Mast3r, Some(said)) => {
            progress(Stage::Pose);
            return from_arrays(said, priors, options)?.placed(priors, progress);
        }
        (Method::Mast3r | Method::Mast3rStereo, None) => {
            return Err(Error::NoNetworkOutput { method: options.method.as_str() });
        }
    };
    let mut found = from_pictures(input.views, matcher, priors, options, &mut progress);
    let is_shaded = options.shading_use(priors) != ShadingUse::Off;
    let in_place = input.learned.filter(|_| matches!(matcher, Matcher::Sift) && is_shaded);
    if let (true, Some(said)) = (features_fail(found.as_ref().map(|found| &found.shading)), in_place) {
        let matcher = Matcher::Given(&said.learned.matches, said.learned.grain);
        let second = from_pictures(input.views, matcher, priors, options, &mut progress);
        let is_used = matches!(&second, Ok(found) if matches!(found.shading, ShadingOutcome::Used(_)));
        if is_used || found.is_err() {
            found = second;
        }
    }
    let found = match found {
        Err(Error::CannotSay(why)) if options.incomplete == Incomplete::Keep => {
            let cameras = input.views.map(|view| view.camera.clone());
            Unplaced::without_pose(why, cameras)
        }
        found => found?,
    };
    found.placed(priors, progress)
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

/// An answer without size and place.
struct Unplaced {
    prediction: Prediction,
    pose: PoseSource,
    matches: Vec<JudgedMatch>,
    counts: Counts,
    cameras: [Camera; 2],
    focal: FocalSource,
    shading: ShadingOutcome,
    warnings: Vec<Warning>,
}

impl Unplaced {
    fn without_pose(why: CannotSay, cameras: [Camera; 2]) -> Self {
        Self {
            prediction: Prediction { cam_b_from_cam_a: Err(why.into()), views: None },
            pose: PoseSource::Nothing,
            matches: Vec::new(),
            counts: Counts::default(),
            cameras,
            focal: FocalSource::Known,
            shading: ShadingOutcome::NotAsked,
            warnings: Vec::new(),
        }
    }

    fn placed(self, priors: &Priors, mut progress: impl FnMut(Stage)) -> Result<Reconstruction, Error> {
        let Self { prediction, pose, matches, counts, cameras, focal, shading, mut warnings } = self;
        progress(Stage::Placement);
        let placement = priors.place(&prediction)?;
        warnings.extend(disagreements(priors, &prediction, &placement));
        if !placement.metric {
            warnings.push(match prediction.cam_b_from_cam_a {
                Ok(_) => Warning::NotMetric,
                Err(_) => Warning::NetworkUnit,
            });
        }
        Ok(Reconstruction { prediction, pose, matches, counts, placement, cameras, focal, shading, warnings })
    }
}

/// Sizes that differ by more than this share are said.
const DISAGREEMENT: f64 = 0.05;

/// What the priors that did not give the size say about it.
fn disagreements(priors: &Priors, prediction: &Prediction, placement: &Placement) -> Vec<Warning> {
    let Some(used) = placement.source else { return Vec::new() };
    let others = ScaleSource::ALL.into_iter().filter(|other| *other != used);
    others
        .filter_map(|other| {
            let with_other = Priors { scale_from: Some(other), ..priors.clone() };
            let ratio = with_other.place(prediction).ok()?.cam_a_from_pred.scale()
                / placement.cam_a_from_pred.scale();
            let differs = (ratio - 1.0).abs() > DISAGREEMENT;
            differs.then_some(Warning::ScalesDisagree { used: used.as_str(), other: other.as_str(), ratio })
        })
        .collect()
}

/// Pose and points as a network has them.
fn from_arrays(said: &LearnedInput, priors: &Priors, options: &Options) -> Result<Unplaced, Error> {
    let LearnedInput { learned, cameras, focal } = said;
    let known = priors.cam_b_from_cam_a.as_ref();
    let Solved { mut prediction, source, matches, warnings: solving } =
        learned::solve(cameras.each_ref(), learned, known, &options.learned)?;
    let mut warnings: Vec<Warning> = focal.warning().into_iter().chain(solving).collect();
    match &prediction.cam_b_from_cam_a {
        Err(NoPose::CannotSay(why)) if options.incomplete == Incomplete::Refuse => {
            return Err(why.clone().into());
        }
        Err(NoPose::NotAsked) => warnings.push(Warning::NoPose),
        _ => {}
    }
    if options.wanted == Wanted::Pose {
        prediction.views = None;
    }
    let counts = Counts {
        matches: matches.len(),
        inliers: matches.iter().filter(|m| m.inlier).count(),
        ..Counts::default()
    };
    Ok(Unplaced {
        prediction,
        pose: source,
        matches,
        counts,
        cameras: cameras.clone(),
        focal: *focal,
        shading: ShadingOutcome::NotAsked,
        warnings,
    })
}

/// Pose from matches, points from the pictures.
fn from_pictures(
    [a, b]: [&View; 2],
    matcher: Matcher<'_>,
    priors: &Priors,
    options: &Options,
    progress: &mut impl FnMut(Stage),
) -> Result<Unplaced, Error> {
    let (cameras, focal) = match options.focal {
        FocalKnowledge::Known => ([a.camera.clone(), b.camera.clone()], FocalSource::Known),
        FocalKnowledge::Guessed => {
            progress(Stage::Focal);
            focal::cameras([a, b], matcher, &options.sift)?
        }
    };
    let mut warnings: Vec<Warning> = focal.warning().into_iter().collect();
    let [a, b] = [(a, &cameras[0]), (b, &cameras[1])]
        .map(|(view, camera)| View { camera: camera.clone(), ..view.clone() });
    progress(Stage::Pose);
    let start = match &priors.cam_b_from_cam_a {
        Some(known) => given::start(&a, &b, known, matcher, &options.sift)?,
        None => matcher.pose(&a, &b, &options.sift)?.into(),
    };
    warnings.extend(start.source.warning());
    let mut shading = ShadingOutcome::NotAsked;
    let views = match (options.wanted, options.method) {
        (Wanted::Pose, _) => None,
        (Wanted::Points, Method::Orb | Method::Sift) => {
            Some(triangulate::matched([&a.camera, &b.camera], &start.cam_b_from_cam_a, &start.matches))
        }
        (Wanted::Points, Method::Stereo | Method::Mast3r | Method::Mast3rStereo | Method::Fused) => {
            let found = surface::points([&a, &b], &start, priors, options, progress)?;
            shading = found.shading;
            warnings.extend(found.doubts);
            found.views
        }
    };
    let Start { mut cam_b_from_cam_a, source, matches, counts } = start;
    match &shading {
        ShadingOutcome::Used(used) => cam_b_from_cam_a = used.shaded.pictures[1].cam_from_scene.relabel(),
        ShadingOutcome::LeftOut(why) => warnings.push(why.clone()),
        ShadingOutcome::NotAsked => {}
    }
    let prediction = Prediction { cam_b_from_cam_a: Ok(cam_b_from_cam_a), views };
    Ok(Unplaced { prediction, pose: source, matches, counts, cameras, focal, shading, warnings })
}
