//! Sixteen lanes in plain Rust.

use super::{F32x16, I32x16, LANES, Mask32x16};
use crate::brdf::Lanes;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

#[derive(Clone, Copy)]
pub(crate) struct F([f32; LANES]);
#[derive(Clone, Copy)]
pub(crate) struct I([i32; LANES]);
#[derive(Clone, Copy)]
pub(crate) struct M(pub(super) u16);

macro_rules! lanewise {
    ($op:ident, $method:ident, $symbol:tt) => {
        impl $op for F {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::array::from_fn(|k| self.0[k] $symbol other.0[k]))
            }
        }
    };
}
lanewise!(Add, add, +);
lanewise!(Sub, sub, -);
lanewise!(Mul, mul, *);
lanewise!(Div, div, /);

impl BitAnd for M {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}
impl BitOr for M {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}
impl Mask32x16 for M {
    #[inline(always)]
    fn any(self) -> bool {
        self.0 != 0
    }
    #[inline(always)]
    fn bits(self) -> u16 {
        self.0
    }
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        Self(bits)
    }
}

impl I32x16 for I {
    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn store(self) -> [i32; LANES] {
        self.0
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].wrapping_add(other.0[k])))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].wrapping_sub(other.0[k])))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].wrapping_mul(other.0[k])))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].min(other.0[k])))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].max(other.0[k])))
    }
    #[inline(always)]
    fn shr(self, by: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] >> by.0[k]))
    }
    #[inline(always)]
    fn shl(self, by: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] << by.0[k]))
    }
    #[inline(always)]
    fn lookup(self, table: &[i32; LANES]) -> Self {
        Self(std::array::from_fn(|k| table[self.0[k] as usize & (LANES - 1)]))
    }
}

impl Lanes for F {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| Lanes::min(self.0[k], other.0[k])))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| Lanes::max(self.0[k], other.0[k])))
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|k| if a.0[k] < b.0[k] { yes.0[k] } else { no.0[k] }))
    }
}

impl F32x16 for F {
    type Mask = M;
    type Int = I;
    #[inline(always)]
    fn load(values: &[f32; LANES]) -> Self {
        Self(*values)
    }
    #[inline(always)]
    fn store(self) -> [f32; LANES] {
        self.0
    }
    #[inline(always)]
    fn lt(self, other: Self) -> M {
        let mut bits = 0;
        for k in 0..LANES {
            bits |= u16::from(self.0[k] < other.0[k]) << k;
        }
        M(bits)
    }
    #[inline(always)]
    fn select(mask: M, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|k| if mask.0 >> k & 1 == 1 { yes.0[k] } else { no.0[k] }))
    }
    #[inline(always)]
    fn select_int(mask: M, yes: I, no: I) -> I {
        I(std::array::from_fn(|k| if mask.0 >> k & 1 == 1 { yes.0[k] } else { no.0[k] }))
    }
    #[inline(always)]
    fn int_eq(a: I, b: I) -> M {
        let mut bits = 0;
        for k in 0..LANES {
            bits |= u16::from(a.0[k] == b.0[k]) << k;
        }
        M(bits)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn truncate(self) -> I {
        I(self.0.map(|v| v as i32))
    }
    #[inline(always)]
    fn from_int(value: I) -> Self {
        Self(value.0.map(|v| v as f32))
    }
    #[inline(always)]
    unsafe fn gather(base: *const f32, idx: I) -> Self {
        // SAFETY: the caller vouches for every index.
        Self(idx.0.map(|i| unsafe { *base.offset(i as isize) }))
    }
    #[inline(always)]
    unsafe fn gather_pair(base: *const f32, idx: I) -> (Self, Self) {
        // SAFETY: the caller vouches for every index and its successor.
        unsafe { (Self::gather(base, idx), Self::gather(base.add(1), idx)) }
    }
}
