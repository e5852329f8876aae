//! What views, trajectories and the files of a pair are called.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Which view of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ViewName {
    /// The first.
    A,
    /// The second.
    B,
}

impl ViewName {
    /// Both, in order.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];

    /// `a` or `b`, as file names begin.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::A => "a",
            Self::B => "b",
        }
    }
}

/// How a pair was flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trajectory {
    /// Both cameras look down from one altitude.
    Nadir,
    /// Level horizon, tilted from the vertical.
    Oblique,
    /// Independent altitude, offset, tilt and roll of the two cameras.
    Dynamic,
    /// One above the other: the epipole lies inside the picture.
    Descent,
    /// Hard case: low light on flat ground.
    LowLight,
    /// Hard case: the two views share no ground.
    NoOverlap,
    /// Hard case: the two views are the same.
    Identical,
}

impl Trajectory {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Nadir,
        Self::Oblique,
        Self::Dynamic,
        Self::Descent,
        Self::LowLight,
        Self::NoOverlap,
        Self::Identical,
    ];

    /// The name in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Nadir => "nadir",
            Self::Oblique => "oblique",
            Self::Dynamic => "dynamic",
            Self::Descent => "descent",
            Self::LowLight => "low-light",
            Self::NoOverlap => "no-overlap",
            Self::Identical => "identical",
        }
    }

    /// From the name in files.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.as_str() == name)
    }
}

/// Folder of a pair under a dataset's root: `pairs/<id / 1000>/<id>`.
pub fn pair_folder(root: &Path, pair_id: u64) -> PathBuf {
    root.join("pairs").join(format!("{:03}", pair_id / 1000)).join(format!("{pair_id:06}"))
}

/// `a.depth_z.exr`.
pub fn truth_name(view: ViewName) -> String {
    format!("{}.depth_z.exr", view.as_str())
}

/// `a.l0.png`.
pub fn image_name(view: ViewName, light_idx: usize) -> String {
    format!("{}.l{light_idx}.png", view.as_str())
}

/// `a.l0.lit.png`.
pub fn lit_name(view: ViewName, light_idx: usize) -> String {
    format!("{}.l{light_idx}.lit.png", view.as_str())
}

/// `a.in_b.exr`.
pub fn correspondence_name(view: ViewName) -> String {
    match view {
        ViewName::A => "a.in_b.exr".into(),
        ViewName::B => "b.in_a.exr".into(),
    }
}

/// `a.l0.angles.exr`.
pub fn angles_name(view: ViewName, light_idx: usize) -> String {
    format!("{}.l{light_idx}.angles.exr", view.as_str())
}

/// `a.camera.json`.
pub fn camera_name(view: ViewName) -> String {
    format!("{}.camera.json", view.as_str())
}

/// `pair.json`.
pub const PAIR_NAME: &str = "pair.json";
