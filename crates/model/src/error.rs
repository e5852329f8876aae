//! What can go wrong before or while the network runs.

/// Why a tensor could not be delivered, in the words of whoever reads the weights.
pub type SourceError = Box<dyn std::error::Error + Send + Sync>;

/// What can go wrong before or while the network runs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Dimensions that no network has.
    #[error(transparent)]
    Network(#[from] selenograph_network::Error),
    /// The weights' source does not deliver a tensor.
    #[error("cannot read the tensor `{name}`: {source}")]
    Weights {
        /// Name in the checkpoint.
        name: String,
        /// What the source said.
        source: SourceError,
    },
    /// A tensor has another shape than the configuration asks for.
    #[error("tensor `{name}` has shape {found:?}, the configuration asks for {expected:?}")]
    TensorShape {
        /// Name in the checkpoint.
        name: String,
        /// Shape by the configuration.
        expected: Vec<usize>,
        /// Shape that was given.
        found: Vec<usize>,
    },
    /// A tensor's shape and its number of values disagree.
    #[error("tensor `{name}` of shape {shape:?} comes with {found} values")]
    TensorLength {
        /// Name in the checkpoint.
        name: String,
        /// Its shape.
        shape: Vec<usize>,
        /// Values delivered.
        found: usize,
    },
    /// Views that the network cannot take, alone or together.
    #[error("views: {what} is {found}, expected {expected}")]
    Views {
        /// Which property.
        what: &'static str,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
    /// No device is called that.
    #[error("`{found}` is not a device; there are `cpu`, `cuda:N`, `wgpu:N`")]
    DeviceName {
        /// What was typed.
        found: String,
    },
    /// The device is not there, or something that it needs is not.
    #[error("device `{device}` cannot be used: {missing}")]
    DeviceAbsent {
        /// Its name.
        device: String,
        /// What is missing.
        missing: String,
    },
    /// The device could not compute.
    #[error("device `{device}`: {message}")]
    Device {
        /// Its name.
        device: String,
        /// What its driver said.
        message: String,
    },
}

impl Error {
    /// What the user can do about it, if anything is known.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Network(error) => error.hint(),
            Self::Weights { .. } => Some("`weights info` lists what a checkpoint holds and what is missing"),
            Self::TensorShape { .. } | Self::TensorLength { .. } => {
                Some("the configuration belongs to another checkpoint; `weights info` prints the right one")
            }
            Self::Views { .. } => None,
            Self::DeviceName { .. } => Some("N counts from 0"),
            Self::DeviceAbsent { .. } | Self::Device { .. } => {
                Some("`doctor` lists the devices; `--device cpu` always works")
            }
        }
    }

    pub(crate) fn views(
        what: &'static str,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        Self::Views { what, expected: expected.to_string(), found: found.to_string() }
    }
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
