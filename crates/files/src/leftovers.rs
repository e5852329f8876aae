//! What this process has begun and not finished, for the end that comes from outside: a signal runs no destructors.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Oldest first.
static BEGUN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Tries of a removal: other threads may still write into a folder that goes.
const TRIES: usize = 3;

fn begun<T>(work: impl FnOnce(&mut Vec<PathBuf>) -> T) -> T {
    work(&mut BEGUN.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Notes a draft, a lock, or a folder made for one.
pub(crate) fn note(path: &Path) {
    begun(|paths| paths.push(path.to_owned()));
}

/// It is finished, or gone.
pub(crate) fn forget(path: &Path) {
    begun(|paths| {
        if let Some(idx) = paths.iter().rposition(|noted| noted == path) {
            paths.remove(idx);
        }
    });
}

/// Removes drafts and locks of this process, and the folders made for them as far as they are empty. To be called before a process
/// ends by a signal; what it does not get at is cleared by the next run.
pub fn abandon() {
    for path in begun(std::mem::take).iter().rev() {
        let is_draft =
            path.file_name().is_some_and(|name| crate::names::is_own_name(&name.to_string_lossy()));
        let gone = || if is_draft { crate::names::remove(path) } else { std::fs::remove_dir(path) };
        let _ = (0..TRIES).any(|_| gone().is_ok());
    }
}
