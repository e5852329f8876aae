//! How to run an evaluation, and how far it is.

use crate::method::network::Network;
use selenograph_files::HeldFolder;

/// How to run.
pub struct RunOptions<'a> {
    /// The folder to write: an [`EVALUATION`](super::EVALUATION).
    pub out: &'a HeldFolder,
    /// When the run began, for the record.
    pub started: Option<String>,
    /// Told after every pair.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// Seconds since any fixed moment: libraries do not read the clock.
    pub clock: &'a (dyn Fn() -> f64 + Sync),
    /// The network of the method that needs one; its record is in the settings.
    pub network: Option<&'a Network>,
}

/// How far it is, in items of all methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Computed in this run or left out.
    pub num_done: usize,
    /// Found in the files.
    pub num_resumed: usize,
    /// All.
    pub num_items: usize,
}
