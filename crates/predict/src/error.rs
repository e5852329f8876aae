//! What can go wrong between a checkpoint and a prediction.

use std::path::PathBuf;

/// The crate's errors.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A checkpoint without heads that give points.
    #[error("`{}` is a {family} network: it gives no points", path.display())]
    NoPoints {
        /// The checkpoint.
        path: PathBuf,
        /// Its family.
        family: &'static str,
    },
    /// Matches are asked for of a network that gives none.
    #[error("`{}` is a {family} network without descriptors: it does not match, so that nothing can be triangulated", path.display())]
    NoDescriptors {
        /// The checkpoint.
        path: PathBuf,
        /// Its family.
        family: &'static str,
    },
    /// The checkpoint, or a picture that cannot be made into an input.
    #[error(transparent)]
    Network(#[from] selenograph_network::Error),
    /// The executor.
    #[error(transparent)]
    Engine(#[from] selenograph_engine::Error),
    /// A device that this build cannot use.
    #[error("this build has no device `{name}` for networks")]
    Device {
        /// What was asked for.
        name: String,
    },
    /// burn.
    #[cfg(feature = "burn")]
    #[error(transparent)]
    Model(#[from] selenograph_model::Error),
    /// What a device computed does not come back.
    #[cfg(feature = "burn")]
    #[error("the device does not give its results back: {said}")]
    Reading {
        /// What it said.
        said: String,
    },
}

impl Error {
    /// What the user can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::NoPoints { .. } => {
                Some("networks of the DUSt3R family give points, those of the MASt3R family match as well")
            }
            Self::NoDescriptors { .. } => {
                Some("it gives points and a pose from them; take a MASt3R network to match")
            }
            Self::Network(error) => error.hint(),
            Self::Engine(error) => error.hint(),
            Self::Device { .. } => Some(
                "pass --device cpu, or leave it out; graphics cards need a build with `--features cuda` or `--features wgpu`",
            ),
            #[cfg(feature = "burn")]
            Self::Model(error) => error.hint(),
            #[cfg(feature = "burn")]
            Self::Reading { .. } => Some("`selenograph doctor` says what the device lacks"),
        }
    }
}
