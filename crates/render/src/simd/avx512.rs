//! Sixteen lanes in one AVX-512 register.

use super::{F32x16, I32x16, LANES};
use crate::brdf::Lanes;
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

#[derive(Clone, Copy)]
pub(crate) struct F(__m512);
#[derive(Clone, Copy)]
pub(crate) struct I(__m512i);
/// A mask register is sixteen bits, as plain Rust's mask is.
pub(crate) use super::scalar::M;

// SAFETY of every block below: these types are only used by kernels that `crate::dispatch` enters after it has found
// AVX-512 F, DQ, BW and VL on the machine.
macro_rules! ins {
    ($e:expr) => {{
        // SAFETY: see the note at the top of this file.
        unsafe { $e }
    }};
}

macro_rules! lanewise {
    ($op:ident, $method:ident, $intrinsic:ident) => {
        impl $op for F {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(ins!($intrinsic(self.0, other.0)))
            }
        }
    };
}
lanewise!(Add, add, _mm512_add_ps);
lanewise!(Sub, sub, _mm512_sub_ps);
lanewise!(Mul, mul, _mm512_mul_ps);
lanewise!(Div, div, _mm512_div_ps);

impl I32x16 for I {
    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self(ins!(_mm512_set1_epi32(value)))
    }
    #[inline(always)]
    fn store(self) -> [i32; LANES] {
        let mut out = [0; LANES];
        ins!(_mm512_storeu_si512(out.as_mut_ptr().cast(), self.0));
        out
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(ins!(_mm512_add_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(ins!(_mm512_sub_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(ins!(_mm512_mullo_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(ins!(_mm512_min_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(ins!(_mm512_max_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn shr(self, by: Self) -> Self {
        Self(ins!(_mm512_srav_epi32(self.0, by.0)))
    }
    #[inline(always)]
    fn shl(self, by: Self) -> Self {
        Self(ins!(_mm512_sllv_epi32(self.0, by.0)))
    }
    #[inline(always)]
    fn lookup(self, table: &[i32; LANES]) -> Self {
        Self(ins!(_mm512_permutexvar_epi32(self.0, _mm512_loadu_si512(table.as_ptr().cast()))))
    }
}

impl Lanes for F {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(ins!(_mm512_set1_ps(value)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(ins!(_mm512_sqrt_ps(self.0)))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(ins!(_mm512_min_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(ins!(_mm512_max_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, yes: Self, no: Self) -> Self {
        Self::select(a.lt(b), yes, no)
    }
}

impl F32x16 for F {
    type Mask = M;
    type Int = I;
    #[inline(always)]
    fn load(values: &[f32; LANES]) -> Self {
        Self(ins!(_mm512_loadu_ps(values.as_ptr())))
    }
    #[inline(always)]
    fn store(self) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        ins!(_mm512_storeu_ps(out.as_mut_ptr(), self.0));
        out
    }
    #[inline(always)]
    fn lt(self, other: Self) -> M {
        M(ins!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn select(mask: M, yes: Self, no: Self) -> Self {
        Self(ins!(_mm512_mask_blend_ps(mask.0, no.0, yes.0)))
    }
    #[inline(always)]
    fn select_int(mask: M, yes: I, no: I) -> I {
        I(ins!(_mm512_mask_blend_epi32(mask.0, no.0, yes.0)))
    }
    #[inline(always)]
    fn int_eq(a: I, b: I) -> M {
        M(ins!(_mm512_cmpeq_epi32_mask(a.0, b.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(ins!(_mm512_abs_ps(self.0)))
    }
    #[inline(always)]
    fn truncate(self) -> I {
        I(ins!(_mm512_cvttps_epi32(self.0)))
    }
    #[inline(always)]
    fn from_int(value: I) -> Self {
        Self(ins!(_mm512_cvtepi32_ps(value.0)))
    }
    #[inline(always)]
    unsafe fn gather(base: *const f32, idx: I) -> Self {
        Self(ins!(_mm512_i32gather_ps::<4>(idx.0, base)))
    }
    #[inline(always)]
    unsafe fn gather_pair(base: *const f32, idx: I) -> (Self, Self) {
        ins!({
            let low = _mm512_i32gather_epi64::<4>(_mm512_castsi512_si256(idx.0), base.cast());
            let high = _mm512_i32gather_epi64::<4>(_mm512_extracti64x4_epi64::<1>(idx.0), base.cast());
            let (low, high) = (_mm512_castsi512_ps(low), _mm512_castsi512_ps(high));
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            (Self(_mm512_permutex2var_ps(low, even, high)), Self(_mm512_permutex2var_ps(low, odd, high)))
        })
    }
}
