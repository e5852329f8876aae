//! Places that commands are asked to write to, and what is kept of a command that does not come to its end.

use crate::args::Target;
use selenograph_files::{
    Error, Existing, FileKind, FileTarget, FolderDraft, FolderKind, HeldFolder, Sharing,
};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// What stays of a command that ends before its end.
enum Kept {
    /// Nothing: its result appears when it is complete.
    Nothing(PathBuf),
    /// All that is complete, and a command that goes on.
    Complete(PathBuf, String),
}

/// Of the command of this process. The first that is said holds: the steps of a longer command are parts of it.
static KEPT: OnceLock<Kept> = OnceLock::new();

/// What is kept, in words; `None` for a command that writes nothing, or has not begun to.
pub fn kept() -> Option<String> {
    Some(match KEPT.get()? {
        Kept::Nothing(target) => format!("nothing was written to `{}`", target.display()),
        Kept::Complete(folder, _) => format!("what is complete in `{}` is kept", folder.display()),
    })
}

/// What is said of an end from outside.
pub fn stopped() -> String {
    match (kept(), KEPT.get()) {
        (Some(kept), Some(Kept::Complete(_, again))) => format!("stopped: {kept}; {again} goes on"),
        (Some(kept), _) => format!("stopped: {kept}"),
        (None, _) => "stopped".to_owned(),
    }
}

fn say_nothing_is_kept(target: &Path) {
    KEPT.get_or_init(|| Kept::Nothing(target.to_owned()));
}

/// Says that what is complete in a folder stays, and which command goes on with it.
pub fn say_complete_is_kept(folder: &Path, again: impl Into<String>) {
    KEPT.get_or_init(|| Kept::Complete(folder.to_owned(), again.into()));
}

/// The usual one.
pub const SAME_COMMAND: &str = "the same command";

impl Target {
    /// What to do with what is there, for things that are made at once.
    fn existing(&self) -> Existing {
        if self.force { Existing::Replace } else { Existing::Refuse }
    }

    /// Takes the place of a file.
    ///
    /// # Errors
    /// Those of [`FileTarget::claim`].
    pub fn file(&self, kind: &FileKind) -> Result<FileTarget, Error> {
        let target = FileTarget::claim(&self.out, kind, self.existing())?;
        say_nothing_is_kept(&self.out);
        Ok(target)
    }

    /// Begins a folder that appears when it is complete.
    ///
    /// # Errors
    /// Those of [`FolderDraft::claim`].
    pub fn folder(&self, kind: &'static FolderKind) -> Result<FolderDraft, Error> {
        let draft = FolderDraft::claim(&self.out, kind, self.existing())?;
        say_nothing_is_kept(&self.out);
        Ok(draft)
    }

    /// Takes a folder that is filled bit by bit: goes on with what is there, or with `--force` begins anew.
    ///
    /// # Errors
    /// Those of [`HeldFolder::take`].
    pub fn held(&self, kind: &'static FolderKind) -> Result<HeldFolder, Error> {
        let existing = if self.force { Existing::Replace } else { Existing::Resume };
        let folder = HeldFolder::take(&self.out, kind, existing, Sharing::Alone)?;
        say_complete_is_kept(&self.out, SAME_COMMAND);
        Ok(folder)
    }
}
