//! The names of what is not finished, beside what it is to become.

use std::ffi::OsString;
use std::fs::File;
use std::io::ErrorKind;
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

/// Whether an open file is still the one of that name: another process may have renamed or removed it before the lock was got.
#[cfg(unix)]
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |found: std::fs::Metadata| (found.dev(), found.ino());
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(held), Ok(named)) => place(held) == place(named),
        _ => false,
    }
}

/// Elsewhere an open file keeps its name.
#[cfg(not(unix))]
pub(crate) fn is_at(_file: &File, _path: &Path) -> bool {
    true
}
