//! The kernel without special instructions: what the compiler makes of short fixed loops.

use super::product::{PANEL, Product, ROWS};

const COLUMNS: usize = 8;

/// # Safety
/// As [`super::multiply`].
pub(super) unsafe fn multiply(product: &Product<'_>) {
    for first in (0..PANEL).step_by(COLUMNS) {
        for pair in (0..ROWS).step_by(2) {
            // SAFETY: a part of the rows, the panel and the tile that the caller promised.
            unsafe { multiply_part(product, first, pair) };
        }
    }
}

/// Two rows times eight columns: as many sums as sixteen 128-bit registers hold.
///
/// # Safety
/// As [`super::multiply`].
unsafe fn multiply_part(product: &Product<'_>, first: usize, pair: usize) {
    let mut acc = [[0.0_f32; COLUMNS]; 2];
    // SAFETY: all addresses lie in what the caller promised.
    unsafe {
        let tile = product.tile.add(pair * product.stride + first);
        if product.accumulate {
            for row in 0..2 {
                for col in 0..COLUMNS {
                    acc[row][col] = *tile.add(row * product.stride + col);
                }
            }
        }
        let mut panel = product.panel.add(first);
        for (idx, len) in product.segments.iter().enumerate() {
            let rows = product.rows.as_ptr().add(idx * ROWS + pair);
            let from = [*rows, *rows.add(1)];
            for k in 0..*len {
                for row in 0..2 {
                    let value = *from[row].add(k);
                    for col in 0..COLUMNS {
                        acc[row][col] += value * *panel.add(col);
                    }
                }
                panel = panel.add(PANEL);
            }
        }
        for row in 0..2 {
            for col in 0..COLUMNS {
                *tile.add(row * product.stride + col) = acc[row][col];
            }
        }
    }
}
