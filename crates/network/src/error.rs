//! What can go wrong with a network's description, checkpoint or input.

use std::path::{Path, PathBuf};

/// What can go wrong with a network's description, checkpoint or input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// `open`, `read`, `write` …
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file or folder that cannot be written.
    #[error(transparent)]
    Files(#[from] selenograph_files::Error),
    /// Another kind of file.
    #[error("`{}` is not a checkpoint read here: expected {expected}, found {found}", path.display())]
    NotACheckpoint {
        /// The file.
        path: PathBuf,
        /// The formats read.
        expected: &'static str,
        /// What the file looks like.
        found: String,
    },
    /// The file ends before its data does.
    #[error("`{}` is truncated: {what} needs {expected} bytes, the file has {found}", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Which part is cut off.
        what: String,
        /// Bytes needed.
        expected: u64,
        /// Bytes there.
        found: u64,
    },
    /// The file contradicts its format.
    #[error("`{}` is corrupt: {what}: expected {expected}, found {found}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Which part.
        what: String,
        /// What the format asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The file asks for something that is done for no file, such as running code.
    #[error("`{}` is refused: {what} `{found}`; only {allowed}", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// For example `its pickle calls`.
        what: &'static str,
        /// What it asks for.
        found: String,
        /// What is allowed.
        allowed: &'static str,
    },
    /// No tensor of that name.
    #[error("`{}` has no tensor `{name}`", path.display())]
    MissingTensor {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
    },
    /// The tensors are not those of the network.
    #[error("`{}` does not fit its network: {what}", path.display())]
    Misfit {
        /// The file.
        path: PathBuf,
        /// Which tensors are missing or have another shape, and how many more.
        what: String,
    },
    /// Neither the model string nor the shapes say it.
    #[error("`{}` does not say {what}", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// For example `how many heads the encoder has`.
        what: String,
    },
    /// A model string of another network, or one that cannot be read.
    #[error("model string: {what}: expected {expected}, found `{found}`")]
    ModelString {
        /// For example `argument head_type`.
        what: String,
        /// What is understood.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Dimensions that no network has.
    #[error("network: {what}: expected {expected}, found {found}")]
    Config {
        /// Which part.
        what: &'static str,
        /// What a network has.
        expected: &'static str,
        /// What is there.
        found: usize,
    },
    /// No preset of that name.
    #[error("`{name}` is not a preset; there are {}", crate::Preset::ALL.map(crate::Preset::name).join(", "))]
    UnknownPreset {
        /// What was typed.
        name: String,
    },
    /// A picture that cannot be made into an input.
    #[error("picture of {width}×{height}: expected {expected}")]
    Picture {
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
        /// What is needed.
        expected: String,
    },
    /// A camera that does not belong to the picture.
    #[error(transparent)]
    Geometry(#[from] selenograph_geometry::Error),
}

impl Error {
    /// What the user can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::NotACheckpoint { .. } => Some(
                "a checkpoint is what `torch.save` of PyTorch 1.6 or later writes, or a .safetensors file",
            ),
            Self::Truncated { .. } | Self::Malformed { .. } => {
                Some("fetch the file again and compare its size")
            }
            Self::Refused { .. } => Some(
                "nothing in it was run; who made it can save the tensors alone, as `torch.save` of a state dict or as safetensors",
            ),
            Self::MissingTensor { .. } | Self::Misfit { .. } => {
                Some("`selenograph weights info` lists what is missing, left over or of another shape")
            }
            Self::Unknown { .. } => Some("give it: --encoder-heads N --decoder-heads N"),
            Self::ModelString { .. } => Some(
                "networks of the MASt3R, DUSt3R and CroCo families are read, with DPT heads and rotary positions",
            ),
            Self::UnknownPreset { .. } => {
                Some("mast3r-vitl is the published network, tiny is for trying out")
            }
            Self::Picture { .. } => Some("resize the picture, or let its border be padded"),
            _ => None,
        }
    }

    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    pub(crate) fn malformed(
        path: &Path,
        what: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            what: what.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
