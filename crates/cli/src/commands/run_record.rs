//! `run.toml` of commands that write a folder at once.

use super::clock::now_utc;
use selenograph_files::record::{RUN_NAME, RunRecord};
use selenograph_files::{Error, checksum, write};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Writes the record of a command into its folder, with the checksums of what was read; returns its text.
///
/// # Errors
/// A file that cannot be read, or one that cannot be written.
pub fn write_record(
    folder: &Path,
    command: &'static str,
    read: &[PathBuf],
    settings: &impl Serialize,
    outcome: Option<&impl Serialize>,
) -> Result<String, Error> {
    let now = now_utc();
    let mut record = RunRecord::new(command, settings);
    record.started = Some(&now);
    record.threads = Some(rayon::current_num_threads());
    record.inputs = checksum::of_files(read)?;
    record.outcome = outcome;
    let text = record.to_toml()?;
    write(&folder.join(RUN_NAME), &text)?;
    Ok(text)
}

/// Where a command has nothing to say of what came of it.
pub const NO_OUTCOME: Option<&()> = None;
