//! Nearest neighbours of unit vectors: a blocked product of two matrices, of which only the largest entries are kept.
#![allow(clippy::needless_range_loop, reason = "arrays of one fixed length side by side: what vectorises")]

use super::nearest::{Nearest, Neighbours};
use super::tile::{COLUMNS, Panel, Products, ROWS, products};
use crate::dispatch::widest;
use crate::features::sift::{DESCRIPTOR_LEN, Descriptor};
use rayon::prelude::*;

/// Descriptors of A of one piece of work.
const CHUNK: usize = 128;

/// The largest and second largest product of each of a few rows, lane by lane.
#[derive(Clone, Copy)]
struct RowBest {
    best: [f32; COLUMNS],
    second: [f32; COLUMNS],
    panel: [u32; COLUMNS],
}

/// The largest product of each column.
#[derive(Clone)]
struct ColumnBest {
    best: Vec<[f32; COLUMNS]>,
    row: Vec<[u32; COLUMNS]>,
}

pub(super) fn neighbours(a: &[Descriptor], b: &[Descriptor]) -> Neighbours {
    let panels: Vec<Box<Panel>> = b.par_chunks(COLUMNS).map(panel).collect();
    let chunks: Vec<(Vec<Nearest>, ColumnBest)> = a
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(i, rows)| {
            let mut columns = ColumnBest {
                best: vec![[f32::NEG_INFINITY; COLUMNS]; panels.len()],
                row: vec![[0; COLUMNS]; panels.len()],
            };
            let mut of_a = Vec::with_capacity(rows.len());
            for (j, rows) in rows.chunks(ROWS).enumerate() {
                let first = (i * CHUNK + j * ROWS) as u32;
                multiply(rows, &panels, first, &mut columns, &mut of_a);
            }
            (of_a, columns)
        })
        .collect();
    let mut of_a = Vec::with_capacity(a.len());
    let mut of_b = vec![(f32::NEG_INFINITY, 0u32); panels.len() * COLUMNS];
    for (rows, columns) in chunks {
        of_a.extend(rows);
        let found = columns.best.as_flattened().iter().zip(columns.row.as_flattened());
        for (merged, (&best, &row)) in of_b.iter_mut().zip(found) {
            if best > merged.0 {
                *merged = (best, row);
            }
        }
    }
    Neighbours { of_a, of_b: of_b.into_iter().take(b.len()).map(|(_, row)| row).collect() }
}

/// Up to [`COLUMNS`] descriptors side by side; what is missing is zero, whose product with any descriptor is the least.
fn panel(descriptors: &[Descriptor]) -> Box<Panel> {
    let mut panel = Box::new([[0.0; COLUMNS]; DESCRIPTOR_LEN]);
    for (column, descriptor) in descriptors.iter().enumerate() {
        for (entries, &entry) in panel.iter_mut().zip(descriptor) {
            entries[column] = entry;
        }
    }
    panel
}

/// All products of up to [`ROWS`] descriptors with all panels.
fn multiply(
    rows: &[Descriptor],
    panels: &[Box<Panel>],
    first: u32,
    columns: &mut ColumnBest,
    of_a: &mut Vec<Nearest>,
) {
    // The last row stands in for missing ones; their results are dropped.
    let last = rows.len() - 1;
    let a = std::array::from_fn(|r| &rows[r.min(last)]);
    let idx: [u32; ROWS] = std::array::from_fn(|r| first + r.min(last) as u32);
    let none = RowBest { best: [-1.0; COLUMNS], second: [-1.0; COLUMNS], panel: [0; COLUMNS] };
    let mut found = [none; ROWS];
    for (p, panel) in panels.iter().enumerate() {
        let products = products(a, panel);
        for r in 0..ROWS {
            update(&products, r, p as u32, idx[r], &mut found[r], &mut columns.best[p], &mut columns.row[p]);
        }
    }
    of_a.extend(found[..rows.len()].iter().map(nearest));
}

widest! {
    /// Keeps what is larger than before, for a row and for each column.
    fn update(
        products: &Products, r: usize, panel: u32, idx: u32,
        found: &mut RowBest, best: &mut [f32; COLUMNS], row: &mut [u32; COLUMNS],
    ) = update_body
}

#[inline(always)]
fn update_body(
    products: &Products,
    r: usize,
    panel: u32,
    idx: u32,
    found: &mut RowBest,
    best: &mut [f32; COLUMNS],
    row: &mut [u32; COLUMNS],
) {
    let products = &products[r];
    for j in 0..COLUMNS {
        let v = products[j];
        let larger = v > found.best[j];
        found.second[j] = found.second[j].max(if larger { found.best[j] } else { v });
        found.best[j] = if larger { v } else { found.best[j] };
        found.panel[j] = if larger { panel } else { found.panel[j] };
    }
    for j in 0..COLUMNS {
        let larger = products[j] > best[j];
        best[j] = if larger { products[j] } else { best[j] };
        row[j] = if larger { idx } else { row[j] };
    }
}

/// The best of all lanes, and how it compares with the second best.
fn nearest(found: &RowBest) -> Nearest {
    let mut lane = 0;
    for j in 1..COLUMNS {
        let (v, best) = (found.best[j], found.best[lane]);
        if v > best || (v == best && found.panel[j] < found.panel[lane]) {
            lane = j;
        }
    }
    let mut second = found.second[lane];
    for j in 0..COLUMNS {
        if j != lane {
            second = second.max(found.best[j]);
        }
    }
    // |x − y|² = 2 − 2 x·y for unit vectors.
    let distance2 = |product: f32| f64::from(2.0 - 2.0 * product).max(0.0);
    let (near, far) = (distance2(found.best[lane]), distance2(second));
    Nearest {
        idx: found.panel[lane] * COLUMNS as u32 + lane as u32,
        ratio: if far > 0.0 { (near / far).sqrt().min(1.0) } else { 1.0 },
    }
}
