//! How the surface reflects: one file and one citation per law.
//!
//! Every law is given as its *radiance factor* `I/F = π r`, with `r` the bidirectional reflectance (radiance over
//! the irradiance on a plane normal to the light). It already contains the cosine of incidence: nobody multiplies by
//! it again. Each exists twice: an `f64` reference, and a fast form in lanes that a test compares with it.

mod hapke;
mod hapke1963;
mod hapke_fast;
mod lambert;
mod lanes;
mod lommel_seeliger;
mod lunar_lambert;
mod minnaert;
mod parameter;

pub use hapke::{HFunction, Hapke, HapkeVersion};
pub use hapke1963::Hapke1963;
pub(crate) use lanes::Lanes;
pub use lunar_lambert::{LunarLambert, LunarShare};
pub use minnaert::Minnaert;
pub use parameter::ParameterError;
use serde::{Deserialize, Serialize};

/// A reflectance law with its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "law", rename_all = "kebab-case")]
pub enum Brdf {
    /// `A μ0`.
    Lambert,
    /// `(w/4) μ0/(μ0 + μ)`.
    LommelSeeliger,
    /// McEwen's mixture of the two above.
    LunarLambert(LunarLambert),
    /// `A μ0^k μ^(k−1)`.
    Minnaert(Minnaert),
    /// The law of the StereoLunar pictures.
    Hapke1963(Hapke1963),
    /// Hapke's model with opposition effects, roughness and porosity.
    Hapke(Hapke),
}

impl Default for Brdf {
    fn default() -> Self {
        Self::Hapke1963(Hapke1963::default())
    }
}

impl Brdf {
    /// Refuses parameters outside the range where the law means something.
    ///
    /// # Errors
    /// [`ParameterError`] names the law, the parameter and its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        match self {
            Self::Lambert | Self::LommelSeeliger => Ok(()),
            Self::LunarLambert(law) => law.validate(),
            Self::Minnaert(law) => law.validate(),
            Self::Hapke1963(law) => law.validate(),
            Self::Hapke(law) => law.validate(),
        }
    }

    /// Radiance factor `I/F`: the `f64` reference. 0 where `mu0 ≤ 0` or `mu ≤ 0`.
    ///
    /// # Shapes and units
    /// `mu0` = cos i, `mu` = cos e, `cos_phase` = cosine of the angle between the directions to the Sun and to the
    /// eye. `albedo_scale` multiplies the result: the albedo of the laws that have none of their own (Lambert,
    /// Lommel-Seeliger, lunar-Lambert, Minnaert), an albedo map's relative value for the others.
    pub fn radiance_factor(&self, mu0: f64, mu: f64, cos_phase: f64, albedo_scale: f64) -> f64 {
        // Also refuses NaN.
        if !(mu0 > 0.0 && mu > 0.0) {
            return 0.0;
        }
        let factor = match self {
            Self::Hapke(law) => law.radiance_factor(mu0, mu, cos_phase.clamp(-1.0, 1.0)),
            _ => self.slopes(mu0, mu, self.phase_part(cos_phase)).value,
        };
        albedo_scale * factor
    }

    /// What a law needs to know of the phase angle, as one number: for [`Self::slopes`]. It is smooth, so that a table of it
    /// serves a whole picture.
    pub fn phase_part(&self, cos_phase: f64) -> f64 {
        let cos_phase = cos_phase.clamp(-1.0, 1.0);
        match self {
            Self::Lambert | Self::LommelSeeliger | Self::Minnaert(_) => 0.0,
            Self::LunarLambert(law) => law.phase_part(cos_phase),
            Self::Hapke1963(law) => law.phase_part(cos_phase),
            Self::Hapke(_) => cos_phase,
        }
    }

    /// Radiance factor and how it changes with the angles.
    ///
    /// # Shapes and units
    /// `mu0` and `mu` in `(0, 1]`: the caller holds them above 0.
    #[inline(always)]
    pub fn slopes(&self, mu0: f64, mu: f64, phase_part: f64) -> Slopes {
        match self {
            Self::Lambert => lambert::slopes(mu0),
            Self::LommelSeeliger => lommel_seeliger::slopes(mu0, mu),
            Self::LunarLambert(_) => LunarLambert::slopes(mu0, mu, phase_part),
            Self::Minnaert(law) => law.slopes(mu0, mu),
            Self::Hapke1963(law) => law.slopes(mu0, mu, phase_part),
            Self::Hapke(law) => law.slopes(mu0, mu, phase_part),
        }
    }

    /// The fast form, with everything worked out that does not depend on the angles.
    pub(crate) fn prepared(&self) -> Prepared {
        match self {
            Self::Lambert => Prepared::Lambert,
            Self::LommelSeeliger => Prepared::LommelSeeliger,
            Self::LunarLambert(law) => Prepared::LunarLambert(law.prepared()),
            Self::Minnaert(law) => Prepared::Minnaert(law.prepared()),
            Self::Hapke1963(law) => Prepared::Hapke1963(law.prepared()),
            Self::Hapke(law) => Prepared::Hapke(hapke_fast::Prepared::new(law)),
        }
    }
}

