//! Element-wise arithmetic on rows, compiled once per instruction set.
//!
//! The bodies are plain loops over slices; each public function wraps one of them for every level, and the
//! compiler vectorises it with what that level has.

use crate::kernel::PANEL;

/// Multiply and add, fused where the instructions exist.
pub(crate) trait MulAdd {
    fn mul_add(a: f32, b: f32, c: f32) -> f32;
}

/// One rounding.
pub(crate) struct Fused;
/// Two roundings: without the instruction, a fused one would be a function call.
pub(crate) struct Separate;

impl MulAdd for Fused {
    #[inline(always)]
    fn mul_add(a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }
}

impl MulAdd for Separate {
    #[inline(always)]
    fn mul_add(a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
}

/// Defines a function that runs `$body` with the instructions of a level.
macro_rules! per_level {
    ($(#[$doc:meta])* $name:ident = $body:ident($($arg:ident: $kind:ty),* $(,)?) $(-> $out:ty)?) => {
        $(#[$doc])*
        pub(crate) fn $name(level: $crate::kernel::Simd, $($arg: $kind),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
                fn wide($($arg: $kind),*) $(-> $out)? {
                    $body::<$crate::vector::Fused>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma")]
                fn middle($($arg: $kind),*) $(-> $out)? {
                    $body::<$crate::vector::Fused>($($arg),*)
                }
                match level {
                    // SAFETY: the engine uses only levels that `Simd::checked` has let through.
                    $crate::kernel::Simd::Avx512 => return unsafe { wide($($arg),*) },
                    // SAFETY: as above.
                    $crate::kernel::Simd::Avx2 => return unsafe { middle($($arg),*) },
                    $crate::kernel::Simd::Plain => {}
                }
            }
            #[cfg(not(target_arch = "x86_64"))]
            let _ = level;
            $body::<$crate::vector::Separate>($($arg),*)
        }
    };
}
pub(crate) use per_level;

/// Sums kept apart while reducing a row: enough for four 512-bit vectors.
const LANES: usize = 64;

const LN2_HIGH: f32 = 0.693_359_4;
const LN2_LOW: f32 = -2.121_944_4e-4;
/// Adding it rounds to an integer, which is then in the low bits.
const ROUNDER: f32 = 12_582_912.0;
/// Below it the result would be subnormal.
const EXP_MIN: f32 = -87.0;
const EXP_MAX: f32 = 88.0;

/// `exp(x)` to 2 units in the last place for x from −87 to 88, constant outside.
#[inline(always)]
pub(crate) fn exp<M: MulAdd>(x: f32) -> f32 {
    let x = if x > EXP_MIN { x } else { EXP_MIN };
    let x = if x < EXP_MAX { x } else { EXP_MAX };
    let shifted = M::mul_add(x, std::f32::consts::LOG2_E, ROUNDER);
    let whole = shifted - ROUNDER;
    let rest = M::mul_add(whole, -LN2_LOW, M::mul_add(whole, -LN2_HIGH, x));
    // Taylor: the first term left out is 5e-9 at |rest| = ln(2)/2.
    let mut sum = M::mul_add(rest, 1.0 / 5040.0, 1.0 / 720.0);
    sum = M::mul_add(sum, rest, 1.0 / 120.0);
    sum = M::mul_add(sum, rest, 1.0 / 24.0);
    sum = M::mul_add(sum, rest, 1.0 / 6.0);
    sum = M::mul_add(sum, rest, 0.5);
    sum = M::mul_add(sum, rest, 1.0);
    sum = M::mul_add(sum, rest, 1.0);
    sum * f32::from_bits((shifted.to_bits() << 23).wrapping_add(0x3F80_0000))
}

/// Exact GELU, `x Φ(x)`, by the error function of Abramowitz and Stegun 7.1.26 (error below 1.5e-7).
#[inline(always)]
pub(crate) fn gelu<M: MulAdd>(x: f32) -> f32 {
    let size = x.abs();
    let z = size * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / M::mul_add(z, 0.327_591_1, 1.0);
    let mut tail = M::mul_add(t, 1.061_405_4, -1.453_152_1);
    tail = M::mul_add(tail, t, 1.421_413_7);
    tail = M::mul_add(tail, t, -0.284_496_72);
    tail = M::mul_add(tail, t, 0.254_829_6);
    let tail = 0.5 * tail * t * exp::<M>(-z * z);
    let positive = if x > 0.0 { x } else { 0.0 };
    M::mul_add(-size, tail, positive)
}

/// What happens to a sum and its bias.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Activation {
    /// Nothing.
    None,
    /// Negative values become zero.
    Relu,
    /// `x Φ(x)`.
    Gelu,
}

#[inline(always)]
fn activate_body<M: MulAdd>(row: &mut [f32; PANEL], bias: &[f32; PANEL], activation: Activation) {
    match activation {
        Activation::None => {
            for (value, bias) in row.iter_mut().zip(bias) {
                *value += bias;
            }
        }
        Activation::Relu => {
            for (value, bias) in row.iter_mut().zip(bias) {
                let sum = *value + bias;
                *value = if sum > 0.0 { sum } else { 0.0 };
            }
        }
        Activation::Gelu => {
            for (value, bias) in row.iter_mut().zip(bias) {
                *value = gelu::<M>(*value + bias);
            }
        }
    }
}
per_level! {
    /// `row = activation(row + bias)`.
    activate = activate_body(row: &mut [f32; PANEL], bias: &[f32; PANEL], activation: Activation)
}

#[inline(always)]
fn sum_body<M: MulAdd>(row: &[f32], center: f32, squared: bool) -> f32 {
    let mut sums = [0.0_f32; LANES];
    let chunks = row.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (sum, value) in sums.iter_mut().zip(chunk) {
            let off = value - center;
            *sum = if squared { M::mul_add(off, off, *sum) } else { *sum + off };
        }
    }
    for (sum, value) in sums.iter_mut().zip(rest) {
        let off = value - center;
        *sum += if squared { off * off } else { off };
    }
    sums.iter().sum()
}

#[inline(always)]
fn normalize_body<M: MulAdd>(row: &[f32], weight: &[f32], bias: &[f32], eps: f32, out: &mut [f32]) {
    let count = row.len() as f32;
    let mean = sum_body::<M>(row, 0.0, false) / count;
    let variance = sum_body::<M>(row, mean, true) / count;
    let scale = 1.0 / (variance + eps).sqrt();
    for (((out, value), weight), bias) in out.iter_mut().zip(row).zip(weight).zip(bias) {
        *out = M::mul_add((value - mean) * scale, *weight, *bias);
    }
}
per_level! {
    /// Layer normalisation of one row.
    normalize = normalize_body(row: &[f32], weight: &[f32], bias: &[f32], eps: f32, out: &mut [f32])
}

#[inline(always)]
fn exponentiate_body<M: MulAdd>(row: &mut [f32]) -> f32 {
    let mut tops = [f32::NEG_INFINITY; LANES];
    let whole = row.len() / LANES * LANES;
    let (body, rest) = row.split_at_mut(whole);
    for chunk in body.chunks_exact(LANES) {
        for (top, value) in tops.iter_mut().zip(chunk) {
            *top = if *value > *top { *value } else { *top };
        }
    }
    for (top, value) in tops.iter_mut().zip(rest.iter()) {
        *top = if *value > *top { *value } else { *top };
    }
    let mut top = tops[0];
    for value in tops {
        top = if value > top { value } else { top };
    }
    let mut sums = [0.0_f32; LANES];
    for chunk in body.chunks_exact_mut(LANES) {
        for (sum, value) in sums.iter_mut().zip(chunk) {
            let power = exp::<M>(*value - top);
            *value = power;
            *sum += power;
        }
    }
    for (sum, value) in sums.iter_mut().zip(rest) {
        let power = exp::<M>(*value - top);
        *value = power;
        *sum += power;
    }
    sums.iter().sum()
}
per_level! {
    /// `exp(row − max(row))` in place; returns the sum.
    exponentiate = exponentiate_body(row: &mut [f32]) -> f32
}

#[inline(always)]
fn scale_body<M: MulAdd>(row: &[f32], factor: f32, out: &mut [f32]) {
    for (out, value) in out.iter_mut().zip(row) {
        *out = value * factor;
    }
}
per_level! {
    /// `out = row · factor`.
    scale = scale_body(row: &[f32], factor: f32, out: &mut [f32])
}

/// Angles of a token: cosines and sines of its row, then of its column.
#[derive(Clone, Copy)]
pub(crate) struct Angles<'a> {
    pub cos: [&'a [f32]; 2],
    pub sin: [&'a [f32]; 2],
}

#[inline(always)]
fn rotate_body<M: MulAdd>(row: &[f32], angles: Angles<'_>, factor: f32, out: &mut [f32]) {
    let len = row.len() / 4;
    for half in 0..2 {
        let (a, b) = (&row[2 * half * len..][..len], &row[(2 * half + 1) * len..][..len]);
        let (out_a, out_b) = out[2 * half * len..][..2 * len].split_at_mut(len);
        let (cos, sin) = (&angles.cos[half][..len], &angles.sin[half][..len]);
        for k in 0..len {
            out_a[k] = (a[k] * cos[k] - b[k] * sin[k]) * factor;
            out_b[k] = (b[k] * cos[k] + a[k] * sin[k]) * factor;
        }
    }
}
per_level! {
    /// Rotates the first half of `row` by the angles of its row in the grid, the second by those of its
    /// column, in pairs (k, k + len / 4), and scales.
    rotate = rotate_body(row: &[f32], angles: Angles<'_>, factor: f32, out: &mut [f32])
}

#[inline(always)]
fn mix_body<M: MulAdd>(corners: [&[f32]; 4], weights: [f32; 4], out: &mut [f32]) {
    let len = out.len();
    let [a, b, c, d] = corners;
    let (a, b, c, d) = (&a[..len], &b[..len], &c[..len], &d[..len]);
    for k in 0..len {
        let first = M::mul_add(a[k], weights[0], b[k] * weights[1]);
        out[k] = first + M::mul_add(c[k], weights[2], d[k] * weights[3]);
    }
}
per_level! {
    /// Weighted sum of four rows.
    mix = mix_body(corners: [&[f32]; 4], weights: [f32; 4], out: &mut [f32])
}

#[inline(always)]
fn dot_body<M: MulAdd>(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 16];
    let (a, b) = (&a[..a.len().min(b.len())], &b[..a.len().min(b.len())]);
    let chunks = a.chunks_exact(16).zip(b.chunks_exact(16));
    for (a, b) in chunks {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum = M::mul_add(*a, *b, *sum);
        }
    }
    let whole = a.len() / 16 * 16;
    for ((sum, a), b) in sums.iter_mut().zip(&a[whole..]).zip(&b[whole..]) {
        *sum = M::mul_add(*a, *b, *sum);
    }
    let mut width = 8;
    while width > 0 {
        for k in 0..width {
            sums[k] += sums[k + width];
        }
        width /= 2;
    }
    sums[0]
}
per_level! {
    /// Sum of products.
    dot = dot_body(a: &[f32], b: &[f32]) -> f32
}

/// Levels of this processor, for tests.
#[cfg(test)]
pub(crate) fn levels() -> Vec<crate::kernel::Simd> {
    use crate::kernel::Simd;
    [Simd::Plain, Simd::Avx2, Simd::Avx512].into_iter().filter(|level| level.is_present()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of f32 and the stated error of the error function.
    const ROUNDING: f64 = 4e-7;

    /// erf by its Taylor series, in f64.
    fn erf(x: f64) -> f64 {
        let mut term = x;
        let mut sum = x;
        for n in 1..200 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        sum * std::f64::consts::FRAC_2_SQRT_PI
    }

    #[test]
    fn exponentials_are_close() {
        for idx in -8700..8800 {
            let x = idx as f32 * 0.01;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp::<Fused>(x)) / exact - 1.0).abs() < ROUNDING, "{x}");
            assert!((f64::from(exp::<Separate>(x)) / exact - 1.0).abs() < ROUNDING, "{x}");
        }
        assert!(exp::<Fused>(-1000.0) < 2e-38);
    }

    #[test]
    fn gelu_is_exact() {
        for level in levels() {
            for idx in -500..500 {
                let x = idx as f32 * 0.01;
                let mut row = [x; PANEL];
                activate(level, &mut row, &[0.0; PANEL], Activation::Gelu);
                let exact = 0.5 * f64::from(x) * (1.0 + erf(f64::from(x) * std::f64::consts::FRAC_1_SQRT_2));
                assert!((f64::from(row[17]) - exact).abs() < ROUNDING * (1.0 + exact.abs()), "{level:?} {x}");
            }
        }
    }

    #[test]
    fn rows_of_any_length() {
        for level in levels() {
            for len in [1_usize, 15, 64, 100, 1024] {
                let row: Vec<f32> = (0..len).map(|k| (k * 37 % 101) as f32 * 0.1 - 3.0).collect();
                let mut out = vec![0.0; len];
                normalize(level, &row, &vec![1.0; len], &vec![0.0; len], 1e-6, &mut out);
                let mean: f32 = out.iter().sum::<f32>() / len as f32;
                assert!(mean.abs() < 1e-5, "{level:?} {len} {mean}");
                let mut powers = row.clone();
                let sum = exponentiate(level, &mut powers);
                assert!((sum - powers.iter().sum::<f32>()).abs() < 1e-4 * sum);
                assert!(powers.iter().any(|v| (*v - 1.0).abs() < 1e-6));
                let squares: f32 = row.iter().map(|v| v * v).sum();
                assert!((dot(level, &row, &row) - squares).abs() < 1e-5 * squares.max(1.0));
            }
        }
    }
}
