//! Lambert's law: equally bright from every side.

use super::Slopes;
use super::lanes::Lanes;

/// Radiance factor of a white Lambert surface: `μ0`.
///
/// # Source
/// Lambert 1760, "Photometria"; in this form Hapke 2012, "Theory of Reflectance and Emittance Spectroscopy",
/// eq. 8.13.
#[inline(always)]
pub(super) fn slopes(mu0: f64) -> Slopes {
    Slopes { value: mu0, by_mu0: 1.0, by_mu: 0.0, by_phase_part: 0.0 }
}

/// The same in lanes.
#[inline(always)]
pub(crate) fn radiance_factor_fast<L: Lanes>(mu0: L) -> L {
    mu0
}
