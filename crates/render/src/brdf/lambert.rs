//! Lambert's law: equally bright from every side.

use super::lanes::Lanes;

/// Radiance factor of a white Lambert surface: `μ0`.
///
/// # Source
/// Lambert 1760, "Photometria"; in this form Hapke 2012, "Theory of Reflectance and Emittance Spectroscopy",
/// eq. 8.13.
#[inline(always)]
pub fn radiance_factor(mu0: f64) -> f64 {
    mu0
}

/// The same in lanes.
#[inline(always)]
pub(crate) fn radiance_factor_fast<L: Lanes>(mu0: L) -> L {
    mu0
}
