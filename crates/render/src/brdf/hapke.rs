//! Hapke's photometric model of 1993, 2002 and 2012.

use super::{ParameterError, Slopes};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Which of Hapke's models: it decides which parameters may be set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum HapkeVersion {
    /// Shadow-hiding opposition effect and roughness.
    #[serde(rename = "1993")]
    V1993,
    /// Also coherent backscatter (`bc0`, `hc`).
    #[serde(rename = "2002")]
    V2002,
    /// Also porosity (`filling_factor`).
    #[default]
    #[serde(rename = "2012")]
    V2012,
}

/// Approximation of Chandrasekhar's H function for isotropic scatterers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum HFunction {
    /// `(1 + 2x)/(1 + 2γx)`: within 4 %.
    #[serde(rename = "1981")]
    H1981,
    /// The logarithmic form: within 1 %, and within 0.1 % for dark surfaces.
    #[default]
    #[serde(rename = "2002")]
    H2002,
}

/// Hapke's model with a two-lobed Henyey-Greenstein phase function, shadow-hiding (SHOE) and coherent-backscatter
/// (CBOE) opposition effects, macroscopic roughness and porosity.
///
/// `I/F = (K w/4) m0/(m0 + m) [P(g)(1 + BS0 BS(g)) + H(m0/K) H(m/K) − 1] (1 + BC0 BC(g)) S`,
/// with `m0`, `m`, `S` the effective cosines and the shadowing function of the rough surface.
///
/// Multiple scattering is isotropic (IMSA) in every version. Hapke 2002 also gives a Legendre expansion for
/// anisotropic scatterers; for a surface as dark as the Moon's it changes the result by less than the published
/// parameters are known to, and the published lunar parameters were fitted without it.
///
/// # Source
/// Hapke 1984, Icarus 59, 41 (roughness); Hapke 1993 and 2012, "Theory of Reflectance and Emittance Spectroscopy";
/// Hapke 2002, Icarus 157, 523 (CBOE, H function); Hapke 2008, Icarus 195, 918 (porosity).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hapke {
    /// Which model.
    pub version: HapkeVersion,
    /// Single-scattering albedo, in `[0, 1]`.
    pub w: f64,
    /// Width of the lobes, in `[0, 1)`.
    pub b: f64,
    /// Weight of the lobes, in `[-1, 1]`: `(1 + c)/2` goes to the backward one. (Some programs have `(1 + c)/2` as
    /// their parameter.)
    pub c: f64,
    /// Amplitude of the shadow-hiding opposition effect, ≥ 0. Values above 1 are normal for the Moon.
    pub bs0: f64,
    /// Its angular width, > 0.
    pub hs: f64,
    /// Amplitude of the coherent-backscatter opposition effect, ≥ 0.
    pub bc0: f64,
    /// Its angular width, > 0.
    pub hc: f64,
    /// Mean slope of the roughness below the terrain model's resolution, degrees in `[0, 60]`. Published values
    /// (23.4° for the Moon) stand for *all* slopes: with slopes of metres resolved by the terrain they count some
    /// twice.
    pub theta_deg: f64,
    /// Filling factor φ = 1 − porosity of the regolith, in `[0, 0.74]`; 0 leaves porosity out (K = 1).
    pub filling_factor: f64,
    /// The H function.
    pub h_function: HFunction,
}

impl Default for Hapke {
    /// Round values for the Moon in red light, of the size that global fits find (such as Sato et al. 2014, JGR 119,
    /// 1775), without coherent backscatter and porosity.
    fn default() -> Self {
        Self {
            version: HapkeVersion::default(),
            w: 0.30,
            b: 0.24,
            c: 0.30,
            bs0: 1.8,
            hs: 0.07,
            bc0: 0.0,
            hc: 1.0,
            theta_deg: 23.4,
            filling_factor: 0.0,
            h_function: HFunction::default(),
        }
    }
}

/// What the roughness makes of a geometry.
struct Effective {
    mu0: f64,
    mu: f64,
    shadowing: f64,
}

