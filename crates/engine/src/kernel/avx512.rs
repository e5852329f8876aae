//! The kernel in 512-bit vectors: 24 accumulators, four loads and six broadcasts per step.

use std::arch::x86_64::{
    __m512, _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_setzero_ps, _mm512_storeu_ps,
};

use super::product::{PANEL, Product, ROWS};

const VECTORS: usize = 4;

/// # Safety
/// As [`super::multiply`].
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn multiply(product: &Product<'_>) {
    let mut acc = [[_mm512_setzero_ps(); VECTORS]; ROWS];
    // SAFETY: all addresses lie in what the caller promised.
    unsafe {
        if product.accumulate {
            for row in 0..ROWS {
                for vec in 0..VECTORS {
                    acc[row][vec] = _mm512_loadu_ps(product.tile.add(row * product.stride + vec * 16));
                }
            }
        }
        let mut panel = product.panel;
        for (idx, len) in product.segments.iter().enumerate() {
            let rows = product.rows.as_ptr().add(idx * ROWS);
            let from = [*rows, *rows.add(1), *rows.add(2), *rows.add(3), *rows.add(4), *rows.add(5)];
            for k in 0..*len {
                step(&mut acc, from, k, panel);
                panel = panel.add(PANEL);
            }
        }
        for row in 0..ROWS {
            for vec in 0..VECTORS {
                _mm512_storeu_ps(product.tile.add(row * product.stride + vec * 16), acc[row][vec]);
            }
        }
    }
}

/// One value of each row times one line of the panel.
///
/// # Safety
/// `from[·] + k` and 64 values at `panel` can be read.
#[inline]
#[target_feature(enable = "avx512f")]
unsafe fn step(acc: &mut [[__m512; VECTORS]; ROWS], from: [*const f32; ROWS], k: usize, panel: *const f32) {
    // SAFETY: the caller's promise.
    unsafe {
        let line = [
            _mm512_loadu_ps(panel),
            _mm512_loadu_ps(panel.add(16)),
            _mm512_loadu_ps(panel.add(32)),
            _mm512_loadu_ps(panel.add(48)),
        ];
        for row in 0..ROWS {
            let value = _mm512_set1_ps(*from[row].add(k));
            for vec in 0..VECTORS {
                acc[row][vec] = _mm512_fmadd_ps(value, line[vec], acc[row][vec]);
            }
        }
    }
}
