//! The methods that can be evaluated: the one place where a further one is added.

pub mod learned;
mod pictures;
mod plane;
mod truth;

use crate::Error;
use crate::pair_metrics::Promise;
use crate::truth::TruthPair;
use learned::PointsOf;
use selenograph_geometry::{CamA, CamB, Rigid3};
use selenograph_pose::relative::CannotSay;
use selenograph_reconstruct::{Prediction, View};
use serde::{Deserialize, Serialize};

/// A method. To add one: a variant here, its words in `Method::words`, its work in [`Method::answer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The paper's baseline: ORB, pose only.
    Orb,
    /// SIFT, robust estimation, subpixel windows, refinement: pose only.
    Sift,
    /// The pose of `sift`, then dense stereo.
    Stereo,
    /// A network of the MASt3R family: points, and the pose of its matches.
    Mast3r,
    /// Matches of a network of the MASt3R family, windows aligned to subpixels, then dense stereo.
    #[serde(rename = "mast3r-stereo")]
    Mast3rStereo,
    /// The truth itself: what a perfect answer scores.
    Truth,
    /// A plane fitted to the truth: the lower anchor.
    Plane,
}

/// What a method is called and what it does.
struct Words {
    name: &'static str,
    promise: Promise,
    settings: &'static str,
}

/// What a method says of an item.
#[derive(Debug, Clone)]
pub struct Answer {
    /// On the full frames.
    pub prediction: Prediction,
    /// The relative pose by the reference protocol, for methods that estimate one.
    pub reference_pose: Option<Result<Rigid3<CamB, CamA>, CannotSay>>,
}

impl Method {
    /// All of them, in the order of the tables.
    pub const ALL: [Self; 7] =
        [Self::Orb, Self::Sift, Self::Stereo, Self::Mast3r, Self::Mast3rStereo, Self::Truth, Self::Plane];

    fn words(self) -> Words {
        match self {
            Self::Orb => Words {
                name: "orb",
                promise: Promise::Pose,
                settings: "ORB as OpenCV has it (5000 features, 8 levels of scale 1.2, FAST 20), Hamming neighbours with cross-check, five-point RANSAC (1 px, confidence 0.9999), nothing refined; the paper states no settings",
            },
            Self::Sift => Words {
                name: "sift",
                promise: Promise::Pose,
                settings: "root-SIFT, mutual neighbours with ratio test, LO-RANSAC (1 px), windows aligned to subpixels, Sampson refinement over all inliers",
            },
            Self::Stereo => Words {
                name: "stereo",
                promise: Promise::Points,
                settings: "the pose of `sift`, then inverse depth of every pixel of both views under a thin plate, completed where nothing matches; its unit is the baseline",
            },
            Self::Mast3r => Words {
                name: "mast3r",
                promise: Promise::Points,
                settings: "a network of the MASt3R family: points, and the pose of its matches",
            },
            Self::Mast3rStereo => Words {
                name: "mast3r-stereo",
                promise: Promise::Points,
                settings: "the matches of the same network in place of SIFT's, then as `stereo`: robust pose, windows aligned to subpixels, depth of every pixel; its unit is the baseline",
            },
            Self::Truth => Words {
                name: "truth",
                promise: Promise::MetricPoints,
                settings: "the stored truth as the answer: perfect where the definition allows it, the floor where it does not",
            },
            Self::Plane => Words {
                name: "plane",
                promise: Promise::MetricPoints,
                settings: "the true pose, and a plane fitted to the true points of both views in place of the terrain: the lower anchor",
            },
        }
    }

    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        self.words().name
    }

    /// What it does, with which settings, in one line; of a network its record tells more.
    pub fn settings(self) -> &'static str {
        self.words().settings
    }

    /// What it promises.
    pub fn promise(self) -> Promise {
        self.words().promise
    }

    /// Whether it looks at the pictures; if not, its answer is the same under every light.
    pub fn looks_at_pictures(self) -> bool {
        !matches!(self, Self::Truth | Self::Plane)
    }

    /// From its name.
    ///
    /// # Errors
    /// [`Error::UnknownMethod`], with the nearest name.
    pub fn from_name(name: &str) -> Result<Self, Error> {
        let typed = name.trim().to_ascii_lowercase();
        if let Some(method) = Self::ALL.into_iter().find(|method| method.as_str() == typed) {
            return Ok(method);
        }
        let known = Self::ALL.map(Self::as_str);
        let nearest = known
            .into_iter()
            .map(|other| (edit_distance(&typed, other), other))
            .min()
            .filter(|(distance, other)| *distance <= 2 && *distance < other.len());
        Err(Error::UnknownMethod {
            name: name.to_owned(),
            known: known.join(", "),
            nearest: nearest.map(|(_, other)| other),
        })
    }

    /// What it says of an item. Only the anchors look at the truth.
    ///
    /// # Errors
    /// [`Error::NoNetwork`] for a method that needs one where none is given; those of running it.
    pub fn answer(self, item: &Item<'_>) -> Result<Answer, Error> {
        let views = item.views;
        Ok(match self {
            Self::Orb => Answer {
                prediction: pictures::orb(views),
                reference_pose: Some(pictures::orb_reference(views)),
            },
            Self::Sift => Answer {
                prediction: pictures::sift(views),
                reference_pose: Some(pictures::sift_reference(views)),
            },
            Self::Stereo => Answer {
                prediction: pictures::stereo(views),
                reference_pose: Some(pictures::sift_reference(views)),
            },
            Self::Mast3r | Self::Mast3rStereo => {
                let points = if self == Self::Mast3r { PointsOf::Network } else { PointsOf::Stereo };
                item.network.ok_or(Error::NoNetwork)?.answer(views, item.lights, points)?
            }
            Self::Truth => Answer { prediction: truth::prediction(item.truth), reference_pose: None },
            Self::Plane => Answer { prediction: plane::prediction(item.truth), reference_pose: None },
        })
    }

    /// Whether it needs a network.
    pub fn needs_network(self) -> bool {
        matches!(self, Self::Mast3r | Self::Mast3rStereo)
    }
}

/// What a method is shown.
#[derive(Clone, Copy)]
pub struct Item<'a> {
    /// Both views.
    pub views: &'a [View; 2],
    /// The numbers of their lights: which pictures of the pair these are.
    pub lights: [u64; 2],
    /// The truth, for the anchors.
    pub truth: &'a TruthPair,
    /// The network at work on this pair.
    pub network: Option<&'a learned::Session<'a>>,
}

/// Insertions, deletions and replacements that turn one word into another (Levenshtein).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_near_misses_told() {
        for method in Method::ALL {
            assert_eq!(Method::from_name(method.as_str()).unwrap(), method);
        }
        let hint = |name: &str| Method::from_name(name).unwrap_err().hint().unwrap();
        assert_eq!(hint("plain"), "did you mean `plane`?");
        assert!(hint("colmap").contains("--help"));
        assert_eq!((edit_distance("kitten", "sitting"), edit_distance("", "abc")), (3, 3));
    }
}
