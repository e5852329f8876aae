//! Products of a few descriptors with many at once.
//!
//! Written with the machine's instructions: the plain loop vectorises at one level of optimisation and not at the next. All forms
//! add in the same order without fused operations, so that they agree to the last bit.
#![allow(unsafe_code, reason = "functions of an instruction set may be called where the machine has it")]

use crate::features::sift::{DESCRIPTOR_LEN, Descriptor};

/// Descriptors of B multiplied together, side by side.
pub(super) const COLUMNS: usize = 32;

/// Descriptors of A multiplied together: with the columns above their sums stay in registers.
pub(super) const ROWS: usize = 4;

/// Columns of descriptors, entry by entry: `[entry][column]`.
pub(super) type Panel = [[f32; COLUMNS]; DESCRIPTOR_LEN];

/// One product for each row and column.
pub(super) type Products = [[f32; COLUMNS]; ROWS];

/// Products of four descriptors with a panel.
pub(super) fn products(a: [&Descriptor; ROWS], panel: &Panel) -> Products {
    let mut out = [[0.0; COLUMNS]; ROWS];
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            // SAFETY: the machine has the instructions, as just asked.
            unsafe { x86::avx512(a, panel, &mut out) };
            return out;
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: as above.
            unsafe { x86::avx2(a, panel, &mut out) };
            return out;
        }
    }
    plain(a, panel, &mut out);
    out
}

fn plain(a: [&Descriptor; ROWS], panel: &Panel, out: &mut Products) {
    for (k, entries) in panel.iter().enumerate() {
        for (row, sums) in a.iter().zip(out.iter_mut()) {
            for (sum, entry) in sums.iter_mut().zip(entries) {
                *sum += row[k] * entry;
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{COLUMNS, Descriptor, Panel, Products, ROWS};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx512f")]
    pub(super) fn avx512(a: [&Descriptor; ROWS], panel: &Panel, out: &mut Products) {
        let mut sums = [[_mm512_setzero_ps(); COLUMNS / 16]; ROWS];
        for (k, entries) in panel.iter().enumerate() {
            // SAFETY: the columns hold two registers of 16.
            let entries =
                unsafe { [_mm512_loadu_ps(entries.as_ptr()), _mm512_loadu_ps(entries.as_ptr().add(16))] };
            for r in 0..ROWS {
                let factor = _mm512_set1_ps(a[r][k]);
                sums[r][0] = _mm512_add_ps(sums[r][0], _mm512_mul_ps(factor, entries[0]));
                sums[r][1] = _mm512_add_ps(sums[r][1], _mm512_mul_ps(factor, entries[1]));
            }
        }
        for (sums, out) in sums.iter().zip(out) {
            // SAFETY: as above.
            unsafe {
                _mm512_storeu_ps(out.as_mut_ptr(), sums[0]);
                _mm512_storeu_ps(out.as_mut_ptr().add(16), sums[1]);
            }
        }
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn avx2(a: [&Descriptor; ROWS], panel: &Panel, out: &mut Products) {
        // Half the columns at a time: eight sums, two columns and a factor fit sixteen registers.
        for half in [0, COLUMNS / 2] {
            let mut sums = [[_mm256_setzero_ps(); 2]; ROWS];
            for (k, entries) in panel.iter().enumerate() {
                // SAFETY: from either half, the columns hold two registers of 8.
                let entries = unsafe {
                    let first = entries.as_ptr().add(half);
                    [_mm256_loadu_ps(first), _mm256_loadu_ps(first.add(8))]
                };
                for r in 0..ROWS {
                    let factor = _mm256_set1_ps(a[r][k]);
                    sums[r][0] = _mm256_add_ps(sums[r][0], _mm256_mul_ps(factor, entries[0]));
                    sums[r][1] = _mm256_add_ps(sums[r][1], _mm256_mul_ps(factor, entries[1]));
                }
            }
            for (sums, out) in sums.iter().zip(out.iter_mut()) {
                // SAFETY: as above.
                unsafe {
                    let first = out.as_mut_ptr().add(half);
                    _mm256_storeu_ps(first, sums[0]);
                    _mm256_storeu_ps(first.add(8), sums[1]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let number = |i: usize| ((i * 7919) % 1009) as f32 / 1009.0;
        let rows: [Descriptor; ROWS] =
            std::array::from_fn(|r| std::array::from_fn(|k| number(r * 131 + k * 17)));
        let panel: Panel = std::array::from_fn(|k| std::array::from_fn(|j| number(k * 37 + j * 5 + 3)));
        let a = std::array::from_fn(|r| &rows[r]);
        let mut expected = [[0.0; COLUMNS]; ROWS];
        plain(a, &panel, &mut expected);
        assert_eq!(products(a, &panel), expected);
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            let mut narrow = [[0.0; COLUMNS]; ROWS];
            // SAFETY: the machine has the instructions, as just asked.
            unsafe { x86::avx2(a, &panel, &mut narrow) };
            assert_eq!(narrow, expected);
        }
    }
}
