//! What an answer rests on, and what must be said about it.

use crate::judge;
use crate::relative_pose::JudgedMatch;
use selenograph_geometry::{CamA, CamB, Rigid3};
use selenograph_pose::relative::RelativePose;
use serde::{Deserialize, Serialize};

/// Where the relative pose comes from.
#[derive(Debug, Clone)]
pub enum PoseSource {
    /// From the matches.
    Estimated(Box<RelativePose>),
    /// It was given; so many matches of so many agree with it.
    Given {
        /// Matches that agree.
        agreeing: usize,
        /// Matches that there were.
        matches: usize,
        /// Root mean square Sampson distance of those that agree, pixels.
        residual_px: f64,
    },
    /// From points of B and the pixels that they stand at.
    Points {
        /// Points that agree.
        agreeing: usize,
        /// Points that took part.
        points: usize,
        /// Root mean square reprojection error of those that agree, in a coordinate, pixels.
        residual_px: f64,
    },
    /// There is none: the prediction says why.
    Nothing,
}

/// A smaller share of matches that agree with a given pose is said.
const GOOD_SHARE: f64 = 0.5;

impl PoseSource {
    /// A given pose and the matches that it was checked with.
    pub(crate) fn given(judged: &[JudgedMatch]) -> Self {
        let squares = judged.iter().filter(|m| m.inlier).map(|m| m.residual_px.powi(2));
        let (agreeing, sum) = squares.fold((0, 0.0), |(count, sum), square| (count + 1, sum + square));
        Self::Given { agreeing, matches: judged.len(), residual_px: (sum / agreeing.max(1) as f64).sqrt() }
    }

    pub(crate) fn warning(&self) -> Option<Warning> {
        match *self {
            Self::Given { agreeing, matches, residual_px }
                if (agreeing as f64) < GOOD_SHARE * matches as f64
                    || residual_px > 0.5 * judge::GIVEN_TOLERANCE_PX =>
            {
                Some(Warning::PoseDisagrees { agreeing, matches, residual_px })
            }
            Self::Estimated(ref pose) => {
                let rival = pose.rival?;
                let direction = |pose: &Rigid3<CamB, CamA>| pose.origin().coords;
                let angle = direction(&rival).angle(&direction(&pose.cam_b_from_cam_a));
                Some(Warning::TwoMotions { apart_deg: angle.to_degrees() })
            }
            _ => None,
        }
    }
}

/// Whether the cameras' focal lengths are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FocalKnowledge {
    /// The views' cameras are what they say.
    #[default]
    Known,
    /// The views' cameras hold a guess: it is replaced where the matches, or a network's points, tell better.
    Guessed,
}

/// Where the focal lengths come from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase", tag = "source")]
pub enum FocalSource {
    /// From the cameras that were given.
    Known,
    /// From the matches.
    Estimated {
        /// Pixels.
        focal_px: f64,
        /// Its standard deviation, pixels.
        sigma_px: f64,
    },
    /// From the network's points, each view's in its own frame.
    Pointmaps {
        /// Of A and of B, pixels.
        focal_px: [f64; 2],
    },
    /// From what the camera has written into the pictures.
    Exif {
        /// Of A and of B, pixels across.
        focal_px: [f64; 2],
    },
    /// Nothing determines it: it is an assumption.
    Assumed {
        /// Pixels.
        focal_px: f64,
        /// The field of view that was assumed, across the width of picture A.
        fov_deg: f64,
    },
}

impl FocalSource {
    /// What must be said of it.
    pub fn warning(self) -> Option<Warning> {
        match self {
            Self::Known => None,
            Self::Pointmaps { focal_px: [a, b] } => Some(Warning::FocalFromPoints { a_px: a, b_px: b }),
            Self::Exif { focal_px: [a, b] } => Some(Warning::FocalFromExif { a_px: a, b_px: b }),
            Self::Estimated { focal_px, sigma_px } => Some(Warning::FocalEstimated { focal_px, sigma_px }),
            Self::Assumed { focal_px, fov_deg } => Some(Warning::FocalAssumed { focal_px, fov_deg }),
        }
    }
}

