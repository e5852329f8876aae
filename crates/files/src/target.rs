//! The places that commands are asked to write to.

use crate::lock::Lock;
use crate::names::{LOCK, draft_name, lock_of, partial_of, remove, replaced_of};
use crate::{Error, Existing, FileKind, FolderKind, leftovers, record};
use std::path::{Path, PathBuf};

/// Whether there is something at a path: a file, a link, or a folder with anything but our own leftovers in it.
pub fn is_occupied(target: &Path) -> bool {
    match std::fs::read_dir(target) {
        Ok(entries) => {
            entries.flatten().any(|e| !crate::names::is_own_name(&e.file_name().to_string_lossy()))
        }
        Err(_) => target.symlink_metadata().is_ok(),
    }
}

/// A target beside which is written: locked, what a killed run has left there put in order.
#[derive(Debug)]
struct Claim {
    /// Links followed.
    target: PathBuf,
    // In this order: the lock goes before the folders that were made for it.
    _lock: Lock,
    _made: MadeFolders,
}

impl Claim {
    fn new(target: &Path, command: &str) -> Result<Self, Error> {
        // What a link names is what is meant.
        let target = if target.is_symlink() {
            target.canonicalize().map_err(Error::io("follow the link", target))?
        } else {
            target.to_owned()
        };
        if target.file_name().is_none() {
            return Err(Error::NoName { path: target });
        }
        let parent = target.parent().filter(|path| !path.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let made = MadeFolders::make(parent)?;
        let lock = Lock::take(lock_of(&target), &target, command, false)?;
        let replaced = replaced_of(&target);
        if replaced.symlink_metadata().is_ok() {
            // Killed in the middle of a replacement: before the new one had its name, or after.
            if target.symlink_metadata().is_ok() {
                remove(&replaced).map_err(Error::io("remove", &replaced))?;
            } else {
                std::fs::rename(&replaced, &target).map_err(Error::io("restore", &target))?;
            }
        }
        let partial = partial_of(&target);
        remove(&partial).map_err(Error::io("remove", &partial))?;
        Ok(Self { target, _lock: lock, _made: made })
    }
}

/// Folders that were made for something to be in them; those that stay empty go.
#[derive(Debug)]
struct MadeFolders(Vec<PathBuf>);

impl MadeFolders {
    fn make(folder: &Path) -> Result<Self, Error> {
        let missing: Vec<PathBuf> = folder
            .ancestors()
            .take_while(|path| !path.as_os_str().is_empty() && !path.exists())
            .map(Path::to_owned)
            .collect();
        std::fs::create_dir_all(folder).map_err(Error::io("make the folder", folder))?;
        missing.iter().rev().for_each(|folder| leftovers::note(folder));
        Ok(Self(missing))
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for folder in &self.0 {
            // Only an empty folder goes; what others put there in the meantime stays.
            let _ = std::fs::remove_dir(folder);
            leftovers::forget(folder);
        }
    }
}

/// A file that a command is asked for: nobody else writes it, and what is there may be replaced.
#[derive(Debug)]
pub struct FileTarget {
    claim: Claim,
}

impl FileTarget {
    /// Takes the place, and finds out now, not after an hour of work, whether it can be written.
    ///
    /// # Errors
    /// [`Error::InUse`]; [`Error::Exists`]; [`Error::OtherKind`] for what is not to be replaced; [`Error::Io`].
    pub fn claim(target: &Path, kind: &FileKind, existing: Existing) -> Result<Self, Error> {
        let claim = Claim::new(target, kind.command)?;
        if claim.target.symlink_metadata().is_ok() {
            if existing != Existing::Replace {
                return Err(Error::Exists { path: target.to_owned() });
            }
            kind.check(&claim.target)?;
        }
        Ok(Self { claim })
    }

    /// Where to write, with [`crate::write`] or [`crate::FileDraft`].
    pub fn path(&self) -> &Path {
        &self.claim.target
    }
}

/// A folder in the making, beside its place. Dropped, it leaves nothing.
#[derive(Debug)]
pub struct FolderDraft {
    target: PathBuf,
    partial: PathBuf,
    /// What is replaced, and by whom; `None` for a folder among others of the same command.
    claimed: Option<(Claim, &'static FolderKind, Existing)>,
    committed: bool,
}

impl FolderDraft {
    /// Takes the place that a command is asked for, and begins a folder for it.
    ///
    /// # Errors
    /// [`Error::InUse`]; [`Error::Exists`]; [`Error::OtherKind`] and [`Error::Foreign`] for what is not to be replaced; [`Error::Io`].
    pub fn claim(target: &Path, kind: &'static FolderKind, existing: Existing) -> Result<Self, Error> {
        let claim = Claim::new(target, kind.command)?;
        check_folder(&claim.target, kind, existing)?;
        let mut draft = Self::beside(&claim.target)?;
        draft.claimed = Some((claim, kind, existing));
        Ok(draft)
    }

    /// Begins a folder of which nothing is there, in a place that is this process's already.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Io`].
    pub fn beside(target: &Path) -> Result<Self, Error> {
        let partial = partial_of(target);
        remove(&partial).map_err(Error::io("remove", &partial))?;
        std::fs::create_dir_all(&partial).map_err(Error::io("make the folder", &partial))?;
        leftovers::note(&partial);
        Ok(Self { target: target.to_owned(), partial, claimed: None, committed: false })
    }

