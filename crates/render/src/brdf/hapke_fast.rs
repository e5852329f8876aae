//! [`Hapke`] in lanes.

use super::hapke::{HFunction, Hapke};
use super::lanes::{DECAY_END, Lanes, asin_of_sqrt, decay, exp_of_minus, x_log_ratio};
use std::f64::consts::PI;

/// Sines below this (0.06″) are taken as this, so that cotangents stay finite.
const MIN_SINE: f32 = 3e-7;

/// [`Hapke`] with what depends on its parameters alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prepared {
    scale: f32,
    inverse_k: f32,
    lobe: [Lobe; 2],
    bs0: f32,
    hs: f32,
    coherent: Option<Coherent>,
    rough: Option<Rough>,
    multiple: Multiple,
}

/// `weight / (offset + slope x)^(3/2)`, `x = sin²(g/2)`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lobe {
    weight: f32,
    offset: f32,
    slope: f32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Coherent {
    bc0: f32,
    inverse_hc: f32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Rough {
    tan: f32,
    chi: f32,
    e1: f32,
    e2: f32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Multiple {
    H1981 { two_gamma: f32 },
    H2002 { w: f32, r0: f32 },
}

impl Prepared {
    pub(super) fn new(law: &Hapke) -> Self {
        let k = law.porosity_coefficient();
        let gamma = (1.0 - law.w).sqrt();
        let lobe = |weight: f64, b: f64| Lobe {
            weight: (weight * (1.0 - b * b)) as f32,
            offset: (1.0 - b).powi(2) as f32,
            slope: (4.0 * b) as f32,
        };
        let tan = law.theta_deg.to_radians().tan();
        Self {
            scale: (0.25 * k * law.w) as f32,
            inverse_k: (1.0 / k) as f32,
            lobe: [lobe((1.0 + law.c) / 2.0, law.b), lobe((1.0 - law.c) / 2.0, -law.b)],
            bs0: law.bs0 as f32,
            hs: law.hs as f32,
            coherent: (law.bc0 != 0.0)
                .then_some(Coherent { bc0: law.bc0 as f32, inverse_hc: (1.0 / law.hc) as f32 }),
            rough: (tan != 0.0).then_some(Rough {
                tan: tan as f32,
                chi: (1.0 / (1.0 + PI * tan * tan).sqrt()) as f32,
                e1: (2.0 / (PI * tan)) as f32,
                e2: (1.0 / (PI * tan * tan)) as f32,
            }),
            multiple: match law.h_function {
                HFunction::H1981 => Multiple::H1981 { two_gamma: (2.0 * gamma) as f32 },
                HFunction::H2002 => {
                    Multiple::H2002 { w: law.w as f32, r0: ((1.0 - gamma) / (1.0 + gamma)) as f32 }
                }
            },
        }
    }

    #[inline(always)]
    pub(super) fn radiance_factor<L: Lanes>(&self, mu0: L, mu: L, x: L) -> L {
        let s = L::splat;
        let one = s(1.0);
        let (sin_half, cos_half) = (x.sqrt(), (one - x).sqrt());
        let hiding = s(self.hs) * cos_half / (s(self.hs) * cos_half + sin_half);
        let phase_function = self.lobe[0].at(x) + self.lobe[1].at(x);
        let (m0, m, shadowing) = match &self.rough {
            Some(rough) => rough.effective(mu0, mu, x),
            None => (mu0, mu, one),
        };
        let inverse_k = s(self.inverse_k);
        let single = phase_function * (one + s(self.bs0) * hiding);
        let bracket = single + self.multiple.h(m0 * inverse_k) * self.multiple.h(m * inverse_k) - one;
        let factor = s(self.scale) * m0 / (m0 + m) * bracket * shadowing;
        match &self.coherent {
            Some(coherent) => factor * coherent.at(sin_half, cos_half),
            None => factor,
        }
    }
}

impl Lobe {
    #[inline(always)]
    fn at<L: Lanes>(&self, x: L) -> L {
        let d = L::splat(self.offset) + L::splat(self.slope) * x;
        L::splat(self.weight) / (d * d.sqrt())
    }
}

impl Coherent {
    #[inline(always)]
    fn at<L: Lanes>(&self, sin_half: L, cos_half: L) -> L {
        let one = L::splat(1.0);
        let z = L::splat(self.inverse_hc) * sin_half / cos_half.max(L::splat(MIN_SINE));
        let end = L::splat(DECAY_END);
        let (_, mean) = decay(z.min(end));
        let mean = L::select_lt(end, z, one / z.max(end), mean);
        let wide = one + z;
        one + L::splat(0.5 * self.bc0) * (one + mean) / (wide * wide)
    }
}

impl Multiple {
    #[inline(always)]
    fn h<L: Lanes>(&self, x: L) -> L {
        let (s, one) = (L::splat, L::splat(1.0));
        match *self {
            Self::H1981 { two_gamma } => (one + x + x) / (one + s(two_gamma) * x),
            Self::H2002 { w, r0 } => {
                let r0x = s(r0) * x;
                one / (one - s(w) * (r0x + (s(0.5) - r0x) * x_log_ratio(x.min(one).max(s(0.0)))))
            }
        }
    }
}

impl Rough {
    /// `m0`, `m` and `S`; the same formulas as the reference's, in the same order.
    #[inline(always)]
    fn effective<L: Lanes>(&self, mu0: L, mu: L, x: L) -> (L, L, L) {
        let (s, one) = (L::splat, L::splat(1.0));
        let (tan, chi) = (s(self.tan), s(self.chi));
        let sin_i = ((one - mu0) * (one + mu0)).sqrt().max(s(MIN_SINE));
        let sin_e = ((one - mu) * (one + mu)).sqrt().max(s(MIN_SINE));
        // Azimuth. `sin(i − e) = sin(i + e) sin(i − e) / sin(i + e)`, since `cos e − cos i` is exact where i is near e.
        let product = sin_i * sin_e;
        let sin_difference = (mu - mu0) * (mu + mu0) / (sin_i * mu + mu0 * sin_e).max(s(MIN_SINE));
        let cos_difference = mu0 * mu + product;
        let within_plane = sin_difference * sin_difference / (s(2.0) * (one + cos_difference));
        let sin_sq = ((x - within_plane) / product).max(s(0.0)).min(one);
        let (sin_psi2, cos_psi2) = (sin_sq.sqrt(), (one - sin_sq).sqrt());
        let psi_over_pi = s(std::f32::consts::FRAC_2_PI) * asin_of_sqrt(sin_sq, sin_psi2, cos_psi2);
        let fraction = exp_of_minus(s(2.0) * sin_psi2 / cos_psi2.max(s(MIN_SINE)));
        // Both directions.
        let (cot_i, cot_e) = (mu0 / sin_i, mu / sin_e);
        let (e1_i, e1_e) = (exp_of_minus(s(self.e1) * cot_i), exp_of_minus(s(self.e1) * cot_e));
        let e2_i = exp_of_minus(s(self.e2) * (cot_i * cot_i));
        let e2_e = exp_of_minus(s(self.e2) * (cot_e * cot_e));
        let eta_i = chi * (mu0 + sin_i * tan * e2_i / (s(2.0) - e1_i));
        let eta_e = chi * (mu + sin_e * tan * e2_e / (s(2.0) - e1_e));
        // The smaller angle is the near one.
        let near = |sun: L, eye: L| L::select_lt(mu0, mu, eye, sun);
        let far = |sun: L, eye: L| L::select_lt(mu0, mu, sun, eye);
        let (e2_n, e2_f) = (near(e2_i, e2_e), far(e2_i, e2_e));
        let divisor = s(2.0) - far(e1_i, e1_e) - psi_over_pi * near(e1_i, e1_e);
        let lift = tan / divisor;
        let cos_psi = one - (sin_sq + sin_sq);
        let cos_n = near(mu0, mu);
        let m_n = chi * (cos_n + near(sin_i, sin_e) * lift * (cos_psi * e2_f + sin_sq * e2_n));
        let m_f = chi * (far(mu0, mu) + far(sin_i, sin_e) * lift * (e2_f - sin_sq * e2_n));
        let (m0, m) = (near(m_n, m_f), near(m_f, m_n));
        let visible = one - fraction + fraction * chi * cos_n / near(eta_i, eta_e);
        (m0, m, m / eta_e * mu0 / eta_i * chi / visible)
    }
}
