//! BLAKE3 checksums, in records as 64 hexadecimal digits.

use crate::{Error, regular};
pub use blake3::{Hash as Checksum, Hasher};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Of bytes in memory.
pub fn of_bytes(bytes: &[u8]) -> Checksum {
    blake3::hash(bytes)
}

/// Of all that is still to be read, in pieces.
///
/// # Errors
/// Those of the reader.
pub fn of_reader(reader: impl Read) -> std::io::Result<Checksum> {
    let mut hasher = Hasher::new();
    hasher.update_reader(reader)?;
    Ok(hasher.finalize())
}

/// Of a regular file, read in pieces.
///
/// # Errors
/// [`Error::Io`].
pub fn of_file(path: &Path) -> Result<Checksum, Error> {
    regular::open(path).and_then(|(file, _)| of_reader(file)).map_err(Error::io("read", path))
}

/// Of files, by the path that they were named with.
///
/// # Errors
/// [`Error::Io`].
pub fn of_files(paths: &[PathBuf]) -> Result<BTreeMap<String, String>, Error> {
    paths.iter().map(|path| Ok((path.display().to_string(), of_file(path)?.to_string()))).collect()
}
