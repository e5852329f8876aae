//! Places to write to: refused if they exist, made beside the target, moved into place when complete, and gone without a
//! trace if the command fails.

use crate::exit::refuse;
use anyhow::Context;
use std::path::{Path, PathBuf};

/// A file or folder in the making.
#[derive(Debug)]
pub struct Draft {
    target: PathBuf,
    partial: PathBuf,
    made_folders: Vec<PathBuf>,
    committed: bool,
}

impl Draft {
    /// Checks the target and makes the folders above it.
    ///
    /// # Errors
    /// If the target exists and `force` is not given, or its folder cannot be written to.
    pub fn new(target: &Path, force: bool) -> anyhow::Result<Self> {
        let name = target.file_name().and_then(|name| name.to_str()).ok_or_else(|| {
            refuse(format!("`{}` is not a name to write to", target.display()), "pass another --out")
        })?;
        if !force && is_occupied(target) {
            return Err(refuse(
                format!("`{}` exists", target.display()),
                "pass --force to overwrite it, or another --out",
            ));
        }
        let parent = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let made_folders: Vec<PathBuf> =
            parent.ancestors().take_while(|folder| !folder.exists()).map(Path::to_owned).collect();
        let draft = Self {
            target: target.to_owned(),
            partial: parent.join(format!(".{name}.partial")),
            made_folders,
            committed: false,
        };
        std::fs::create_dir_all(parent)
            .with_context(|| format!("cannot make the folder `{}`", parent.display()))?;
        draft.probe(parent)?;
        Ok(draft)
    }

    /// Finds out now, not after an hour of work, whether the folder can be written to.
    fn probe(&self, parent: &Path) -> anyhow::Result<()> {
        remove(&self.partial);
        std::fs::write(&self.partial, b"")
            .with_context(|| format!("cannot write to `{}`", parent.display()))?;
        std::fs::remove_file(&self.partial).with_context(|| format!("cannot write to `{}`", parent.display()))
    }

    /// Where to write for now.
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Moves what was written into place.
    ///
    /// # Errors
    /// If the file system refuses; the old target is then still there.
    pub fn commit(mut self) -> anyhow::Result<()> {
        let old = self.partial.with_extension("replaced");
        let context = || format!("cannot move the result to `{}`", self.target.display());
        let replaces_folder = self.target.is_dir();
        if replaces_folder {
            std::fs::rename(&self.target, &old).with_context(context)?;
        }
        std::fs::rename(&self.partial, &self.target).with_context(context)?;
        if replaces_folder {
            remove(&old);
        }
        self.committed = true;
        Ok(())
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        if self.committed {
            return;
        }
        remove(&self.partial);
        for folder in &self.made_folders {
            // Only an empty folder goes; what others put there in the meantime stays.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// Whether there is something that a command would destroy: a file, or a folder that is not empty.
pub fn is_occupied(target: &Path) -> bool {
    match std::fs::read_dir(target) {
        Ok(mut entries) => entries.next().is_some(),
        Err(_) => target.symlink_metadata().is_ok(),
    }
}

/// Writes a small file in one go.
///
/// # Errors
/// As [`Draft::new`] and [`Draft::commit`].
pub fn write_file(target: &Path, force: bool, bytes: &[u8]) -> anyhow::Result<()> {
    let draft = Draft::new(target, force)?;
    std::fs::write(draft.path(), bytes).with_context(|| format!("cannot write `{}`", target.display()))?;
    draft.commit()
}

fn remove(path: &Path) {
    // Removing what is not there is what we want; anything else shows at the next write.
    let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
}

/// A folder that is being written; freed when this goes, also if the process is killed.
#[cfg(feature = "train")]
#[derive(Debug)]
pub struct Held {
    _folder: Option<std::fs::File>,
}

/// Takes a folder for this process. Where the file system knows no locks, nothing is held.
///
/// # Errors
/// If another process has it.
#[cfg(feature = "train")]
pub fn hold(folder: &Path) -> anyhow::Result<Held> {
    let Ok(file) = std::fs::File::open(folder) else { return Ok(Held { _folder: None }) };
    match file.try_lock() {
        Ok(()) => Ok(Held { _folder: Some(file) }),
        Err(std::fs::TryLockError::Error(_)) => Ok(Held { _folder: None }),
        Err(std::fs::TryLockError::WouldBlock) => Err(refuse(
            format!("another process is writing `{}`", folder.display()),
            "wait for its end, or stop it",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_draft_that_is_dropped_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("a/b/c.txt");
        let draft = Draft::new(&target, false).unwrap();
        std::fs::write(draft.path(), "half").unwrap();
        drop(draft);
        assert!(!is_occupied(dir.path()));
    }

    #[test]
    fn existing_targets_need_force_and_are_replaced_whole() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("out");
        std::fs::create_dir(&target).unwrap();
        std::fs::write(target.join("old"), "1").unwrap();
        assert!(Draft::new(&target, false).is_err());
        let draft = Draft::new(&target, true).unwrap();
        std::fs::create_dir(draft.path()).unwrap();
        std::fs::write(draft.path().join("new"), "2").unwrap();
        draft.commit().unwrap();
        assert!(target.join("new").exists() && !target.join("old").exists());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