/// What must be said about an answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Warning {
    /// No size is known.
    #[error("metric: false; nothing says how large this is, so lengths are in units of the baseline")]
    NotMetric,
    /// No size is known, and there is no baseline.
    #[error("metric: false; nothing says how large this is, so lengths are in the network's own unit")]
    NetworkUnit,
    /// The focal length was estimated.
    #[error(
        "no camera was given: the focal length was estimated from the matches, {focal_px:.1} ± {sigma_px:.2} px"
    )]
    FocalEstimated {
        /// Pixels.
        focal_px: f64,
        /// Its standard deviation, pixels.
        sigma_px: f64,
    },
    /// The focal length was taken from the network's points.
    #[error(
        "no camera was given: the focal lengths are those that the network's points imply, {a_px:.1} and {b_px:.1} px"
    )]
    FocalFromPoints {
        /// Of A, pixels.
        a_px: f64,
        /// Of B, pixels.
        b_px: f64,
    },
    /// The focal length was taken from the pictures' EXIF.
    #[error(
        "no camera was given: the focal lengths are those that EXIF tells, {a_px:.1} and {b_px:.1} px, of an ideal lens with its axis in the \
         middle"
    )]
    FocalFromExif {
        /// Of A, pixels.
        a_px: f64,
        /// Of B, pixels.
        b_px: f64,
    },
    /// The focal length was assumed.
    #[error(
        "no camera was given and nothing determines one: a field of view of {fov_deg:.1}° ({focal_px:.1} px) was assumed; \
         angles, slopes and heights are only as right as this is"
    )]
    FocalAssumed {
        /// Pixels.
        focal_px: f64,
        /// Across the width of picture A.
        fov_deg: f64,
    },
    /// The given pose and the pictures do not agree well.
    #[error(
        "the relative pose that was given and the pictures do not agree well: {agreeing} of {matches} matches lie within {tolerance_px} px of \
         their epipolar lines, {residual_px:.2} px (rms) beside them; points are shifted by as much",
        tolerance_px = judge::GIVEN_TOLERANCE_PX
    )]
    PoseDisagrees {
        /// Matches that agree.
        agreeing: usize,
        /// Matches that there were.
        matches: usize,
        /// Root mean square Sampson distance of those that agree, pixels.
        residual_px: f64,
    },
    /// Nearly flat ground allows two motions.
    #[error(
        "the ground is so flat that another motion, its direction {apart_deg:.0}° away, explains the matches as well: pose and relief may be wrong"
    )]
    TwoMotions {
        /// Angle between the two directions, degrees.
        apart_deg: f64,
    },
    /// The matches gave no pose, the points did.
    #[error("the matches tell no pose ({why}): it was taken from the network's points")]
    PoseFromPoints {
        /// Why they do not.
        why: String,
    },
    /// No pose was asked for.
    #[error("no pose was asked for: the points are the network's alone, and nothing checks them")]
    NoPose,
    /// The network's points and its matches disagree about ranges.
    #[error(
        "the network's points and the points in which its matches meet disagree: their ranges differ by {percent:.0} % (sigma) beside a common \
         factor",
        percent = 100.0 * spread
    )]
    PointsDisagree {
        /// Sigma of the ratio of ranges, as a share of it.
        spread: f64,
    },
    /// Shading was asked for, and a Sun is not known.
    #[error("the Sun of picture {picture} is not known: shading was left out")]
    NoSun {
        /// `A` or `B`.
        picture: &'static str,
    },
    /// A Sun stands below the ground that it should light.
    #[error(
        "the Sun of picture {picture} stands {below:.1}° below the ground's plane and cannot light it: shading was left out; is it of this \
         picture?",
        below = -elevation_deg
    )]
    SunBelow {
        /// `A` or `B`.
        picture: &'static str,
        /// Over the plane of the ground, degrees.
        elevation_deg: f64,
    },
    /// The surface from shading and the matches disagree.
    #[error(
        "the surface that explains the pictures by their shading puts the matches {misfit_px:.2} px (median) from where they are, their own \
         errors are {noise_px:.2} px: shading was left out; are both Suns those of these pictures, and is the ground the same?"
    )]
    MatchesContradict {
        /// Along the epipolar lines, pixels.
        misfit_px: f64,
        /// Across them or before shading, pixels.
        noise_px: f64,
    },
    /// A picture shows little ground that is neither dark nor saturated.
    #[error(
        "only {percent:.0} % of picture {picture} is neither dark nor saturated: shading rests on little there",
        percent = 100.0 * share
    )]
    LittleLit {
        /// `A` or `B`.
        picture: &'static str,
        /// Of its pixels.
        share: f64,
    },
    /// Shading explains the pictures by much albedo.
    #[error(
        "shading explains the pictures by an albedo that varies by {percent:.0} % (sigma): where the ground is more even, the Suns, the law or \
         the ground itself are not what they are said to be, and slopes are wrong",
        percent = 100.0 * spread
    )]
    MuchAlbedo {
        /// Standard deviation of the log albedo.
        spread: f64,
    },
    /// What shading makes of the pictures does not look like them.
    #[error(
        "a surface that explains the pictures by their shading was not found: its rendering and picture {picture} correlate by {correlation:.2} \
         only; shading was left out"
    )]
    NotExplained {
        /// `A` or `B`.
        picture: &'static str,
        /// Of the model's picture and the picture.
        correlation: f64,
    },
    /// Shading has no surface to start from.
    #[error("shading was left out: {why}")]
    NoShading {
        /// Why.
        why: String,
    },
    /// Two sources of size tell different things.
    #[error("the size from `{other}` is {ratio:.3} times that from `{used}`, which was used")]
    ScalesDisagree {
        /// The one that was used.
        used: &'static str,
        /// The other one.
        other: &'static str,
        /// Its size over that which was used.
        ratio: f64,
    },
}
