//! The one place that writes: files and folders that are whole or not there, nothing of the user's lost, what was run put on record;
//! and the one door for files that are read.
//!
//! | what | for |
//! | --- | --- |
//! | [`write()`], [`FileDraft`] | a file: written beside its place, renamed into it |
//! | [`FolderDraft`] | a folder that appears when it is complete |
//! | [`HeldFolder`] | a folder that is filled bit by bit, and gone on with after a kill |
//! | [`FileTarget`] | the file that a command is asked for |
//! | [`FileKind`], [`FolderKind`] | how a command knows its own work again, before it replaces it |
//! | [`record`] | `run.toml` |
//! | [`checksum`] | BLAKE3 of files |
//! | [`regular`] | files that are read: no folder, pipe or device |
//!
//! What is unfinished is called `.NAME.partial` beside its place, the folder that a finished one takes the place of `.NAME.replaced`, and a
//! lock `.NAME.lock` (`.lock` inside a [`HeldFolder`]). The names are always the same, so that the next run finds what a killed one
//! has left: it clears the first, puts the second back where its place is empty, and takes over the third, which no living process
//! holds. Random names, as of `tempfile`, would pile up.
#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, reason = "tests may stop"))]

pub mod checksum;
mod draft;
mod error;
mod kind;
mod leftovers;
mod lock;
mod names;
pub mod record;
pub mod regular;
mod target;

pub use draft::{FileDraft, write};
pub use error::Error;
pub use kind::{FileKind, FolderKind};
pub use leftovers::abandon;
pub use target::{FileTarget, FolderDraft, HeldFolder, Sharing, clear_drafts, is_occupied};

/// What to do with a target that is there already, and is not an empty folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Existing {
    /// Leave it and fail.
    #[default]
    Refuse,
    /// Go on with what an earlier run of the same began; where a thing is made at once, as [`Existing::Refuse`].
    Resume,
    /// Replace what this command has written, and nothing else.
    Replace,
}

#[cfg(test)]
mod tests;
