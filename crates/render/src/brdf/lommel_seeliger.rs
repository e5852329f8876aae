//! The Lommel-Seeliger law: light scattered once by a dark medium of isotropic particles.

use super::Slopes;
use super::lanes::Lanes;

/// Radiance factor at a single-scattering albedo of 1: `μ0 / (4 (μ0 + μ))`.
///
/// # Source
/// Seeliger 1884; in this form Hapke 2012, "Theory of Reflectance and Emittance Spectroscopy", eq. 8.27
/// (times π).
#[inline(always)]
pub(super) fn slopes(mu0: f64, mu: f64) -> Slopes {
    let inverse = 1.0 / (mu0 + mu);
    let quarter = 0.25 * inverse;
    let (by_mu0, by_mu) = (mu * inverse * quarter, -mu0 * inverse * quarter);
    Slopes { value: mu0 * quarter, by_mu0, by_mu, by_phase_part: 0.0 }
}

/// The same in lanes.
#[inline(always)]
pub(crate) fn radiance_factor_fast<L: Lanes>(mu0: L, mu: L) -> L {
    L::splat(0.25) * mu0 / (mu0 + mu)
}
