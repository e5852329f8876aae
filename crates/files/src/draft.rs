//! A file that is whole or not there.

use crate::names::{is_at, partial_of};
use crate::{Error, leftovers};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

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
            if is_at(&file, &partial) {
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
