//! Spreads that outliers do not move.

/// Standard deviations in a median absolute deviation of normally distributed values: `1 / Φ⁻¹(3/4)`, to the digits that the
/// literature gives.
///
/// # Source
/// Rousseeuw and Croux 1993, "Alternatives to the median absolute deviation" (b = 1.4826).
pub const MAD_TO_SIGMA: f64 = 1.4826;
