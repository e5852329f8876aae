//! The nearest of many descriptors: the largest dot product, the first index among equals.
//!
//! Targets are packed in tiles of 8 × 8 pixels. A tile is skipped when no descriptor in the ball around it
//! can win; what is left is multiplied 6 × 64 at a time and only compared, never stored.

use rayon::prelude::*;

use crate::buffer::{Buffer, with_scratch};
use crate::kernel::{PANEL, Product, ROWS, Simd, multiply};
use crate::vector::{MulAdd, per_level};

/// Side of a tile: 64 pixels fill a panel.
const SIDE: usize = 8;
/// Queries of a task.
const TASK_QUERIES: usize = 4 * ROWS;
/// Rounding of a bound, relative to the lengths of both descriptors.
const MARGIN: f32 = 1e-5;
/// A lane without a pixel, a query without an answer yet.
pub(super) const NONE: u32 = u32::MAX;

/// An image's descriptors, packed to be searched.
pub(super) struct Targets {
    dim: usize,
    panels: Buffer,
    /// Pixel of each lane.
    pixels: Vec<u32>,
    /// Means of the tiles, packed like targets.
    centers: Buffer,
    /// How far a descriptor lies from its tile's mean, at most.
    radii: Vec<f32>,
    /// Length of the longest descriptor.
    longest: f32,
}

impl Targets {
    pub(super) fn new(descriptors: &[f32], (height, width): (usize, usize), dim: usize) -> Self {
        let tiles_per_row = width.div_ceil(SIDE);
        let num_tiles = tiles_per_row * height.div_ceil(SIDE);
        let mut panels = Buffer::zeroed(num_tiles * PANEL * dim);
        let mut pixels = vec![NONE; num_tiles * PANEL];
        let mut means = vec![0.0_f32; num_tiles * dim];
        let mut radii = vec![0.0_f32; num_tiles];
        let parts = panels.par_chunks_mut(PANEL * dim).zip(pixels.par_chunks_mut(PANEL));
        let rest = means.par_chunks_mut(dim).zip(radii.par_iter_mut());
        parts.zip(rest).enumerate().for_each(|(tile, ((panel, pixels), (mean, radius)))| {
            let (top, left) = (tile / tiles_per_row * SIDE, tile % tiles_per_row * SIDE);
            let (rows, cols) = (SIDE.min(height - top), SIDE.min(width - left));
            let of = |pixel: usize| &descriptors[pixel * dim..][..dim];
            let inside = (0..rows).flat_map(|y| (0..cols).map(move |x| (top + y) * width + left + x));
            // What is not a number is nobody's nearest, and would spoil its tile's mean.
            let usable = inside.filter(|pixel| of(*pixel).iter().all(|v| v.is_finite()));
            for (lane, pixel) in usable.enumerate() {
                pixels[lane] = pixel as u32;
                for (k, value) in of(pixel).iter().enumerate() {
                    panel[k * PANEL + lane] = *value;
                    mean[k] += value / (rows * cols) as f32;
                }
            }
            for pixel in pixels.iter().filter(|pixel| **pixel != NONE) {
                let squared: f32 =
                    of(*pixel as usize).iter().zip(mean.iter()).map(|(a, b)| (a - b) * (a - b)).sum();
                *radius = radius.max(squared.sqrt());
            }
        });
        let mut centers = Buffer::zeroed(num_tiles.next_multiple_of(PANEL) * dim);
        for (tile, mean) in means.chunks_exact(dim).enumerate() {
            for (k, value) in mean.iter().enumerate() {
                centers[(tile / PANEL * dim + k) * PANEL + tile % PANEL] = *value;
            }
        }
        let lengths = descriptors.chunks_exact(dim).map(length).filter(|length| length.is_finite());
        let longest = lengths.fold(0.0, f32::max);
        Self { dim, panels, pixels, centers, radii, longest }
    }

    /// For each query (a pixel of `descriptors`) the pixel with the largest dot product.
    pub(super) fn nearest(&self, level: Simd, descriptors: &[f32], queries: &[u32], out: &mut [u32]) {
        let tasks = queries.par_chunks(TASK_QUERIES).zip(out.par_chunks_mut(TASK_QUERIES));
        tasks.with_max_len(1).for_each(|(queries, out)| {
            with_scratch(ROWS * self.radii.len().next_multiple_of(PANEL), |bounds| {
                for (queries, out) in queries.chunks(ROWS).zip(out.chunks_mut(ROWS)) {
                    let found = self.search(level, descriptors, queries, bounds);
                    out.copy_from_slice(&found[..queries.len()]);
                }
            });
        });
    }

