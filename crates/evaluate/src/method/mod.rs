//! The methods that can be evaluated: the one place where a further one is added.

mod item;
pub mod network;
mod pictures;
mod plane;
mod truth;

use crate::Error;
use crate::pair_metrics::Promise;
use selenograph_reconstruct::pipeline;
use serde::{Deserialize, Serialize};

pub use item::{Answer, Item, Lighting, Pose};

/// What is evaluated. To add a method: a variant of [`pipeline::Method`] and its words in `Method::words`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(into = "&'static str", try_from = "String")]
pub enum Method {
    /// A way of `reconstruct`: what it says of an item is what the command would write.
    Pictures(pipeline::Method),
    /// The truth itself: what a perfect answer scores.
    Truth,
    /// A plane fitted to the truth: the lower anchor.
    Plane,
}

impl From<Method> for &'static str {
    fn from(method: Method) -> Self {
        method.as_str()
    }
}

impl TryFrom<String> for Method {
    type Error = Error;

    fn try_from(name: String) -> Result<Self, Error> {
        Self::from_name(&name)
    }
}

/// What a method does.
struct Words {
    promise: Promise,
    settings: &'static str,
}

impl Method {
    /// All of them, in the order of the tables.
    pub fn all() -> impl Iterator<Item = Self> {
        let of_pictures = pipeline::Method::ALL.into_iter().map(Self::Pictures);
        of_pictures.chain([Self::Truth, Self::Plane])
    }

    fn words(self) -> Words {
        use pipeline::Method::{Fused, Mast3r, Mast3rStereo, Orb, Sift, Stereo};
        let (promise, settings) = match self {
            Self::Pictures(Orb) => (
                Promise::Pose,
                "ORB as OpenCV has it (5000 features, 8 levels of scale 1.2, FAST 20), Hamming neighbours with cross-check, five-point RANSAC (1 px, confidence 0.9999), nothing refined; the paper states no settings",
            ),
            Self::Pictures(Sift) => (
                Promise::Pose,
                "root-SIFT, mutual neighbours with ratio test, LO-RANSAC (1 px), windows aligned to subpixels, Sampson refinement over all inliers",
            ),
            Self::Pictures(Stereo) => (
                Promise::Points,
                "the pose of `sift`, then inverse depth of every pixel of both views under a thin plate, completed where nothing matches; its unit is the baseline",
            ),
            Self::Pictures(Mast3r) => {
                (Promise::Points, "a network of the MASt3R family: points, and the pose of its matches")
            }
            Self::Pictures(Mast3rStereo) => (
                Promise::Points,
                "the matches of the same network in place of SIFT's, then as `stereo`: robust pose, windows aligned to subpixels, depth of every pixel; its unit is the baseline",
            ),
            Self::Pictures(Fused) => (
                Promise::Points,
                "the pose of `sift`, or of the network's matches where the lights differ and that tells none, then one surface whose renderings equal both pictures, the Suns given; its unit is the baseline",
            ),
            Self::Truth => (
                Promise::MetricPoints,
                "the stored truth as the answer: perfect where the definition allows it, the floor where it does not",
            ),
            Self::Plane => (
                Promise::MetricPoints,
                "the true pose, and a plane fitted to the true points of both views in place of the terrain: the lower anchor",
            ),
        };
        Words { promise, settings }
    }

    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Pictures(method) => method.as_str(),
            Self::Truth => "truth",
            Self::Plane => "plane",
        }
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
        matches!(self, Self::Pictures(_))
    }

    /// From its name.
    ///
    /// # Errors
    /// [`Error::UnknownMethod`], with the nearest name.
    pub fn from_name(name: &str) -> Result<Self, Error> {
        let typed = name.trim().to_ascii_lowercase();
        if let Some(method) = Self::all().find(|method| method.as_str() == typed) {
            return Ok(method);
        }
        let known: Vec<&str> = Self::all().map(Self::as_str).collect();
        let nearest = known
            .iter()
            .copied()
            .map(|other| (strsim::levenshtein(&typed, other), other))
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
        Ok(match self {
            Self::Pictures(method) => pictures::answer(method, self.promise(), item)?,
            Self::Truth => Answer { prediction: truth::prediction(item.truth), reference_pose: None },
            Self::Plane => Answer { prediction: plane::prediction(item.truth), reference_pose: None },
        })
    }

    /// Whether it needs a network: always, or where the lights of an item differ.
    pub fn needs_network(self) -> bool {
        matches!(self, Self::Pictures(method) if method.needs_network() || method == pipeline::Method::Fused)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_near_misses_told() {
        for method in Method::all() {
            assert_eq!(Method::from_name(method.as_str()).unwrap(), method);
        }
        let hint = |name: &str| Method::from_name(name).unwrap_err().hint().unwrap();
        assert_eq!(hint("plain"), "did you mean `plane`?");
        assert!(hint("colmap").contains("--help"));
    }
}
