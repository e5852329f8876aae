//! Sixteen lanes in two AVX2 registers.

use super::{F32x16, I32x16, LANES, Mask32x16};
use crate::brdf::Lanes;
use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

#[derive(Clone, Copy)]
pub(crate) struct F(__m256, __m256);
#[derive(Clone, Copy)]
pub(crate) struct I(__m256i, __m256i);
/// All bits of a lane set or clear.
#[derive(Clone, Copy)]
pub(crate) struct M(__m256, __m256);

// SAFETY of every block below: these types are only used by kernels that `crate::dispatch` enters after it has found
// AVX2 on the machine.
macro_rules! ins {
    ($e:expr) => {{
        // SAFETY: see the note at the top of this file.
        unsafe { $e }
    }};
}

macro_rules! lanewise {
    ($type:ident, $op:ident, $method:ident, $intrinsic:ident) => {
        impl $op for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(ins!($intrinsic(self.0, other.0)), ins!($intrinsic(self.1, other.1)))
            }
        }
    };
}
lanewise!(F, Add, add, _mm256_add_ps);
lanewise!(F, Sub, sub, _mm256_sub_ps);
lanewise!(F, Mul, mul, _mm256_mul_ps);
lanewise!(F, Div, div, _mm256_div_ps);
lanewise!(M, BitAnd, bitand, _mm256_and_ps);
lanewise!(M, BitOr, bitor, _mm256_or_ps);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        let all = ins!(_mm256_castsi256_ps(_mm256_set1_epi32(-1)));
        Self(ins!(_mm256_xor_ps(self.0, all)), ins!(_mm256_xor_ps(self.1, all)))
    }
}
impl Mask32x16 for M {
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
    #[inline(always)]
    fn bits(self) -> u16 {
        let (low, high) = (ins!(_mm256_movemask_ps(self.0)), ins!(_mm256_movemask_ps(self.1)));
        (low | high << 8) as u16
    }
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        ins!({
            let weights = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let half = |b: u16| {
                let set = _mm256_and_si256(_mm256_set1_epi32(i32::from(b)), weights);
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(set, weights))
            };
            Self(half(bits & 0xff), half(bits >> 8))
        })
    }
}

macro_rules! int_op {
    ($method:ident, $intrinsic:ident) => {
        #[inline(always)]
        fn $method(self, other: Self) -> Self {
            Self(ins!($intrinsic(self.0, other.0)), ins!($intrinsic(self.1, other.1)))
        }
    };
}

impl I32x16 for I {
    #[inline(always)]
    fn splat(value: i32) -> Self {
        let v = ins!(_mm256_set1_epi32(value));
        Self(v, v)
    }
    #[inline(always)]
    fn store(self) -> [i32; LANES] {
        let mut out = [0i32; LANES];
        ins!(_mm256_storeu_si256(out.as_mut_ptr().cast(), self.0));
        ins!(_mm256_storeu_si256(out.as_mut_ptr().add(8).cast(), self.1));
        out
    }
    int_op!(add, _mm256_add_epi32);
    int_op!(sub, _mm256_sub_epi32);
    int_op!(mul, _mm256_mullo_epi32);
    int_op!(min, _mm256_min_epi32);
    int_op!(max, _mm256_max_epi32);
    int_op!(shr, _mm256_srav_epi32);
    int_op!(shl, _mm256_sllv_epi32);
    #[inline(always)]
    fn lookup(self, table: &[i32; LANES]) -> Self {
        Self(
            ins!(_mm256_i32gather_epi32::<4>(table.as_ptr(), self.0)),
            ins!(_mm256_i32gather_epi32::<4>(table.as_ptr(), self.1)),
        )
    }
}

impl Lanes for F {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        let v = ins!(_mm256_set1_ps(value));
        Self(v, v)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(ins!(_mm256_sqrt_ps(self.0)), ins!(_mm256_sqrt_ps(self.1)))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(ins!(_mm256_min_ps(self.0, other.0)), ins!(_mm256_min_ps(self.1, other.1)))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(ins!(_mm256_max_ps(self.0, other.0)), ins!(_mm256_max_ps(self.1, other.1)))
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
        Self(ins!(_mm256_loadu_ps(values.as_ptr())), ins!(_mm256_loadu_ps(values.as_ptr().add(8))))
    }
    #[inline(always)]
    fn store(self) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        ins!(_mm256_storeu_ps(out.as_mut_ptr(), self.0));
        ins!(_mm256_storeu_ps(out.as_mut_ptr().add(8), self.1));
        out
    }
    #[inline(always)]
    fn lt(self, other: Self) -> M {
        M(
            ins!(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)),
            ins!(_mm256_cmp_ps::<_CMP_LT_OQ>(self.1, other.1)),
        )
    }
    #[inline(always)]
    fn select(mask: M, yes: Self, no: Self) -> Self {
        Self(ins!(_mm256_blendv_ps(no.0, yes.0, mask.0)), ins!(_mm256_blendv_ps(no.1, yes.1, mask.1)))
    }
    #[inline(always)]
    fn select_int(mask: M, yes: I, no: I) -> I {
        I(
            ins!(_mm256_blendv_epi8(no.0, yes.0, _mm256_castps_si256(mask.0))),
            ins!(_mm256_blendv_epi8(no.1, yes.1, _mm256_castps_si256(mask.1))),
        )
    }
    #[inline(always)]
    fn int_eq(a: I, b: I) -> M {
        M(
            ins!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a.0, b.0))),
            ins!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a.1, b.1))),
        )
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let sign = ins!(_mm256_set1_ps(-0.0));
        Self(ins!(_mm256_andnot_ps(sign, self.0)), ins!(_mm256_andnot_ps(sign, self.1)))
    }
    #[inline(always)]
    fn truncate(self) -> I {
        I(ins!(_mm256_cvttps_epi32(self.0)), ins!(_mm256_cvttps_epi32(self.1)))
    }
    #[inline(always)]
    fn from_int(value: I) -> Self {
        Self(ins!(_mm256_cvtepi32_ps(value.0)), ins!(_mm256_cvtepi32_ps(value.1)))
    }
    #[inline(always)]
    unsafe fn gather(base: *const f32, idx: I) -> Self {
        Self(ins!(_mm256_i32gather_ps::<4>(base, idx.0)), ins!(_mm256_i32gather_ps::<4>(base, idx.1)))
    }
    #[inline(always)]
    unsafe fn gather_pair(base: *const f32, idx: I) -> (Self, Self) {
        // SAFETY: the caller vouches for every index and its successor.
        unsafe { (Self::gather(base, idx), Self::gather(base.add(1), idx)) }
    }
}