impl Hapke {
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        let law = "hapke";
        let within = |name, value, min, max| ParameterError::within(law, name, value, min, max);
        within("w", self.w, 0.0, 1.0)?;
        within("b", self.b, 0.0, 0.99)?;
        within("c", self.c, -1.0, 1.0)?;
        within("bs0", self.bs0, 0.0, 100.0)?;
        within("hs", self.hs, 1e-4, 100.0)?;
        within("bc0", self.bc0, 0.0, 100.0)?;
        within("hc", self.hc, 1e-4, 100.0)?;
        within("theta_deg", self.theta_deg, 0.0, 60.0)?;
        within("filling_factor", self.filling_factor, 0.0, 0.74)?;
        let unset = |parameter, found, since: &str| match found == 0.0 {
            true => Ok(()),
            false => {
                let expected = format!("0 before version {since}");
                Err(ParameterError { law, parameter, expected, found })
            }
        };
        if self.version == HapkeVersion::V1993 {
            unset("bc0", self.bc0, "2002")?;
        }
        if self.version != HapkeVersion::V2012 {
            unset("filling_factor", self.filling_factor, "2012")?;
        }
        Ok(())
    }

    /// The porosity coefficient `K = −ln(1 − 1.209 φ^⅔) / (1.209 φ^⅔)`.
    pub(super) fn porosity_coefficient(&self) -> f64 {
        let packed = 1.209 * self.filling_factor.powf(2.0 / 3.0);
        if packed == 0.0 { 1.0 } else { -(-packed).ln_1p() / packed }
    }

    fn h(&self, x: f64) -> f64 {
        let gamma = (1.0 - self.w).sqrt();
        match self.h_function {
            HFunction::H1981 => (1.0 + 2.0 * x) / (1.0 + 2.0 * gamma * x),
            HFunction::H2002 => {
                let r0 = (1.0 - gamma) / (1.0 + gamma);
                let log = ((1.0 + x) / x).ln();
                1.0 / (1.0 - self.w * x * (r0 + (1.0 - 2.0 * r0 * x) / 2.0 * log))
            }
        }
    }

    fn phase_function(&self, cos_phase: f64) -> f64 {
        let (b, c) = (self.b, self.c);
        let lobe = |cos: f64| (1.0 - b * b) / (1.0 - 2.0 * b * cos + b * b).powf(1.5);
        (1.0 + c) / 2.0 * lobe(cos_phase) + (1.0 - c) / 2.0 * lobe(-cos_phase)
    }

    /// Coherent backscatter `[1 + (1 − e^−z)/z] / [2 (1 + z)²]`, `z = tan(g/2)/hc`.
    fn coherent(&self, tan_half: f64) -> f64 {
        let z = tan_half / self.hc;
        let mean = if z == 0.0 { 1.0 } else { -(-z).exp_m1() / z };
        (1.0 + mean) / (2.0 * (1.0 + z).powi(2))
    }

    pub(super) fn radiance_factor(&self, mu0: f64, mu: f64, cos_phase: f64) -> f64 {
        let tan_half = ((1.0 - cos_phase) / (1.0 + cos_phase)).sqrt();
        let hiding = 1.0 / (1.0 + tan_half / self.hs);
        let k = self.porosity_coefficient();
        let rough = self.roughened(mu0, mu, cos_phase);
        let single = self.phase_function(cos_phase) * (1.0 + self.bs0 * hiding);
        let multiple = self.h(rough.mu0 / k) * self.h(rough.mu / k) - 1.0;
        let coherent = 1.0 + self.bc0 * self.coherent(tan_half);
        0.25 * k * self.w * rough.mu0 / (rough.mu0 + rough.mu)
            * (single + multiple)
            * coherent
            * rough.shadowing
    }

    /// By central differences: the rough surface's effective cosines are one formula in two cases over the azimuth, and what
    /// differencing them in f64 loses ([`STEP`]³) is below what the law is known to.
    pub(super) fn slopes(&self, mu0: f64, mu: f64, cos_phase: f64) -> Slopes {
        /// Change of a cosine.
        const STEP: f64 = 1e-5;
        let difference =
            |below: f64, above: f64, of: &dyn Fn(f64) -> f64| (of(above) - of(below)) / (above - below);
        // One-sided at the ends, where a cosine has no further side.
        let by = |at: f64, of: &dyn Fn(f64) -> f64| {
            difference((at - STEP).max(0.5 * at), (at + STEP).min(1.0), of)
        };
        let (back, forth) = ((cos_phase - STEP).max(-1.0), (cos_phase + STEP).min(1.0));
        Slopes {
            value: self.radiance_factor(mu0, mu, cos_phase),
            by_mu0: by(mu0, &|mu0| self.radiance_factor(mu0, mu, cos_phase)),
            by_mu: by(mu, &|mu| self.radiance_factor(mu0, mu, cos_phase)),
            by_phase_part: difference(back, forth, &|cos_phase| self.radiance_factor(mu0, mu, cos_phase)),
        }
    }

    /// Effective cosines and shadowing of a surface of mean slope `theta_deg` (Hapke 1984, eqs. 40-59).
    fn roughened(&self, mu0: f64, mu: f64, cos_phase: f64) -> Effective {
        let tan_theta = self.theta_deg.to_radians().tan();
        if tan_theta == 0.0 {
            return Effective { mu0, mu, shadowing: 1.0 };
        }
        let sine = |cos: f64| ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt();
        let (sin_i, sin_e) = (sine(mu0), sine(mu));
        let sin_sq_half = half_azimuth_sin_sq(mu0, mu, sin_i, sin_e, cos_phase);
        let psi = 2.0 * sin_sq_half.sqrt().asin();
        let chi = 1.0 / (1.0 + PI * tan_theta * tan_theta).sqrt();
        // At normal incidence the cotangent is infinite and both exponentials vanish.
        let e1 = |cos: f64, sin: f64| (-2.0 * cos / (sin * PI * tan_theta)).exp();
        let e2 = |cos: f64, sin: f64| (-(cos / sin).powi(2) / (PI * tan_theta * tan_theta)).exp();
        let (e1_i, e1_e) = (e1(mu0, sin_i), e1(mu, sin_e));
        let (e2_i, e2_e) = (e2(mu0, sin_i), e2(mu, sin_e));
        let eta_i = chi * (mu0 + sin_i * tan_theta * e2_i / (2.0 - e1_i));
        let eta_e = chi * (mu + sin_e * tan_theta * e2_e / (2.0 - e1_e));
        // The formulas depend on which of the two angles is the smaller (`near`); it plays the same part in both.
        let sun_is_near = mu0 >= mu;
        let swap = |a: f64, b: f64| if sun_is_near { (a, b) } else { (b, a) };
        let ((cos_n, cos_f), (sin_n, sin_f)) = (swap(mu0, mu), swap(sin_i, sin_e));
        let ((e1_n, e1_f), (e2_n, e2_f)) = (swap(e1_i, e1_e), swap(e2_i, e2_e));
        let (eta_n, _) = swap(eta_i, eta_e);
        let divisor = 2.0 - e1_f - psi / PI * e1_n;
        let near = chi * (cos_n + sin_n * tan_theta * (psi.cos() * e2_f + sin_sq_half * e2_n) / divisor);
        let far = chi * (cos_f + sin_f * tan_theta * (e2_f - sin_sq_half * e2_n) / divisor);
        let (m0, m) = swap(near, far);
        let fraction = (-2.0 * (psi / 2.0).tan()).exp();
        let shadowing = m / eta_e * mu0 / eta_i * chi / (1.0 - fraction + fraction * chi * cos_n / eta_n);
        Effective { mu0: m0, mu: m, shadowing }
    }
}

/// `sin²(ψ/2)` of the azimuth ψ between the planes of incidence and emission; 0 where one of them is undefined.
///
/// `sin²(g/2) − sin²((i − e)/2) = sin i sin e sin²(ψ/2)`, with the second term taken from `sin(i − e)` so that
/// nothing cancels where i is near e.
fn half_azimuth_sin_sq(mu0: f64, mu: f64, sin_i: f64, sin_e: f64, cos_phase: f64) -> f64 {
    let product = sin_i * sin_e;
    if product == 0.0 {
        return 0.0;
    }
    let sin_difference = sin_i * mu - mu0 * sin_e;
    let cos_difference = mu0 * mu + product;
    let within_plane = sin_difference * sin_difference / (2.0 * (1.0 + cos_difference));
    (((1.0 - cos_phase) / 2.0 - within_plane) / product).clamp(0.0, 1.0)
}
