//! The few operations that the fast reflectance laws are written in, and the functions built from them.
//!
//! Sixteen `f32` in a register, or one `f32`: the same source and, without fused multiply-adds, the same bits. There
//! are no branches on values and no calls into the platform's mathematical library, whose results differ between
//! machines.

use std::ops::{Add, Div, Mul, Sub};

/// One or more `f32` values that go through the same arithmetic.
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same value in every lane.
    fn splat(value: f32) -> Self;
    /// Correctly rounded square root.
    fn sqrt(self) -> Self;
    /// `if self < other { self } else { other }` (the second operand where one is NaN, as SSE has it).
    fn min(self, other: Self) -> Self;
    /// `if self > other { self } else { other }`.
    fn max(self, other: Self) -> Self;
    /// `if a < b { yes } else { no }`.
    fn select_lt(a: Self, b: Self, yes: Self, no: Self) -> Self;
}

impl Lanes for f32 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, yes: Self, no: Self) -> Self {
        if a < b { yes } else { no }
    }
}

/// Horner's scheme, lowest coefficient first.
#[inline(always)]
pub fn polynomial<L: Lanes, const N: usize>(x: L, coefficients: &[f32; N]) -> L {
    let mut sum = L::splat(coefficients[N - 1]);
    for i in (0..N - 1).rev() {
        sum = sum * x + L::splat(coefficients[i]);
    }
    sum
}

/// `asin(√z) / √z` on `[0, 1/2]`, near-minimax; 9e-7 absolute in `f32`.
const ASIN: [f32; 6] = [0.999_999_2, 0.166_771_8, 0.072_752_4, 0.061_862_14, -0.026_445_543, 0.098_137_99];

/// `asin(√z)` for `z` in `[0, 1]`, given both `√z` and `√(1 − z)`.
#[inline(always)]
pub(crate) fn asin_of_sqrt<L: Lanes>(z: L, sqrt_z: L, sqrt_rest: L) -> L {
    let half = L::splat(0.5);
    let rest = L::splat(1.0) - z;
    let small = L::select_lt(z, half, z, rest);
    let root = L::select_lt(z, half, sqrt_z, sqrt_rest);
    let angle = root * polynomial(small, &ASIN);
    L::select_lt(z, half, angle, L::splat(std::f32::consts::FRAC_PI_2) - angle)
}

/// `(1 − e^−v) / v` on `[0, 1]`, near-minimax; 1.3e-7 absolute in `f32`.
const DECAY: [f32; 6] =
    [0.999_999_94, -0.499_995_35, 0.166_611_25, -0.041_423_157, 0.007_842_377, -0.000_914_548_1];

/// Beyond this argument `e^−u` (1.1e-7) is below what an `f32` beside 1 can hold.
pub(crate) const DECAY_END: f32 = 16.0;

/// `(1 − e^−u, (1 − e^−u)/u)` for `u` in `[0, DECAY_END]`; both keep their relative precision towards `u = 0`.
///
/// The polynomial covers a sixteenth of the range; `q ← q(2 − q)` doubles the argument of `q = 1 − e^−v`.
#[inline(always)]
pub fn decay<L: Lanes>(u: L) -> (L, L) {
    let v = u * L::splat(1.0 / DECAY_END);
    let slope = polynomial(v, &DECAY);
    let two = L::splat(2.0);
    let (mut q, mut ratio) = (v * slope, slope * L::splat(1.0 / DECAY_END));
    for _ in 0..4 {
        let grow = two - q;
        q = q * grow;
        ratio = ratio * grow;
    }
    (q, ratio)
}

/// `e^−u` for `u ≥ 0`, 1e-6 absolute.
#[inline(always)]
pub(crate) fn exp_of_minus<L: Lanes>(u: L) -> L {
    L::splat(1.0) - decay(u.min(L::splat(DECAY_END))).0
}

/// `x ln((1 + x)/x)` with `x = y⁴`, `y` in `[0, 1]`, near-minimax; 1.1e-5 absolute in `f32`.
/// The fourth root tames the logarithm at 0.
const X_LOG: [f32; 9] = [
    9.808_218e-6,
    -0.000_316_107_4,
    -0.017_058_903,
    0.667_585_5,
    5.412_344,
    -10.252_386,
    4.990_470_4,
    0.667_639_3,
    -0.775_150_3,
];

/// `x ln((1 + x)/x)` for `x` in `[0, 1]`.
#[inline(always)]
pub(crate) fn x_log_ratio<L: Lanes>(x: L) -> L {
    polynomial(x.sqrt().sqrt(), &X_LOG)
}

/// Bits of an exponent's binary fraction that [`power`] uses: enough for 4e-5 relative at `x = 0.01`.
pub(crate) const POWER_BITS: u32 = 18;

/// `x^(bits / 2^POWER_BITS)` for `x ≥ 0` by a chain of square roots; the exponent is the same in every lane.
#[inline(always)]
pub fn power<L: Lanes>(x: L, bits: u32) -> L {
    let mut whole = L::splat(1.0);
    for _ in 0..bits >> POWER_BITS {
        whole = whole * x;
    }
    let mut root = x;
    for place in (0..POWER_BITS).rev() {
        root = root.sqrt();
        if bits >> place & 1 == 1 {
            whole = whole * root;
        }
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_agree_with_libm() {
        for i in 0..=1000 {
            let z = f64::from(i) / 1000.0;
            let x = z as f32;
            let angle = asin_of_sqrt(x, x.sqrt(), (1.0 - x).sqrt());
            assert!((f64::from(angle) - z.sqrt().asin()).abs() < 2e-6, "asin at {z}");
            let log = if z == 0.0 { 0.0 } else { z * ((1.0 + z) / z).ln() };
            assert!((f64::from(x_log_ratio(x)) - log).abs() < 2e-5, "log at {z}");
            let u = 20.0 * z;
            assert!((f64::from(exp_of_minus(u as f32)) - (-u).exp()).abs() < 2e-6, "exp at {u}");
            let k = 0.63;
            let bits = (k * f64::from(1u32 << POWER_BITS)).round() as u32;
            assert!((f64::from(power(x, bits)) - z.powf(k)).abs() <= 3e-5 * z.powf(k), "power at {z}");
        }
        let (q, ratio) = decay(1e-4f32);
        assert!((f64::from(q) + (-1e-4f64).exp_m1()).abs() < 1e-10);
        assert!((ratio - 0.99995).abs() < 1e-6);
    }
}
