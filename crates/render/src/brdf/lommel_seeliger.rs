//! The Lommel-Seeliger law: light scattered once by a dark medium of isotropic particles.

use super::lanes::Lanes;

/// Radiance factor at a single-scattering albedo of 1: `μ0 / (4 (μ0 + μ))`.
///
/// # Source
/// Seeliger 1884; in this form Hapke 2012, "Theory of Reflectance and Emittance Spectroscopy", eq. 8.27
/// (times π).
#[inline(always)]
pub fn radiance_factor(mu0: f64, mu: f64) -> f64 {
    0.25 * mu0 / (mu0 + mu)
}

/// The same in lanes.
#[inline(always)]
pub(crate) fn radiance_factor_fast<L: Lanes>(mu0: L, mu: L) -> L {
    L::splat(0.25) * mu0 / (mu0 + mu)
}
