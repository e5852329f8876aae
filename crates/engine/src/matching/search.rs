//! The nearest of many descriptors: the largest dot product, the first index among equals.
//!
//! Targets are packed in tiles of 8 × 8 pixels. A tile is skipped when no descriptor in the ball around it
//! can win; what is left is multiplied 6 × 64 at a time and only compared, never stored.

use rayon::prelude::*;

use crate::buffer::Buffer;
use crate::kernel::{PANEL, Product, ROWS, Simd, multiply};
use crate::matching::screen::{Asked, Screen};
use crate::vector::{MulAdd, per_level};

/// Side of a tile: 64 pixels fill a panel.
const SIDE: usize = 8;
/// Queries of a task: their bounds for 64 tiles stay in the first-level cache.
const TASK_QUERIES: usize = 16 * ROWS;
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
    /// How far a descriptor lies from its tile's mean, at most; less than nothing for what is no tile.
    radii: Vec<f32>,
    /// Length of the longest descriptor.
    longest: f32,
    screen: Option<Screen>,
}

impl Targets {
    pub(super) fn new(level: Simd, descriptors: &[f32], (height, width): (usize, usize), dim: usize) -> Self {
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
        radii.resize(num_tiles.next_multiple_of(PANEL), f32::NEG_INFINITY);
        let mut centers = Buffer::zeroed(num_tiles.next_multiple_of(PANEL) * dim);
        for (tile, mean) in means.chunks_exact(dim).enumerate() {
            for (k, value) in mean.iter().enumerate() {
                centers[(tile / PANEL * dim + k) * PANEL + tile % PANEL] = *value;
            }
        }
        let lengths = descriptors.chunks_exact(dim).map(length).filter(|length| length.is_finite());
        let longest = lengths.fold(0.0, f32::max);
        let screen = Screen::new(level, &panels, dim, longest);
        Self { dim, panels, pixels, centers, radii, longest, screen }
    }

    /// For each query (a pixel of `descriptors`) the pixel with the largest dot product.
    pub(super) fn nearest(&self, level: Simd, descriptors: &[f32], queries: &[u32], out: &mut [u32]) {
        let tasks = queries.par_chunks(TASK_QUERIES).zip(out.par_chunks_mut(TASK_QUERIES));
        tasks.with_max_len(1).for_each(|(queries, out)| {
            let row = |query: &u32| &descriptors[*query as usize * self.dim..][..self.dim];
            let mut queries: Vec<Query<'_>> = queries.iter().map(|query| self.query(row(query))).collect();
            self.start(level, &mut queries);
            self.search(level, &mut queries);
            for (query, out) in queries.iter().zip(out) {
                *out = query.pixel;
            }
        });
    }

