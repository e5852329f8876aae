//! The kernel in 256-bit vectors: sixteen of the panel's columns at a time, 12 accumulators.

use std::arch::x86_64::{
    _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_storeu_ps,
};

use super::product::{PANEL, Product, ROWS};

const VECTORS: usize = 2;
const COLUMNS: usize = 16;

/// # Safety
/// As [`super::multiply`].
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn multiply(product: &Product<'_>) {
    for first in (0..PANEL).step_by(COLUMNS) {
        // SAFETY: columns `first..first + 16` of the panel and the tile the caller promised.
        unsafe { multiply_columns(product, first) };
    }
}

/// # Safety
/// As [`super::multiply`]; `first + 16 <= 64`.
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn multiply_columns(product: &Product<'_>, first: usize) {
    let mut acc = [[_mm256_setzero_ps(); VECTORS]; ROWS];
    // SAFETY: all addresses lie in what the caller promised.
    unsafe {
        let tile = product.tile.add(first);
        if product.accumulate {
            for row in 0..ROWS {
                for vec in 0..VECTORS {
                    acc[row][vec] = _mm256_loadu_ps(tile.add(row * product.stride + vec * 8));
                }
            }
        }
        let mut panel = product.panel.add(first);
        for (idx, len) in product.segments.iter().enumerate() {
            let rows = product.rows.as_ptr().add(idx * ROWS);
            let from = [*rows, *rows.add(1), *rows.add(2), *rows.add(3), *rows.add(4), *rows.add(5)];
            for k in 0..*len {
                let line = [_mm256_loadu_ps(panel), _mm256_loadu_ps(panel.add(8))];
                for row in 0..ROWS {
                    let value = _mm256_set1_ps(*from[row].add(k));
                    acc[row][0] = _mm256_fmadd_ps(value, line[0], acc[row][0]);
                    acc[row][1] = _mm256_fmadd_ps(value, line[1], acc[row][1]);
                }
                panel = panel.add(PANEL);
            }
        }
        for row in 0..ROWS {
            for vec in 0..VECTORS {
                _mm256_storeu_ps(tile.add(row * product.stride + vec * 8), acc[row][vec]);
            }
        }
    }
}
