//! What can go wrong with a campaign, a plan or a dataset folder.

use std::path::{Path, PathBuf};

/// The crate's errors; each names the file or key and what was expected of it.
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
    /// A pair or view without depth or pose.
    #[error("`{}`: expected {expected}, found none", path.display())]
    NoTruth {
        /// The file, or the name of the view.
        path: PathBuf,
        /// What it should have.
        expected: &'static str,
    },
    /// A file of a pair that is not the one its record was written for.
    #[error("`{}`: its checksum is not the one in pair.json ({num_bytes} bytes): changed or truncated", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// Bytes in it.
        num_bytes: usize,
    },
    /// A campaign that cannot be read (TOML syntax, unknown key, wrong type).
    #[error("campaign: {what}")]
    Campaign {
        /// The parser's message, with the line.
        what: String,
        /// The known key nearest to one that is not known.
        nearest: Option<String>,
    },
    /// A setting outside its range.
    #[error("campaign key `{key}`: expected {expected}, found {found}")]
    Value {
        /// Dotted key.
        key: String,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// Two settings that exclude each other.
    #[error("campaign keys `{first}` and `{second}` contradict each other: {why}")]
    Contradiction {
        /// One dotted key.
        first: String,
        /// The other.
        second: String,
        /// Why they cannot both hold.
        why: String,
    },
    /// No preset of that name.
    #[error("no preset `{name}`; there are: {known}")]
    UnknownPreset {
        /// What was asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A shard that does not exist.
    #[error("shard {shard} of {num_shards}: shards are numbered from 0, below their count")]
    Shard {
        /// Which was asked for.
        shard: u64,
        /// How many there are.
        num_shards: u64,
    },
    /// The output folder belongs to another campaign or plan.
    #[error("`{}` was made by another {what} (its checksum is {found}, this one's {expected})", path.display())]
    OtherCampaign {
        /// The file that differs.
        path: PathBuf,
        /// What differs: `campaign`, `plan`, `terrain`.
        what: &'static str,
        /// Checksum of what was asked for.
        expected: String,
        /// Checksum of what is there.
        found: String,
    },
    /// A pair that cannot be used.
    #[error("{what} cannot be used: {why}")]
    Unusable {
        /// Which pair, or which folder of pairs.
        what: String,
        /// What is wrong with it.
        why: String,
    },
    /// A frame or camera that does not exist.
    #[error(transparent)]
    Geometry(#[from] selenograph_geometry::Error),
    /// A view that cannot be rendered.
    #[error(transparent)]
    Render(#[from] selenograph_render::Error),
    /// A picture or array that cannot be read or written.
    #[error(transparent)]
    Raster(#[from] selenograph_raster::Error),
}

impl Error {
    /// A file that is not what its name says.
    pub(crate) fn unexpected(path: &Path, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Format { path: path.to_owned(), expected: expected.into(), found: found.into() }
    }

    /// Wraps a file-system error with the file it happened at.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { action, path, source }
    }
}
