//! McEwen's lunar-Lambert law: a mixture of Lommel-Seeliger and Lambert whose share depends on the phase angle.

use super::lanes::{Lanes, asin_of_sqrt, polynomial};
use super::{ParameterError, Slopes};
use serde::{Deserialize, Serialize};

/// McEwen's cubic for the Moon, phase angle in degrees.
const MCEWEN_1996: [f64; 4] = [1.0, -0.019, 2.42e-4, -1.46e-6];

/// How the lunar (Lommel-Seeliger) share `L` follows the phase angle `g`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LunarShare {
    /// `1 − 0.019 g + 2.42e-4 g² − 1.46e-6 g³`, `g` in degrees, held inside `[0, 1]` (it is fitted to 0..120°).
    #[default]
    McEwen1996,
    /// The same at every phase angle, in `[0, 1]`.
    Constant(f64),
}

/// Radiance factor `2 L(g) μ0/(μ0 + μ) + (1 − L(g)) μ0`.
///
/// # Source
/// McEwen 1991, "Photometric functions for photoclinometry and other applications", Icarus 92, 298;
/// the cubic: McEwen 1996, "A precise lunar photometric function", LPSC XXVII, 841.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LunarLambert {
    /// The lunar share.
    pub share: LunarShare,
}

impl LunarLambert {
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        match self.share {
            LunarShare::McEwen1996 => Ok(()),
            LunarShare::Constant(l) => ParameterError::within("lunar-lambert", "share", l, 0.0, 1.0),
        }
    }

    /// The lunar share at a phase angle.
    pub(super) fn phase_part(&self, cos_phase: f64) -> f64 {
        match self.share {
            LunarShare::Constant(l) => l,
            LunarShare::McEwen1996 => {
                let g_deg = cos_phase.acos().to_degrees();
                let [a, b, c, d] = MCEWEN_1996;
                (a + g_deg * (b + g_deg * (c + g_deg * d))).clamp(0.0, 1.0)
            }
        }
    }

    #[inline(always)]
    pub(super) fn slopes(mu0: f64, mu: f64, l: f64) -> Slopes {
        let inverse = 1.0 / (mu0 + mu);
        let lunar = 2.0 * l * inverse;
        Slopes {
            value: lunar * mu0 + (1.0 - l) * mu0,
            by_mu0: lunar * mu * inverse + (1.0 - l),
            by_mu: -lunar * mu0 * inverse,
            by_phase_part: 2.0 * mu0 * inverse - mu0,
        }
    }

    pub(super) fn prepared(&self) -> Prepared {
        // The fast form's polynomial takes half the phase angle in radians.
        let unit = 2.0 * 180.0 / std::f64::consts::PI;
        match self.share {
            LunarShare::Constant(l) => Prepared { share: [l as f32, 0.0, 0.0, 0.0] },
            LunarShare::McEwen1996 => {
                Prepared { share: std::array::from_fn(|n| (MCEWEN_1996[n] * unit.powi(n as i32)) as f32) }
            }
        }
    }
}

/// [`LunarLambert`] with its share as a polynomial of half the phase angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prepared {
    share: [f32; 4],
}

impl Prepared {
    #[inline(always)]
    pub(super) fn radiance_factor<L: Lanes>(&self, mu0: L, mu: L, sin_sq_half_phase: L) -> L {
        let one = L::splat(1.0);
        let x = sin_sq_half_phase;
        let half_phase = asin_of_sqrt(x, x.sqrt(), (one - x).sqrt());
        let share = polynomial(half_phase, &self.share).min(one).max(L::splat(0.0));
        (share + share) * mu0 / (mu0 + mu) + (one - share) * mu0
    }
}
