//! A file that is whole or not there.

use crate::{Error, leftovers};
use std::ffi::OsString;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const PARTIAL: &str = ".partial";
const REPLACED: &str = ".replaced";
pub(crate) const LOCK: &str = ".lock";

fn beside(target: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(ending);
    target.with_file_name(name)
}

/// Where a file or folder is while it is made.
pub(crate) fn partial_of(target: &Path) -> PathBuf {
    beside(target, PARTIAL)
}

/// Where a folder is while another takes its place.
pub(crate) fn replaced_of(target: &Path) -> PathBuf {
    beside(target, REPLACED)
}

pub(crate) fn lock_of(target: &Path) -> PathBuf {
    beside(target, LOCK)
}

/// Whether a name is one of those that are given here to what is not finished.
pub(crate) fn is_own_name(name: &str) -> bool {
    name.starts_with('.') && [PARTIAL, REPLACED, LOCK].iter().any(|ending| name.ends_with(ending))
}

/// What a draft of this name is to become.
pub(crate) fn draft_name(name: &str) -> Option<&str> {
    name.strip_prefix('.')?.strip_suffix(PARTIAL)
}

/// Removes a file, a link, or a folder with all that is in it; there may be none.
pub(crate) fn remove(path: &Path) -> std::io::Result<()> {
    let is_folder = match path.symlink_metadata() {
        Ok(found) => found.is_dir(),
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
    };
    if is_folder { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }
}

/// Writes a file in one go: whoever looks sees the old one or the new one, whole.
///
/// # Errors
/// [`Error::Full`], [`Error::Io`]; the old one is then still there.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Error> {
    let mut draft = FileDraft::new(path)?;
    draft.write_all(bytes.as_ref()).map_err(Error::io("write", path))?;
    draft.commit()
}

/// A file in the making, beside its place. Dropped, it leaves nothing.
#[derive(Debug)]
pub struct FileDraft {
    target: PathBuf,
    partial: PathBuf,
    file: File,
    committed: bool,
}

impl FileDraft {
    /// Begins one. Where another process is writing the same file, waits for its end: the last one stays.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Io`].
    pub fn new(target: &Path) -> Result<Self, Error> {
        let partial = partial_of(target);
        let refused = |error| Error::io("write", target)(error);
        loop {
            let mut open = File::options();
            let file =
                open.read(true).write(true).create(true).truncate(false).open(&partial).map_err(refused)?;
            // Where the file system knows no locks, a file is as safe as one process makes it.
            let _ = file.lock();
            if crate::lock::is_at(&file, &partial) {
                file.set_len(0).map_err(refused)?;
                leftovers::note(&partial);
                return Ok(Self { target: target.to_owned(), partial, file, committed: false });
            }
        }
    }

    /// What is to be written, at last and for certain, is on the disk.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Io`].
    pub fn sync(&self) -> Result<(), Error> {
        self.file.sync_all().map_err(Error::io("write", &self.target))
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Io`].
    pub fn commit(mut self) -> Result<(), Error> {
        std::fs::rename(&self.partial, &self.target).map_err(Error::io("write", &self.target))?;
        self.committed = true;
        Ok(())
    }
}

impl Write for FileDraft {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Read for FileDraft {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        self.file.read(bytes)
    }
}

impl Seek for FileDraft {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for FileDraft {
    fn drop(&mut self) {
        if !self.committed {
            // On a full disk this gives the room back; the error that is told is the first.
            let _ = std::fs::remove_file(&self.partial);
        }
        leftovers::forget(&self.partial);
    }
}
