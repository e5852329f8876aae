//! What can go wrong before or while the network runs.

/// Why a tensor could not be delivered, in the words of whoever reads the weights.
pub type SourceError = Box<dyn std::error::Error + Send + Sync>;

/// What can go wrong before or while the network runs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
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
        /// Shape in the checkpoint.
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
    /// A configuration that fits no network.
    #[error("configuration: {what} is {found}, expected {expected}")]
    Config {
        /// Which entry.
        what: &'static str,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
    /// An image that cannot be cut into patches, or whose values do not fill it.
    #[error("image: {what} is {found}, expected {expected}")]
    Image {
        /// Which property.
        what: &'static str,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Two arrays that belong together do not fit, or an option is out of its range.
    #[error("matching: {what} is {found}, expected {expected}")]
    Matching {
        /// Which property.
        what: &'static str,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Instructions asked for that this processor does not have.
    #[error("this processor has no {level}")]
    SimdAbsent {
        /// The instruction set.
        level: &'static str,
    },
}

impl Error {
    /// What the user can do about it, if anything is known.
    #[must_use]
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Weights { .. } => Some("`weights info` lists what a checkpoint holds and what is missing"),
            Self::TensorShape { .. } | Self::TensorLength { .. } => {
                Some("the configuration belongs to another checkpoint; `weights info` prints the right one")
            }
            Self::Config { .. } => Some("start from a preset"),
            Self::Image { .. } => Some("resize or crop the image to multiples of the patch size"),
            Self::Matching { .. } => None,
            Self::SimdAbsent { .. } => Some("let the engine choose the instruction set"),
        }
    }
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
