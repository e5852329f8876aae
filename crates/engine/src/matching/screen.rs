//! Products of bytes that rule out most of what products of floats would only confirm to be worse.
//!
//! Descriptors are rounded to signed bytes, four to a lane. A product of the rounded ones differs from the exact one by
//! no more than the lengths of what was rounded off allow; only tiles in which it comes that near to the best are looked
//! at in f32, so that the result is the same to the last bit.

use rayon::prelude::*;

use crate::buffer::Buffer;
use crate::kernel::{PANEL, ROWS, Simd};
use crate::vector::{MulAdd, per_level};

/// Numbers in a lane.
const BYTES: usize = 4;
/// Lanes of the longest descriptor: 32 numbers.
const MAX_LINES: usize = 8;
/// The largest byte.
const TOP: f32 = 127.0;
/// Added to the query's bytes, which the instruction takes as unsigned.
const SHIFT: i32 = 128;
/// Added to a small number it leaves the nearest integer in the low bits.
const ROUNDER: f32 = 12_582_912.0;
/// Where all numbers are zero: something to divide by.
const SMALLEST: f32 = 1e-20;

/// Panels of bytes.
pub(super) struct Screen {
    /// Per panel: what takes the shift back, then the lanes of each four numbers.
    panels: Buffer,
    num_lines: usize,
    /// Value of a step.
    step: f32,
    /// Length of the longest descriptor, and of the most that was rounded off one.
    longest: f32,
    rest: f32,
}

/// A query in bytes.
#[derive(Clone, Copy, Default)]
pub(super) struct Asked {
    bytes: [i32; MAX_LINES],
    /// Value of a product of one.
    unit: f32,
    /// How far a product may be from the exact one.
    error: f32,
    /// Smaller products have nothing to offer.
    threshold: i32,
}

impl Asked {
    /// Products that may be as large as `best` are wanted.
    pub(super) fn raise(&mut self, best: f32) {
        let threshold = ((best - self.error) / self.unit).floor();
        // One less, for the rounding of the division; of what is no number everything is wanted.
        self.threshold = if threshold.is_finite() { (threshold as i32).saturating_sub(1) } else { i32::MIN };
    }
}

impl Screen {
    /// From panels of `dim` lines; `None` where the processor has no such instructions.
    pub(super) fn new(level: Simd, floats: &[f32], dim: usize, longest: f32) -> Option<Self> {
        let num_lines = dim.div_ceil(BYTES);
        if !is_present(level) || num_lines > MAX_LINES {
            return None;
        }
        let sizes = floats.par_chunks(dim * PANEL).map(|panel| largest(level, panel));
        let step = sizes.reduce(|| SMALLEST, f32::max) / TOP;
        let mut panels = Buffer::zeroed(floats.len() / dim * (num_lines + 1));
        let parts = panels.par_chunks_mut((num_lines + 1) * PANEL).zip(floats.par_chunks(dim * PANEL));
        let rests = parts.map(|(panel, floats)| pack(level, panel, floats, step));
        let rest = rests.reduce(|| 0.0, f32::max).sqrt();
        Some(Self { panels, num_lines, step, longest, rest })
    }

    /// Rounds a query of this length; `margin` is added to what its products may be off.
    pub(super) fn ask(&self, row: &[f32], length: f32, margin: f32) -> Asked {
        let step = row.iter().fold(SMALLEST, |size, value| size.max(value.abs())) / TOP;
        let mut bytes = [[SHIFT as u8; BYTES]; MAX_LINES];
        let mut rest = 0.0;
        for (byte, value) in bytes.as_flattened_mut().iter_mut().zip(row) {
            let rounded = round(value / step);
            rest += (value - rounded as f32 * step).powi(2);
            *byte = (rounded + SHIFT) as u8;
        }
        let error = rest.sqrt() * (self.longest + self.rest) + length * self.rest + margin;
        let bytes = bytes.map(i32::from_le_bytes);
        Asked { bytes, unit: step * self.step, error, threshold: i32::MIN }
    }

    /// Keeps those queries, given by their indices, that may find in a tile what they want: moves them to the front
    /// and returns how many.
    pub(super) fn sift<'q>(
        &self,
        tile: usize,
        asked: impl Fn(usize) -> &'q Asked,
        indices: &mut [usize],
    ) -> usize {
        let size = (self.num_lines + 1) * PANEL;
        let panel = &self.panels[tile * size..][..size];
        let mut kept = 0;
        for first in (0..indices.len()).step_by(ROWS) {
            let count = ROWS.min(indices.len() - first);
            let group: [usize; ROWS] = std::array::from_fn(|row| indices[first + row.min(count - 1)]);
            let hits = reached(panel, self.num_lines, &group.map(&asked));
            for (row, idx) in group.into_iter().enumerate().take(count) {
                indices[kept] = idx;
                kept += usize::from(hits[row]);
            }
        }
        kept
    }
}

/// Whether the level comes with products of bytes.
fn is_present(level: Simd) -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        level == Simd::Avx512 && is_x86_feature_detected!("avx512vnni")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = level;
        false
    }
}