    fn search(&self, level: Simd, descriptors: &[f32], queries: &[u32], bounds: &mut [f32]) -> [u32; ROWS] {
        let num_tiles = self.radii.len();
        let width = num_tiles.next_multiple_of(PANEL);
        let rows = std::array::from_fn(|idx| {
            let query = queries[idx.min(queries.len() - 1)] as usize;
            &descriptors[query * self.dim..][..self.dim]
        });
        let pointers = rows.map(<[f32]>::as_ptr);
        for (block, panel) in self.centers.chunks_exact(PANEL * self.dim).enumerate() {
            let tile = &mut bounds[block * PANEL..][..(ROWS - 1) * width + PANEL];
            self.multiply(level, &pointers, panel, tile, width);
        }
        let mut best = Best { values: [f32::NEG_INFINITY; ROWS], pixels: [NONE; ROWS] };
        for (row, bounds) in rows.iter().zip(bounds.chunks_exact_mut(width)) {
            let own = length(row);
            let margin = MARGIN * own * self.longest;
            widen(level, &mut bounds[..num_tiles], &self.radii, own, margin);
        }
        // The most promising tile of each query first: what it gives rules out most others.
        for bounds in bounds.chunks_exact(width) {
            let mut top = 0;
            for (tile, bound) in bounds[..num_tiles].iter().enumerate() {
                if *bound > bounds[top] {
                    top = tile;
                }
            }
            self.visit(level, &pointers, top, &mut best);
        }
        for tile in 0..num_tiles {
            if (0..ROWS).any(|row| bounds[row * width + tile] >= best.values[row]) {
                self.visit(level, &pointers, tile, &mut best);
            }
        }
        best.pixels
    }

    fn visit(&self, level: Simd, rows: &[*const f32; ROWS], tile: usize, best: &mut Best) {
        let mut products = Products([[0.0; PANEL]; ROWS]);
        let panel = &self.panels[tile * PANEL * self.dim..][..PANEL * self.dim];
        self.multiply(level, rows, panel, products.0.as_flattened_mut(), PANEL);
        let pixels = &self.pixels[tile * PANEL..][..PANEL];
        for (row, products) in products.0.iter().enumerate() {
            if reaches(level, products, best.values[row]) {
                best.update(row, products, pixels);
            }
        }
    }

    fn multiply(
        &self,
        level: Simd,
        rows: &[*const f32; ROWS],
        panel: &[f32],
        tile: &mut [f32],
        stride: usize,
    ) {
        debug_assert!(tile.len() >= (ROWS - 1) * stride + PANEL && panel.len() == PANEL * self.dim);
        let product = Product {
            rows,
            segments: &[self.dim],
            panel: panel.as_ptr(),
            tile: tile.as_mut_ptr(),
            stride,
            accumulate: false,
        };
        // SAFETY: rows are descriptors of `dim` values, the panel has `dim` lines, the tile its six rows; the
        // level is one the caller has checked.
        unsafe { multiply(level, &product) };
    }
}

#[repr(align(64))]
struct Products([[f32; PANEL]; ROWS]);

struct Best {
    values: [f32; ROWS],
    pixels: [u32; ROWS],
}

impl Best {
    fn update(&mut self, row: usize, products: &[f32; PANEL], pixels: &[u32]) {
        for (product, pixel) in products.iter().zip(pixels).filter(|(_, pixel)| **pixel != NONE) {
            let better = *product > self.values[row];
            if better || (*product == self.values[row] && *pixel < self.pixels[row]) {
                self.values[row] = *product;
                self.pixels[row] = *pixel;
            }
        }
    }
}

fn length(row: &[f32]) -> f32 {
    row.iter().map(|v| v * v).sum::<f32>().sqrt()
}

#[inline(always)]
fn reaches_body<M: MulAdd>(values: &[f32; PANEL], bar: f32) -> bool {
    let mut tops = [f32::NEG_INFINITY; 16];
    for chunk in values.as_chunks::<16>().0 {
        for (top, value) in tops.iter_mut().zip(chunk) {
            *top = if *value > *top { *value } else { *top };
        }
    }
    let mut hits = 0_u32;
    for top in tops {
        hits += u32::from(top >= bar);
    }
    hits > 0
}
per_level! {
    /// Whether any value is as large as `bar`.
    reaches = reaches_body(values: &[f32; PANEL], bar: f32) -> bool
}

#[inline(always)]
fn widen_body<M: MulAdd>(bounds: &mut [f32], radii: &[f32], length: f32, margin: f32) {
    for (bound, radius) in bounds.iter_mut().zip(radii) {
        *bound = M::mul_add(*radius, length, *bound + margin);
    }
}
per_level! {
    /// From dot products with centres to bounds of those with anything in the balls around them.
    widen = widen_body(bounds: &mut [f32], radii: &[f32], length: f32, margin: f32)
}
