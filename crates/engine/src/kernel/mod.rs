//! The one multiplication everything is made of: 6 rows against a packed panel of 64 columns.
//!
//! A row is read where it lies, through pointers, and may consist of several segments: so the same kernel
//! multiplies matrices, concatenated inputs, and the nine taps of a convolution without copying its input.
#![allow(
    clippy::needless_range_loop,
    reason = "kernels have no closures, and registers are counted, not iterated"
)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod plain;
mod product;

pub(crate) use product::{PANEL, Product, ROWS};

use crate::error::{Error, Result};

/// The instructions used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Simd {
    /// What every processor of the architecture has.
    Plain,
    /// 256-bit vectors with fused multiply-add.
    Avx2,
    /// 512-bit vectors.
    Avx512,
}

impl Simd {
    /// The best that this processor has.
    #[must_use]
    pub fn detect() -> Self {
        [Self::Avx512, Self::Avx2].into_iter().find(|level| level.is_present()).unwrap_or(Self::Plain)
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_present(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        {
            match self {
                Self::Plain => true,
                Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
                Self::Avx512 => {
                    Self::Avx2.is_present()
                        && is_x86_feature_detected!("avx512f")
                        && is_x86_feature_detected!("avx512dq")
                        && is_x86_feature_detected!("avx512bw")
                        && is_x86_feature_detected!("avx512vl")
                }
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            self == Self::Plain
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "baseline instructions",
            Self::Avx2 => "AVX2 with FMA",
            Self::Avx512 => "AVX-512",
        }
    }

    /// Itself, if this processor has it.
    ///
    /// # Errors
    /// `SimdAbsent` otherwise.
    pub fn checked(self) -> Result<Self> {
        if self.is_present() { Ok(self) } else { Err(Error::SimdAbsent { level: self.name() }) }
    }
}

/// Computes a product with the instructions of `level`.
///
/// # Safety
/// `level` is present; each row pointer can be read for the length of its segment, the panel for 64 times
/// the sum of the segments; the tile can be written.
#[inline]
pub(crate) unsafe fn multiply(level: Simd, product: &Product<'_>) {
    debug_assert_eq!(product.rows.len(), product.segments.len() * ROWS);
    match level {
        // SAFETY: the caller's promise.
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => unsafe { avx512::multiply(product) },
        // SAFETY: the caller's promise.
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => unsafe { avx2::multiply(product) },
        // SAFETY: the caller's promise.
        _ => unsafe { plain::multiply(product) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of sums of 100 products of numbers below one in f32.
    const ROUNDING: f64 = 1e-5;

    #[test]
    fn every_level_multiplies() {
        let segments = [70_usize, 33];
        let total: usize = segments.iter().sum();
        let value = |idx: usize| ((idx * 7919 + 13) % 1009) as f32 / 504.5 - 1.0;
        let a: Vec<f32> = (0..ROWS * total).map(value).collect();
        let panel: Vec<f32> = (0..PANEL * total).map(|idx| value(idx + 5)).collect();
        let rows: Vec<*const f32> = [0, segments[0]]
            .iter()
            .flat_map(|first| (0..ROWS).map(|row| a[row * total + first..].as_ptr()).collect::<Vec<_>>())
            .collect();
        for level in [Simd::Plain, Simd::Avx2, Simd::Avx512] {
            if !level.is_present() {
                continue;
            }
            let mut tile = vec![1.0_f32; ROWS * 80];
            for accumulate in [false, true] {
                let product = Product {
                    rows: &rows,
                    segments: &segments,
                    panel: panel.as_ptr(),
                    tile: tile.as_mut_ptr(),
                    stride: 80,
                    accumulate,
                };
                // SAFETY: the slices above are as long as the product reads and writes.
                unsafe { multiply(level, &product) };
                let times = if accumulate { 2.0 } else { 1.0 };
                for row in 0..ROWS {
                    for col in 0..PANEL {
                        let exact: f64 = (0..total)
                            .map(|k| f64::from(a[row * total + k]) * f64::from(panel[k * PANEL + col]))
                            .sum();
                        let found = f64::from(tile[row * 80 + col]);
                        assert!((found - times * exact).abs() < ROUNDING * times, "{level:?} {row} {col}");
                    }
                }
            }
        }
    }
}