#[inline(always)]
fn round(value: f32) -> i32 {
    ((value + ROUNDER).to_bits() as i32).wrapping_sub(ROUNDER.to_bits() as i32)
}

#[inline(always)]
fn largest_body<M: MulAdd>(values: &[f32]) -> f32 {
    let mut tops = [0.0_f32; PANEL];
    for line in values.as_chunks::<PANEL>().0 {
        for (top, value) in tops.iter_mut().zip(line) {
            *top = if value.abs() > *top { value.abs() } else { *top };
        }
    }
    let mut top = 0.0;
    for value in tops {
        top = if value > top { value } else { top };
    }
    top
}
per_level! {
    /// The largest size of a panel's values.
    largest = largest_body(values: &[f32]) -> f32
}

#[inline(always)]
fn pack_body<M: MulAdd>(panel: &mut [f32], floats: &[f32], step: f32) -> f32 {
    let (shifts, lines) = panel.split_at_mut(PANEL);
    let mut sums = [0_i32; PANEL];
    let mut rests = [0.0_f32; PANEL];
    for (line, group) in lines.chunks_exact_mut(PANEL).zip(floats.chunks(BYTES * PANEL)) {
        let mut lanes = [0_i32; PANEL];
        for (byte, values) in group.as_chunks::<PANEL>().0.iter().enumerate() {
            for k in 0..PANEL {
                let rounded = round(values[k] / step);
                let off = values[k] - rounded as f32 * step;
                rests[k] = M::mul_add(off, off, rests[k]);
                sums[k] += rounded;
                lanes[k] |= (rounded & 0xFF) << (8 * byte);
            }
        }
        for k in 0..PANEL {
            line[k] = f32::from_bits(lanes[k].cast_unsigned());
        }
    }
    let mut rest = 0.0;
    for k in 0..PANEL {
        shifts[k] = f32::from_bits((-SHIFT * sums[k]).cast_unsigned());
        rest = if rests[k] > rest { rests[k] } else { rest };
    }
    rest
}
per_level! {
    /// Rounds a panel; returns the largest squared length of what was rounded off a descriptor.
    pack = pack_body(panel: &mut [f32], floats: &[f32], step: f32) -> f32
}

/// Which of six queries reach their threshold in a panel.
fn reached(panel: &[f32], num_lines: usize, asked: &[&Asked; ROWS]) -> [bool; ROWS] {
    assert!(panel.len() == (num_lines + 1) * PANEL && num_lines <= MAX_LINES);
    // SAFETY: there is no `Screen` unless the instructions are present; the panel's length has been checked.
    #[cfg(target_arch = "x86_64")]
    unsafe {
        wide::reached(panel.as_ptr().cast(), num_lines, asked)
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = asked;
        [true; ROWS]
    }
}

#[cfg(target_arch = "x86_64")]
mod wide {
    #![allow(clippy::needless_range_loop, reason = "registers are counted, not iterated")]

    use std::arch::x86_64::{
        _mm512_cmpge_epi32_mask, _mm512_dpbusd_epi32, _mm512_loadu_si512, _mm512_set1_epi32,
    };

    use super::{Asked, PANEL, ROWS};

    const VECTORS: usize = 4;

    /// # Safety
    /// `panel` can be read for `num_lines + 1` times 64 lanes, of at most as many lines as a query has.
    #[target_feature(enable = "avx512f,avx512vnni")]
    pub(super) unsafe fn reached(
        panel: *const i32,
        num_lines: usize,
        asked: &[&Asked; ROWS],
    ) -> [bool; ROWS] {
        // SAFETY: all addresses lie in what the caller promised.
        unsafe {
            let shifts = [
                _mm512_loadu_si512(panel.cast()),
                _mm512_loadu_si512(panel.add(16).cast()),
                _mm512_loadu_si512(panel.add(32).cast()),
                _mm512_loadu_si512(panel.add(48).cast()),
            ];
            let mut acc = [shifts; ROWS];
            for idx in 0..num_lines {
                let line = panel.add((idx + 1) * PANEL);
                let line = [
                    _mm512_loadu_si512(line.cast()),
                    _mm512_loadu_si512(line.add(16).cast()),
                    _mm512_loadu_si512(line.add(32).cast()),
                    _mm512_loadu_si512(line.add(48).cast()),
                ];
                for row in 0..ROWS {
                    let bytes = _mm512_set1_epi32(*asked[row].bytes.get_unchecked(idx));
                    for vec in 0..VECTORS {
                        acc[row][vec] = _mm512_dpbusd_epi32(acc[row][vec], bytes, line[vec]);
                    }
                }
            }
            let mut hits = [false; ROWS];
            for row in 0..ROWS {
                let threshold = _mm512_set1_epi32(asked[row].threshold);
                let mut mask = 0;
                for vec in 0..VECTORS {
                    mask |= _mm512_cmpge_epi32_mask(acc[row][vec], threshold);
                }
                hits[row] = mask != 0;
            }
            hits
        }
    }
}
