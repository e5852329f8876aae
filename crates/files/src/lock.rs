//! A place is written by one process at a time. The lock is the system's own on an open file: it dies with its process.

use crate::names::is_at;
use crate::{Error, leftovers};
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// A lock that is held until this goes.
#[derive(Debug)]
pub(crate) struct Lock {
    path: PathBuf,
    /// `None` where the file system knows no locks: then nothing is held.
    file: Option<File>,
}

impl Lock {
    /// Takes the lock file `path` for the writing of `target`, beside others or alone.
    ///
    /// # Errors
    /// [`Error::InUse`], [`Error::Io`] if the lock file cannot be made.
    pub(crate) fn take(path: PathBuf, target: &Path, command: &str, shared: bool) -> Result<Self, Error> {
        loop {
            let mut open = File::options();
            let mut file = open
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(Error::io("write", target))?;
            match if shared { file.try_lock_shared() } else { file.try_lock() } {
                Ok(()) if !is_at(&file, &path) => {}
                Ok(()) => {
                    // Who it is helps those who wait; without it the lock is as good.
                    let _ =
                        file.set_len(0).and_then(|()| write!(file, "{command}\n{}\n", std::process::id()));
                    leftovers::note(&path);
                    return Ok(Self { path, file: Some(file) });
                }
                Err(TryLockError::Error(_)) => {
                    let _ = std::fs::remove_file(&path);
                    return Ok(Self { path, file: None });
                }
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::InUse { path: target.to_owned(), by: holder(&path) });
                }
            }
        }
    }

    /// Lets others share it.
    pub(crate) fn share(&self) {
        // Where even this is refused it stays as it is: held alone.
        let _ = self.file.as_ref().map(File::try_lock_shared);
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // The last of those who share it clears it away.
        if self.file.as_ref().is_some_and(|file| file.try_lock().is_ok()) {
            let _ = std::fs::remove_file(&self.path);
        }
        leftovers::forget(&self.path);
    }
}

fn holder(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    match text.split_once('\n') {
        Some((command, process)) => format!("`selenograph {command}` (process {})", process.trim_end()),
        None => "another process".to_owned(),
    }
}
