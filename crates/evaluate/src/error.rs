//! What can go wrong with an evaluation.

use std::path::{Path, PathBuf};

/// The crate's errors; each names what it happened at and what was expected.
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
    /// A folder without anything to evaluate.
    #[error("`{}` has no pairs to evaluate: {why}", path.display())]
    NoPairs {
        /// The folder.
        path: PathBuf,
        /// What was looked for, or which filter left nothing.
        why: String,
    },
    /// Pairs whose truth is missing: nothing can be measured.
    #[error("`{}` has no truth: {found}", path.display())]
    NoTruth {
        /// The folder.
        path: PathBuf,
        /// The first pair's defect.
        found: String,
    },
    /// No method of that name.
    #[error("no method `{name}`; there are: {known}")]
    UnknownMethod {
        /// What was asked for.
        name: String,
        /// The names there are.
        known: String,
        /// The nearest one, where one is near.
        nearest: Option<&'static str>,
    },
    /// The output folder belongs to another evaluation, or to something else.
    #[error("`{}` holds {found}, not this evaluation", path.display())]
    OtherEvaluation {
        /// The folder.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// A method that needs a network, and none.
    #[error("the method `mast3r` needs a network")]
    NoNetwork,
    /// A setting of the methods that there is not, or of another type.
    #[error("setting `{key}`: {what}")]
    Setting {
        /// What was to be set.
        key: String,
        /// What is wrong.
        what: String,
        /// The nearest key, where one is near.
        nearest: Option<String>,
    },
    /// A network that cannot look at a picture.
    #[error(transparent)]
    Predict(#[from] selenograph_predict::Error),
    /// Arrays of a network that do not fit.
    #[error(transparent)]
    Reconstruct(#[from] selenograph_reconstruct::Error),
    /// A dataset that cannot be read.
    #[error(transparent)]
    Dataset(#[from] selenograph_dataset::Error),
    /// A picture or array that cannot be read or written.
    #[error(transparent)]
    Raster(#[from] selenograph_raster::Error),
    /// A page that cannot be put together.
    #[error(transparent)]
    Report(#[from] selenograph_report::Error),
    /// A frame or camera that does not exist.
    #[error(transparent)]
    Geometry(#[from] selenograph_geometry::Error),
}

impl Error {
    /// Wraps a file-system error with the file it happened at.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { action, path, source }
    }

    /// Whether it says that the depth of a pair is not there: the file that should hold it, or every pixel in it.
    pub(crate) fn lacks_truth(&self) -> bool {
        use selenograph_dataset::Error as Dataset;
        use selenograph_raster::Error as Raster;
        match self {
            Self::Dataset(Dataset::NoTruth { .. }) => true,
            Self::Dataset(
                Dataset::Raster(Raster::Io { path, source, .. }) | Dataset::Io { path, source, .. },
            )
            | Self::Raster(Raster::Io { path, source, .. }) => {
                source.kind() == std::io::ErrorKind::NotFound && path.extension().is_some_and(|e| e == "exr")
            }
            _ => false,
        }
    }

    /// What the user can do about it, where that is not what the wrapped error's own hint says.
    pub fn hint(&self) -> Option<String> {
        Some(match self {
            Self::NoPairs { .. } => {
                "a dataset has `pairs/…`, triplets are `im_NNNNN.jpg/.exr/.npz` here or below; \
                 --pairs, --trajectory and --limit leave pairs out"
                    .into()
            }
            Self::NoTruth { .. } => {
                "an evaluation compares with depth and poses; `selenograph reconstruct` works without them"
                    .into()
            }
            Self::UnknownMethod { nearest: Some(nearest), .. } => format!("did you mean `{nearest}`?"),
            Self::UnknownMethod { .. } => "`selenograph evaluate --help` tells what each method does".into(),
            Self::Setting { nearest: Some(nearest), .. } => format!("did you mean `{nearest}`?"),
            Self::Setting { .. } => {
                "settings are those under `settings.pipeline` in the run.toml of a reconstruction: for example shading.estimate_weights=false"
                    .into()
            }
            Self::NoNetwork => "pass --weights FILE".into(),
            Self::OtherEvaluation { .. } => {
                "pass another --out, or --force to start this evaluation anew".into()
            }
            Self::Format { .. } => {
                "pass --force to start anew; docs/formats.md tells what each file holds".into()
            }
            _ => return None,
        })
    }
}
