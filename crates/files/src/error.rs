//! What goes wrong in writing.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What a folder is that has no record of the command.
pub(crate) const FOLDER_OF_OTHERS: &str = "a folder of something else";

/// What goes wrong in writing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No room.
    #[error("the disk is full: cannot {action} `{}`: {source}", path.display())]
    Full {
        /// What was tried, for example `write`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// The file system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// What was tried, for example `write`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A path that ends in no name, such as `..`.
    #[error("`{}` is not a name to write to", path.display())]
    NoName {
        /// The path.
        path: PathBuf,
    },
    /// Something is there.
    #[error("`{}` exists", path.display())]
    Exists {
        /// The target.
        path: PathBuf,
    },
    /// Something is there that the command has not made.
    #[error("`{}` is {found}, not {expected}: it is left as it is", path.display())]
    OtherKind {
        /// The target.
        path: PathBuf,
        /// What the command writes.
        expected: &'static str,
        /// What is there.
        found: &'static str,
    },
    /// The command's own folder, with something in it that is not of the command's making.
    #[error("`{}` holds `{}`, which is no part of {expected}: it is left as it is", path.display(), foreign.display())]
    Foreign {
        /// The target.
        path: PathBuf,
        /// What the command writes.
        expected: &'static str,
        /// The first of the others, below the target.
        foreign: PathBuf,
    },
    /// Another process writes there.
    #[error("`{}` is in use by {by}", path.display())]
    InUse {
        /// The target.
        path: PathBuf,
        /// Command and process.
        by: String,
    },
    /// A file that should be a run record, and is something else.
    #[error("`{}` is no record of a run: {what}", path.display())]
    NoRecord {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A record with a value that TOML has no form for.
    #[error("record `{}`: {source}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// Which.
        source: toml::ser::Error,
    },
}

impl Error {
    /// Wraps an error of the system: `.map_err(Error::io("write", path))`.
    pub fn io<'a>(action: &'static str, path: &'a Path) -> impl FnOnce(std::io::Error) -> Self + 'a {
        move |source| {
            let path = path.to_owned();
            match source.kind() {
                ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Self::Full { action, path, source },
                _ => Self::Io { action, path, source },
            }
        }
    }

    /// What the user can do about it, where that is known without the system's reason.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::NoName { .. } => Some("pass another --out"),
            Self::Exists { .. } => Some("pass --force to overwrite it, or another --out"),
            Self::OtherKind { found: FOLDER_OF_OTHERS, .. } => Some(
                "--force replaces only a folder with this command's record (run.toml) in it; those of older releases may have none: \
                 remove it by hand if it may go, or pass another --out",
            ),
            Self::OtherKind { .. } => {
                Some("--force replaces only what this command has written: pass another --out")
            }
            Self::Foreign { .. } => Some(
                "--force replaces only what this command has written: move it elsewhere, or pass another --out",
            ),
            Self::InUse { .. } => Some("wait for its end, or pass another --out"),
            _ => None,
        }
    }
}