    fn query<'q>(&self, row: &'q [f32]) -> Query<'q> {
        let length = length(row);
        let margin = MARGIN * length * self.longest;
        let asked = self.screen.as_ref().map(|screen| screen.ask(row, length, margin)).unwrap_or_default();
        Query { row, length, margin, asked, value: f32::NEG_INFINITY, pixel: NONE }
    }

    /// The most promising tile of each query first: what it gives rules out most others.
    fn start(&self, level: Simd, queries: &mut [Query<'_>]) {
        let mut bounds = Products([[0.0; PANEL]; ROWS]);
        let mut tops = [(f32::NEG_INFINITY, 0); TASK_QUERIES];
        for (strip, tops) in queries.chunks(ROWS).zip(tops.chunks_mut(ROWS)) {
            for block in 0..self.radii.len() / PANEL {
                self.bound(level, strip, block, &mut bounds.0);
                for (top, bounds) in tops.iter_mut().zip(&bounds.0) {
                    if !reaches(level, bounds, top.0) {
                        continue;
                    }
                    for (tile, bound) in bounds.iter().enumerate() {
                        if *bound > top.0 {
                            *top = (*bound, block * PANEL + tile);
                        }
                    }
                }
            }
        }
        for (idx, (_, tile)) in tops[..queries.len()].iter().enumerate() {
            self.visit(level, queries, &[idx], *tile);
        }
    }

    /// Visits each tile with the queries that may find something better there: it is read from memory once for
    /// all of a task's.
    fn search(&self, level: Simd, queries: &mut [Query<'_>]) {
        let mut bounds = Products([[0.0; PANEL]; TASK_QUERIES]);
        let mut hopeful = [0; TASK_QUERIES];
        for block in 0..self.radii.len() / PANEL {
            let mut any = false;
            for (strip, bounds) in queries.chunks(ROWS).zip(bounds.0.as_chunks_mut::<ROWS>().0) {
                self.bound(level, strip, block, bounds);
                for (query, bounds) in strip.iter().zip(bounds) {
                    any |= reaches(level, bounds, query.value);
                }
            }
            let num_tiles = PANEL.min(self.pixels.len() / PANEL - block * PANEL);
            for tile in (0..num_tiles).take_while(|_| any) {
                let mut count = 0;
                for (idx, (query, bounds)) in queries.iter().zip(&bounds.0).enumerate() {
                    hopeful[count] = idx;
                    count += usize::from(bounds[tile] >= query.value);
                }
                let (tile, mut hopeful) = (block * PANEL + tile, &mut hopeful[..count]);
                if let Some(screen) = &self.screen {
                    let count = screen.sift(tile, |idx| &queries[idx].asked, hopeful);
                    hopeful = &mut hopeful[..count];
                }
                for group in hopeful.chunks(ROWS) {
                    self.visit(level, queries, group, tile);
                }
            }
        }
    }

    /// No descriptor of the block's tiles has a larger product with the queries, of which there are six at most.
    fn bound(&self, level: Simd, queries: &[Query<'_>], block: usize, bounds: &mut [[f32; PANEL]; ROWS]) {
        let rows = std::array::from_fn(|idx| queries[idx.min(queries.len() - 1)].row);
        self.multiply(level, rows, &self.centers[block * PANEL * self.dim..], bounds);
        for (query, bounds) in queries.iter().zip(bounds) {
            widen(level, bounds, &self.radii[block * PANEL..], query.length, query.margin);
        }
    }

    /// Compares a tile's descriptors with six queries at most, given by their indices.
    fn visit(&self, level: Simd, queries: &mut [Query<'_>], group: &[usize], tile: usize) {
        let mut products = Products([[0.0; PANEL]; ROWS]);
        let rows = std::array::from_fn(|idx| queries[group[idx.min(group.len() - 1)]].row);
        self.multiply(level, rows, &self.panels[tile * PANEL * self.dim..], &mut products.0);
        let pixels = &self.pixels[tile * PANEL..][..PANEL];
        for (idx, products) in group.iter().zip(&products.0) {
            let query = &mut queries[*idx];
            if reaches(level, products, query.value) {
                query.update(products, pixels);
            }
        }
    }

    /// Products of six descriptors with the first panel of `panels`.
    fn multiply(&self, level: Simd, rows: [&[f32]; ROWS], panels: &[f32], out: &mut [[f32; PANEL]; ROWS]) {
        debug_assert!(rows.iter().all(|row| row.len() == self.dim));
        let product = Product {
            rows: &rows.map(<[f32]>::as_ptr),
            segments: &[self.dim],
            panel: panels[..PANEL * self.dim].as_ptr(),
            tile: out.as_flattened_mut().as_mut_ptr(),
            stride: PANEL,
            accumulate: false,
        };
        // SAFETY: rows are descriptors of `dim` values, the panel has `dim` lines, the tile its six rows; the
        // level is one the caller has checked.
        unsafe { multiply(level, &product) };
    }
}

#[repr(align(64))]
struct Products<const N: usize>([[f32; PANEL]; N]);

/// A descriptor, and the best that has been found for it.
struct Query<'a> {
    row: &'a [f32],
    length: f32,
    /// What rounding may add to its products.
    margin: f32,
    asked: Asked,
    value: f32,
    pixel: u32,
}

impl Query<'_> {
    fn update(&mut self, products: &[f32; PANEL], pixels: &[u32]) {
        for (product, pixel) in products.iter().zip(pixels).filter(|(_, pixel)| **pixel != NONE) {
            let better = *product > self.value;
            if better || (*product == self.value && *pixel < self.pixel) {
                self.value = *product;
                self.pixel = *pixel;
            }
        }
        self.asked.raise(self.value);
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
fn widen_body<M: MulAdd>(bounds: &mut [f32; PANEL], radii: &[f32], length: f32, margin: f32) {
    for (bound, radius) in bounds.iter_mut().zip(radii) {
        *bound = M::mul_add(*radius, length, *bound + margin);
    }
}
per_level! {
    /// From dot products with centres to bounds of those with anything in the balls around them.
    widen = widen_body(bounds: &mut [f32; PANEL], radii: &[f32], length: f32, margin: f32)
}