    /// Where to write for now.
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Where it will be: what records tell.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Gives it its name. A folder that it replaces goes when the new one is in its place.
    ///
    /// # Errors
    /// Those of [`FolderDraft::claim`] for what came to the target in the meantime; the old folder is then still there.
    pub fn commit(mut self) -> Result<(), Error> {
        let moved = |source| Error::io("move the result to", &self.target)(source);
        let mut old = None;
        if let Some((_, kind, existing)) = &self.claimed {
            record::name_files(&self.partial, kind.parts)?;
            check_folder(&self.target, kind, *existing)?;
            if self.target.exists() {
                let replaced = replaced_of(&self.target);
                std::fs::rename(&self.target, &replaced).map_err(moved)?;
                old = Some(replaced);
            }
        }
        if let Err(source) = std::fs::rename(&self.partial, &self.target) {
            if let Some(old) = &old {
                // If even that fails, the next run puts it back; the first error is the one to tell.
                let _ = std::fs::rename(old, &self.target);
            }
            return Err(moved(source));
        }
        self.committed = true;
        match old {
            Some(old) => remove(&old).map_err(Error::io("remove", &old)),
            None => Ok(()),
        }
    }
}

impl Drop for FolderDraft {
    fn drop(&mut self) {
        if !self.committed {
            // On a full disk this gives the room back; the error that is told is the first.
            let _ = remove(&self.partial);
        }
        leftovers::forget(&self.partial);
    }
}

fn check_folder(target: &Path, kind: &FolderKind, existing: Existing) -> Result<(), Error> {
    match (is_occupied(target), existing) {
        (false, _) => Ok(()),
        (true, Existing::Replace) => kind.check_replaceable(target),
        (true, Existing::Refuse | Existing::Resume) => Err(Error::Exists { path: target.to_owned() }),
    }
}

/// Whether a folder may be written by several processes of the same command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharing {
    /// By one.
    Alone,
    /// By several, each a part of its own with this number.
    Part(u64),
}

/// A folder that is filled bit by bit: what is in it stays when the process ends, and a later run goes on.
#[derive(Debug)]
pub struct HeldFolder {
    path: PathBuf,
    kind: &'static FolderKind,
    replaces: bool,
    sharing: Sharing,
    _part: Option<Lock>,
    whole: Lock,
    _made: MadeFolders,
}

impl HeldFolder {
    /// Takes a folder, which is made if it is not there.
    ///
    /// # Errors
    /// [`Error::InUse`]; [`Error::Exists`], [`Error::OtherKind`] and [`Error::Foreign`] for what is in it and may not be gone on with or
    /// replaced; [`Error::Io`].
    pub fn take(
        path: &Path,
        kind: &'static FolderKind,
        existing: Existing,
        sharing: Sharing,
    ) -> Result<Self, Error> {
        if path.symlink_metadata().is_ok() && !path.is_dir() {
            return Err(match existing {
                Existing::Refuse => Error::Exists { path: path.to_owned() },
                _ => kind.check(path).err().unwrap_or(Error::Exists { path: path.to_owned() }),
            });
        }
        let made = MadeFolders::make(path)?;
        let part = match sharing {
            Sharing::Alone => None,
            Sharing::Part(number) => {
                Some(Lock::take(path.join(format!(".part-{number}.lock")), path, kind.command, false)?)
            }
        };
        // To replace a folder one has to be alone in it.
        let shared = part.is_some() && existing != Existing::Replace;
        let whole = Lock::take(path.join(".lock"), path, kind.command, shared)?;
        let occupied = is_occupied(path);
        match existing {
            Existing::Refuse if occupied => return Err(Error::Exists { path: path.to_owned() }),
            Existing::Resume if occupied => kind.check(path)?,
            Existing::Replace if occupied => kind.check_replaceable(path)?,
            _ => {}
        }
        let replaces = occupied && existing == Existing::Replace;
        Ok(Self { path: path.to_owned(), kind, replaces, sharing, _part: part, whole, _made: made })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Empties a folder that was taken to be replaced, when the work can begin; any other is left as it is.
    ///
    /// # Errors
    /// [`Error::Foreign`] for what came to it in the meantime; [`Error::Io`].
    pub fn begin(&self) -> Result<(), Error> {
        if self.replaces && is_occupied(&self.path) {
            self.kind.check_replaceable(&self.path)?;
            self.empty()?;
        }
        if self.sharing != Sharing::Alone {
            // It was taken alone to be emptied; from here on the others may come.
            self.whole.share();
        }
        Ok(())
    }

    fn empty(&self) -> Result<(), Error> {
        let entries = std::fs::read_dir(&self.path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let mut paths: Vec<PathBuf> =
            entries.map_err(Error::io("read", &self.path))?.iter().map(std::fs::DirEntry::path).collect();
        // Ours and, of a killed run, nobody's.
        paths.retain(|path| !path.to_string_lossy().ends_with(LOCK));
        // The records last: killed on the way, the folder is still known for what it is.
        paths.sort_by_key(|path| path.extension().is_some_and(|ending| ending == "toml"));
        paths.iter().try_for_each(|path| remove(path).map_err(Error::io("remove", path)))
    }
}

/// Clears what killed processes have left in a folder that this process holds, of the names (without the mark) that are said to be its own.
///
/// # Errors
/// [`Error::Io`].
pub fn clear_drafts(folder: &Path, is_own: impl Fn(&str) -> bool) -> Result<(), Error> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        entries => {
            entries.and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(Error::io("read", folder))?
        }
    };
    for entry in entries {
        if draft_name(&entry.file_name().to_string_lossy()).is_some_and(&is_own) {
            remove(&entry.path()).map_err(Error::io("remove", &entry.path()))?;
        }
    }
    Ok(())
}
