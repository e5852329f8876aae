//! Minnaert's law: one exponent for limb darkening, obeying reciprocity.

use super::lanes::{Lanes, POWER_BITS, power};
use super::{ParameterError, Slopes};
use serde::{Deserialize, Serialize};

/// Minnaert's law `μ0^k μ^(k−1)`: `k = 1` is Lambert's, `k = 0.5` is near the full Moon. It grows without bound
/// towards the limb where `k < 1`.
///
/// # Source
/// Minnaert 1941, "The reciprocity principle in lunar photometry", Astrophys. J. 93, 403.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Minnaert {
    /// The exponent, in `[0, 2]`.
    pub k: f64,
}

impl Minnaert {
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        ParameterError::within("minnaert", "k", self.k, 0.0, 2.0)
    }

    pub(super) fn slopes(&self, mu0: f64, mu: f64) -> Slopes {
        let value = (mu0 * mu).powf(self.k) / mu;
        Slopes { value, by_mu0: self.k * value / mu0, by_mu: (self.k - 1.0) * value / mu, by_phase_part: 0.0 }
    }

    pub(super) fn prepared(&self) -> Prepared {
        Prepared { bits: (self.k * f64::from(1u32 << POWER_BITS)).round() as u32 }
    }
}

/// [`Minnaert`] with its exponent in binary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prepared {
    bits: u32,
}

impl Prepared {
    #[inline(always)]
    pub(super) fn radiance_factor<L: Lanes>(&self, mu0: L, mu: L) -> L {
        power(mu0 * mu, self.bits) / mu
    }
}
