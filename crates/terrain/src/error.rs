//! What can go wrong with terrain.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A grid too small to carry a surface, or whose georeference cannot be inverted.
    #[error("terrain grid: expected {expected}, found {found}")]
    Grid {
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
    /// A grid without a single height.
    #[error("terrain `{name}` has no height at all ({cells} nodes, all absent)")]
    AllAbsent {
        /// File or layer.
        name: String,
        /// Number of nodes looked at.
        cells: usize,
    },
}
