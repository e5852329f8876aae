//! Hapke's first lunar law: closed form, no roughness; the law of the StereoLunar pictures.

use super::lanes::{DECAY_END, Lanes, asin_of_sqrt, decay};
use super::{ParameterError, Slopes};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Share of the forward-scattering term in the particles' phase function: Hapke's classic value.
const FORWARD: f64 = 0.1;

/// Lommel-Seeliger scattering with the Schönberg-Hapke phase function, the 1963 opposition effect, and Hapke's 1981
/// multiple scattering.
///
/// With `g` the phase angle and `γ = √(1 − w)`:
/// `P = (4π/5) [(sin g + (π − g) cos g)/π + (1 − cos g)²/10]`, `H(x) = (1 + 2x)/(1 + 2γx)`,
/// `B = B0 [1 − (tan g / 2h)(3 − e^(−h/tan g))(1 − e^(−h/tan g))]` below 90°, 0 above,
/// `I/F = (w/4) μ0/(μ0 + μ) [(1 + B) P + H(μ0) H(μ) − 1]`.
/// The defaults are what was measured on the StereoLunar samples.
///
/// # Source
/// Hapke 1963, "A theoretical photometric function for the lunar surface", JGR 68, 4571;
/// Hapke 1981, "Bidirectional reflectance spectroscopy 1", JGR 86, 3039.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hapke1963 {
    /// Single-scattering albedo, in `[0, 1]`.
    pub w: f64,
    /// Angular width of the opposition effect (compaction), > 0.
    pub h: f64,
    /// Amplitude of the opposition effect, ≥ 0; above 1 it is not clamped.
    pub b0: f64,
}

impl Default for Hapke1963 {
    fn default() -> Self {
        Self { w: 0.12, h: 0.12, b0: 1.0 }
    }
}

impl Hapke1963 {
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        let law = "hapke1963";
        ParameterError::within(law, "w", self.w, 0.0, 1.0)?;
        ParameterError::within(law, "h", self.h, 1e-4, 10.0)?;
        ParameterError::within(law, "b0", self.b0, 0.0, 100.0)
    }

    fn opposition(&self, g: f64) -> f64 {
        let tan_g = g.tan();
        if g >= PI / 2.0 {
            return 0.0;
        }
        if tan_g == 0.0 {
            return self.b0;
        }
        // 1 − e^−u through expm1, so that nothing cancels where u is small.
        let gap = -(-self.h / tan_g).exp_m1();
        self.b0 * (1.0 - tan_g / (2.0 * self.h) * (2.0 + gap) * gap)
    }

    /// `(1 + B) P`.
    pub(super) fn phase_part(&self, cos_phase: f64) -> f64 {
        let g = cos_phase.acos();
        let schoenberg = (g.sin() + (PI - g) * cos_phase) / PI;
        let p = 0.8 * PI * (schoenberg + FORWARD * (1.0 - cos_phase).powi(2));
        (1.0 + self.opposition(g)) * p
    }

    /// `phase_part` is `(1 + B) P`.
    #[inline(always)]
    pub(super) fn slopes(&self, mu0: f64, mu: f64, phase_part: f64) -> Slopes {
        let two_gamma = 2.0 * (1.0 - self.w).sqrt();
        // H and its derivative `2 (1 − γ) / (1 + 2γx)²`.
        let h_of = |x: f64| {
            let inverse = 1.0 / (1.0 + two_gamma * x);
            ((1.0 + 2.0 * x) * inverse, (2.0 - two_gamma) * inverse * inverse)
        };
        let ((h0, h0_slope), (h, h_slope)) = (h_of(mu0), h_of(mu));
        let bracket = phase_part + h0 * h - 1.0;
        let inverse = 1.0 / (mu0 + mu);
        let scale = 0.25 * self.w * inverse;
        Slopes {
            value: scale * mu0 * bracket,
            by_mu0: scale * (mu * inverse * bracket + mu0 * h0_slope * h),
            by_mu: scale * mu0 * (h0 * h_slope - inverse * bracket),
            by_phase_part: scale * mu0,
        }
    }

    pub(super) fn prepared(&self) -> Prepared {
        Prepared {
            quarter_w: (0.25 * self.w) as f32,
            two_gamma: (2.0 * (1.0 - self.w).sqrt()) as f32,
            h: self.h as f32,
            b0: self.b0 as f32,
        }
    }
}

/// [`Hapke1963`] with what depends on its parameters alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prepared {
    quarter_w: f32,
    two_gamma: f32,
    h: f32,
    b0: f32,
}

impl Prepared {
    /// About 90 operations, of which 2 square roots and 2 divisions.
    #[inline(always)]
    pub(super) fn radiance_factor<L: Lanes>(&self, mu0: L, mu: L, sin_sq_half_phase: L) -> L {
        let s = L::splat;
        let x = sin_sq_half_phase;
        let one = s(1.0);
        let (sin_half, cos_half) = (x.sqrt(), (one - x).sqrt());
        let half_phase = asin_of_sqrt(x, sin_half, cos_half);
        let half_sin = sin_half * cos_half;
        let cos = one - (x + x);
        // P, with (1 − cos g)² / 10 = 0.4 x².
        let p = s(1.6) * (half_sin + (s(std::f32::consts::FRAC_PI_2) - half_phase) * cos)
            + s((0.8 * PI * 4.0 * FORWARD) as f32) * (x * x);
        // u = h / tan g; where it is large, e^−u = 0 and its inverse is what is needed: one division for both.
        let num = s(self.h) * cos.max(s(0.0));
        let den = half_sin + half_sin;
        let large = s(DECAY_END) * den;
        let quotient =
            L::select_lt(large, num, den, num) / L::select_lt(large, num, num, den).max(s(f32::MIN_POSITIVE));
        let (gap, ratio) = decay(L::select_lt(large, num, s(DECAY_END), quotient));
        let ratio = L::select_lt(large, num, quotient, ratio);
        let surge = s(self.b0) * (one - s(0.5) * ratio * (s(2.0) + gap));
        let single = (one + surge) * p - one;
        // The three denominators of μ0/(μ0 + μ) and the two H in one division.
        let (two_mu0, two_mu) = (mu0 + mu0, mu + mu);
        let num_h = (one + two_mu0) * (one + two_mu);
        let den_h = (one + s(self.two_gamma) * mu0) * (one + s(self.two_gamma) * mu);
        s(self.quarter_w) * mu0 * (single * den_h + num_h) / (den_h * (mu0 + mu))
    }
}
