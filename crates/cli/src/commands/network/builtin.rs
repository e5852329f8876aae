//! The network that comes with the program.

use selenograph_files::checksum;
use selenograph_network::Checkpoint;
use selenograph_network::checkpoint::HeadCounts;
use std::path::Path;

/// What it is called where a file of weights is asked for.
pub const NAME: &str = "builtin";
/// The name it tells of itself.
const FULL_NAME: &str = "moon-hybrid (built in)";
/// What it is, where it comes from and what it can do: `weights/README.md`.
static WEIGHTS: &[u8] = include_bytes!("../../../../../weights/moon-hybrid.safetensors");

/// The checkpoint in a file; the network of the program for `builtin` and where none is named.
///
/// # Errors
/// A file that is no checkpoint.
pub fn open(path: Option<&Path>, heads: HeadCounts) -> anyhow::Result<Checkpoint> {
    match path {
        Some(path) if path != Path::new(NAME) => Ok(Checkpoint::open_with(path, heads)?),
        _ => Ok(Checkpoint::of_bytes(FULL_NAME, WEIGHTS)?),
    }
}

/// Whether a checkpoint is that of the program.
pub fn is(checkpoint: &Checkpoint) -> bool {
    checkpoint.path() == Path::new(FULL_NAME)
}

/// BLAKE3 of the file that a checkpoint was opened from.
///
/// # Errors
/// A file that cannot be read.
pub fn checksum(checkpoint: &Checkpoint) -> anyhow::Result<String> {
    if is(checkpoint) {
        return Ok(checksum::of_bytes(WEIGHTS).to_string());
    }
    Ok(checksum::of_file(checkpoint.path())?.to_string())
}
