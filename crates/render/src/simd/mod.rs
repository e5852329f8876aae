//! Sixteen lanes of `f32`, three ways: AVX-512, AVX2, plain Rust. No fused multiply-adds and no approximate instructions,
//! so that the three give the same bits.
//!
//! Kernels are generic functions marked `#[inline(always)]`; [`crate::dispatch`] instantiates each inside a function that
//! enables the instruction set. They hold no closures: a closure is a function of its own, does not inherit the instruction
//! set, and every operation in it would become a call (measured: seven times slower). This module and its callers' gathers are the only `unsafe` code of the crate.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
pub(crate) mod scalar;

use crate::brdf::Lanes;
use std::ops::{BitAnd, BitOr, Not};

/// Number of lanes, whatever the machine.
pub(crate) const LANES: usize = 16;

/// A truth value per lane.
pub(crate) trait Mask32x16:
    Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    fn any(self) -> bool;
    fn bits(self) -> u16;
    fn from_bits(bits: u16) -> Self;
}

/// A 32-bit integer per lane; arithmetic wraps.
pub(crate) trait I32x16: Copy {
    fn splat(value: i32) -> Self;
    fn store(self) -> [i32; LANES];
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    /// `self >> by`, keeping the sign; `by` in `0..32`.
    fn shr(self, by: Self) -> Self;
    /// `self << by`; `by` in `0..32`.
    fn shl(self, by: Self) -> Self;
    /// `table[self]`; every lane must be in `0..16`.
    fn lookup(self, table: &[i32; LANES]) -> Self;
}

/// A 32-bit float per lane.
pub(crate) trait F32x16: Lanes {
    type Mask: Mask32x16;
    type Int: I32x16;
    fn load(values: &[f32; LANES]) -> Self;
    fn store(self) -> [f32; LANES];
    fn lt(self, other: Self) -> Self::Mask;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    fn select_int(mask: Self::Mask, yes: Self::Int, no: Self::Int) -> Self::Int;
    fn int_eq(a: Self::Int, b: Self::Int) -> Self::Mask;
    fn abs(self) -> Self;
    /// Towards zero; values must fit an `i32`.
    fn truncate(self) -> Self::Int;
    fn from_int(value: Self::Int) -> Self;
    /// `base[idx]`.
    ///
    /// # Safety
    /// Every lane's index must be inside the allocation behind `base`.
    unsafe fn gather(base: *const f32, idx: Self::Int) -> Self;
    /// `(base[idx], base[idx + 1])`: one 64-bit load a lane.
    ///
    /// # Safety
    /// Every lane's index and the one after it must be inside the allocation behind `base`.
    unsafe fn gather_pair(base: *const f32, idx: Self::Int) -> (Self, Self);
}

/// Sum over the lanes in one fixed order.
#[inline(always)]
pub(crate) fn sum<F: F32x16>(value: F) -> f32 {
    let v = value.store();
    let mut half = [0.0f32; 8];
    for i in 0..8 {
        half[i] = v[i] + v[i + 8];
    }
    ((half[0] + half[4]) + (half[1] + half[5])) + ((half[2] + half[6]) + (half[3] + half[7]))
}

/// A divisor that is not zero.
#[inline(always)]
pub(crate) fn nonzero<F: F32x16>(v: F) -> F {
    let least = F::splat(1e-12);
    F::select(v.abs().lt(least), least, v)
}

/// Rounds down; values must fit an `i32`.
#[inline(always)]
pub(crate) fn floor<F: F32x16>(v: F) -> F::Int {
    let i = v.truncate();
    F::select_int(v.lt(F::from_int(i)), i.sub(F::Int::splat(1)), i)
}
