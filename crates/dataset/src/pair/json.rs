//! Records as JSON text.

use crate::Error;
use selenograph_files::regular;
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

/// Version of the two records; a reader refuses a newer one.
pub const RECORD_VERSION: u32 = 1;

/// Reads a JSON record.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if it is not the record asked for.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    parse_json(&regular::read(path, regular::MAX_TEXT_BYTES).map_err(Error::io("read", path))?, path)
}

/// A JSON record out of a file's bytes.
pub(crate) fn parse_json<T: DeserializeOwned>(bytes: &[u8], path: &Path) -> Result<T, Error> {
    serde_json::from_slice(bytes)
        .map_err(|error| Error::unexpected(path, "a JSON record of this version", error.to_string()))
}

/// Text of a JSON record, as it is written.
///
/// # Errors
/// [`Error::Format`] for a number that JSON cannot hold (NaN, infinity).
pub fn json_text<T: Serialize>(record: &T, path: &Path) -> Result<String, Error> {
    let text = serde_json::to_string_pretty(record).map_err(|error| Error::Format {
        path: path.to_path_buf(),
        expected: "finite numbers".into(),
        found: error.to_string(),
    })?;
    Ok(text + "\n")
}
