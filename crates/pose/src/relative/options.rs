//! How a relative pose is estimated.

/// How far the estimate is polished.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refinement {
    /// The best minimal model by its number of inliers: plain RANSAC, as OpenCV's `findEssentialMat` gives it. Weak on nearly planar scenes; for
    /// comparison.
    None,
    /// Local optimisation in the search and one refinement over all inliers.
    Local,
    /// The same from several starts (the motions of the dominant plane, the rotation with the best direction), the best by its cost over
    /// all matches.
    #[default]
    Full,
}

/// In which order matches are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// All alike.
    Random,
    /// From the best scores first, where the scores differ.
    #[default]
    Prosac,
}

/// How to estimate a relative pose.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RelativeOptions {
    /// Largest Sampson distance of an inlier, on the plane `z = 1` (pixels divided by the focal length).
    pub threshold: f64,
    /// What matches are off by at least, however well they agree, on the plane `z = 1`: below it interpolation decides, or the
    /// raster of whole pixels, whose errors are alike in neighbouring matches and would pass as parallax.
    pub least_noise: f64,
    /// Matches that are one piece of evidence, being decided together: 1 for features, more for the smooth matches of a network, of
    /// which whole patches agree with a wrong motion by chance.
    pub per_evidence: f64,
    /// Seed of the samples.
    pub seed: u64,
    /// Probability with which no better sample was missed.
    pub confidence: f64,
    /// Samples after which the search ends.
    pub max_iterations: usize,
    /// How far the estimate is polished.
    pub refinement: Refinement,
    /// In which order matches are drawn.
    pub order: Order,
}

impl Default for RelativeOptions {
    /// One pixel, and a tenth for the noise, at the focal length of a 512-pixel picture of 45°.
    fn default() -> Self {
        Self {
            threshold: 1.0 / 618.0,
            least_noise: 0.1 / 618.0,
            per_evidence: 1.0,
            seed: 0,
            confidence: 0.9999,
            max_iterations: 10_000,
            refinement: Refinement::Full,
            order: Order::Prosac,
        }
    }
}
