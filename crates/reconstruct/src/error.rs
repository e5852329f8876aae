//! What can go wrong between two pictures and their products.

use crate::evidence::Warning;
use crate::{refine, stereo};
use selenograph_pose::relative::CannotSay;
use std::path::{Path, PathBuf};

/// The crate's errors; each says what was expected and what was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// What was tried, for example `write`.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file or folder that cannot be written.
    #[error(transparent)]
    Files(#[from] selenograph_files::Error),
    /// A file is not what its name says.
    #[error("`{}`: expected {expected}, found {found}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        expected: String,
        /// What it holds.
        found: String,
    },
    /// A camera for a picture of another size.
    #[error(
        "`{}` is a camera of {}×{}, the picture has {}×{}",
        path.display(), camera[0], camera[1], picture[0], picture[1]
    )]
    CameraSize {
        /// The camera's file.
        path: PathBuf,
        /// Columns and rows of the camera.
        camera: [usize; 2],
        /// Columns and rows of the picture.
        picture: [usize; 2],
        /// Whether the sides have the same proportion.
        in_proportion: bool,
    },
    /// A stream that stops inside a frame.
    #[error("`{}` ends inside a frame, after {num_whole} whole ones", path.display())]
    Truncated {
        /// The stream.
        path: PathBuf,
        /// Frames that were whole.
        num_whole: usize,
    },
    /// Cells of an elevation model with which the ground makes no map.
    #[error(
        "cell: expected a side between {least:.3} and {most:.3}, as the size of the ground allows, found {found}"
    )]
    Cell {
        /// What was asked for, in the grid's unit.
        found: f64,
        /// More cells than a map may have below it.
        least: f64,
        /// The shorter side of the ground.
        most: f64,
    },
    /// Rasters that belong together differ in size.
    #[error("{what}: expected {expected}, found {found}")]
    SizeMismatch {
        /// Which of them.
        what: &'static str,
        /// The size it should have.
        expected: String,
        /// Its size.
        found: String,
    },
    /// A setting outside its range.
    #[error("`{key}`: expected {expected}, found {found}")]
    Value {
        /// The setting.
        key: &'static str,
        /// What it should be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// Too few points for what is to be made of them.
    #[error("cannot say: too few points for {what}: {found}, at least {needed} are needed")]
    TooFewPoints {
        /// What is to be made.
        what: &'static str,
        /// Points needed.
        needed: usize,
        /// Points there are.
        found: usize,
    },
    /// The points do not determine what is asked of them.
    #[error("{what}: {why}")]
    Undetermined {
        /// What is asked.
        what: &'static str,
        /// Why the input cannot tell.
        why: String,
    },
    /// A method that rests on a network without what it says.
    #[error("`{method}` needs what a network says of the pictures, and nothing is given")]
    NoNetworkOutput {
        /// The method.
        method: &'static str,
    },
    /// The pictures do not tell a relative pose.
    #[error("cannot say: {0}")]
    CannotSay(#[from] CannotSay),
    /// Dense stereo has nothing to start from.
    #[error("cannot say: {0}")]
    Stereo(#[from] stereo::Error),
    /// Shading is to carry the answer, and does not.
    #[error("cannot say: {0}; and under two Suns stereo has nothing to compare")]
    NotShaded(Warning),
    /// Pictures do not sharpen an elevation model.
    #[error("cannot say: {0}")]
    Refine(#[from] refine::Error),
    /// A raster or its file.
    #[error(transparent)]
    Raster(#[from] selenograph_raster::Error),
    /// A camera, pose or projection.
    #[error(transparent)]
    Geometry(#[from] selenograph_geometry::Error),
}

impl Error {
    /// What the user can do about it, where that is known.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::TooFewPoints { .. } => {
                Some("the prediction is nearly empty: do the two pictures show the same ground?")
            }
            Self::CameraSize { in_proportion: true, .. } => Some(
                "if the picture was resized as a whole, give the camera of the resized picture, or say that it was",
            ),
            Self::CameraSize { .. } => Some(
                "give the camera of this picture: a crop moves the principal point, and cannot be guessed",
            ),
            Self::Cell { .. } => {
                Some("leave the side of a cell out: it then follows from the pixels on the ground")
            }
            Self::CannotSay(why) => Some(why.hint()),
            Self::Stereo(why) => Some(why.hint()),
            Self::NotShaded(_) => Some(
                "are the Suns those of these pictures? with shading left to `auto` the answer is what stereo finds all the same",
            ),
            Self::Refine(why) => Some(why.hint()),
            Self::Raster(e) => e.hint(),
            _ => None,
        }
    }

    /// For `map_err` on the results of file operations.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }
}
