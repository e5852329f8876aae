//! Nearest neighbours among descriptors.

/// The nearest neighbour of a feature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nearest {
    pub(super) idx: u32,
    /// Distance over the second nearest neighbour's.
    pub(super) ratio: f64,
}

/// Nearest neighbours from A to B with their ratios, and from B to A.
pub(super) struct Neighbours {
    pub(super) of_a: Vec<Nearest>,
    pub(super) of_b: Vec<u32>,
}