/// A radiance factor and its derivatives by the cosines of incidence and emission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slopes {
    /// Radiance factor `I/F`, without albedo scale.
    pub value: f64,
    /// Its derivative by cos i.
    pub by_mu0: f64,
    /// Its derivative by cos e.
    pub by_mu: f64,
    /// Its derivative by the phase part ([`Brdf::phase_part`]).
    pub by_phase_part: f64,
}

/// The angles of the fast form.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Angles<L> {
    /// cos i.
    pub mu0: L,
    /// cos e.
    pub mu: L,
    /// `sin²(g/2) = |s − v|²/4`, with `s` and `v` the unit vectors to the Sun and to the eye. The cosine of the
    /// phase angle would not do: near opposition an `f32` cosine knows the angle to 0.02° only.
    pub sin_sq_half_phase: L,
}

/// A law ready for [`Prepared::radiance_factor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Prepared {
    /// See [`Brdf::Lambert`].
    Lambert,
    /// See [`Brdf::LommelSeeliger`].
    LommelSeeliger,
    /// See [`Brdf::LunarLambert`].
    LunarLambert(lunar_lambert::Prepared),
    /// See [`Brdf::Minnaert`].
    Minnaert(minnaert::Prepared),
    /// See [`Brdf::Hapke1963`].
    Hapke1963(hapke1963::Prepared),
    /// See [`Brdf::Hapke`].
    Hapke(hapke_fast::Prepared),
}

/// Cosines below this (89.99994°) are taken as this, so that no lane divides by zero.
const MIN_COSINE: f32 = 1e-6;

impl Prepared {
    /// Radiance factor `I/F` in lanes, without albedo scale; 0 in lanes where `mu0 ≤ 0` or `mu ≤ 0`.
    /// Within 2e-4 of the reference, relative (see the tests).
    #[inline(always)]
    pub fn radiance_factor<L: Lanes>(&self, angles: Angles<L>) -> L {
        let (zero, one, least) = (L::splat(0.0), L::splat(1.0), L::splat(MIN_COSINE));
        let mu0 = angles.mu0.max(least).min(one);
        let mu = angles.mu.max(least).min(one);
        let x = angles.sin_sq_half_phase.max(zero).min(one);
        let factor = match self {
            Self::Lambert => lambert::radiance_factor_fast(mu0),
            Self::LommelSeeliger => lommel_seeliger::radiance_factor_fast(mu0, mu),
            Self::LunarLambert(law) => law.radiance_factor(mu0, mu, x),
            Self::Minnaert(law) => law.radiance_factor(mu0, mu),
            Self::Hapke1963(law) => law.radiance_factor(mu0, mu, x),
            Self::Hapke(law) => law.radiance_factor(mu0, mu, x),
        };
        L::select_lt(zero, angles.mu0, L::select_lt(zero, angles.mu, factor, zero), zero)
    }
}

#[cfg(test)]
mod tests;
