//! Operators that are diagonal in cosines, inverted: what conjugate gradients are preconditioned with.

use super::filter::ROWS_PER_TASK;
use rayon::prelude::*;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// An even operator under mirrored boundaries, where it is diagonal in cosines: what it multiplies the wave `(k, l)` by is
/// `mass + along_x sin² k + along_y sin² l + membrane κ + plate κ²`, with `κ = 4 sin²(k/2) + 4 sin²(l/2)`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Symbol {
    pub mass: f32,
    pub along_x: f32,
    pub along_y: f32,
    pub membrane: f32,
    pub plate: f32,
}

/// Cosine transforms of two rows at once, as the real and the imaginary part of one Fourier transform of their length.
///
/// # Source
/// Makhoul 1980, "A fast cosine transform in one and two dimensions", IEEE Trans. ASSP 28(1).
struct Cosines {
    forward: Arc<dyn Fft<f32>>,
    backward: Arc<dyn Fft<f32>>,
    /// `exp(−iπk/2n)`.
    quarter_turns: Vec<Complex32>,
}

/// Buffers of one thread.
struct Scratch {
    packed: Vec<Complex32>,
    of_fft: Vec<Complex32>,
}

impl Cosines {
    fn new(count: usize, planner: &mut FftPlanner<f32>) -> Self {
        let turn = |k: usize| {
            let angle = -0.5 * std::f64::consts::PI * k as f64 / count as f64;
            Complex32::new(angle.cos() as f32, angle.sin() as f32)
        };
        Self {
            forward: planner.plan_fft_forward(count),
            backward: planner.plan_fft_inverse(count),
            quarter_turns: (0..count).map(turn).collect(),
        }
    }

    fn scratch(&self) -> Scratch {
        let zero = Complex32::new(0.0, 0.0);
        let of_fft = self.forward.get_inplace_scratch_len().max(self.backward.get_inplace_scratch_len());
        Scratch { packed: vec![zero; self.quarter_turns.len()], of_fft: vec![zero; of_fft] }
    }

    /// Two rows after the other of a raster, with the number of the first; an odd last one comes with an empty one.
    fn for_each_two(
        &self,
        rows: &mut [f32],
        change: impl Fn(usize, &mut [f32], &mut [f32], &mut Scratch) + Sync,
    ) {
        let count = self.quarter_turns.len();
        rows.par_chunks_mut(count * CHUNK).enumerate().for_each_init(
            || (self.scratch(), vec![0.0; count]),
            |(scratch, empty), (task, block)| {
                for (i, two) in block.chunks_mut(2 * count).enumerate() {
                    let (a, mut b) = two.split_at_mut(count);
                    if b.is_empty() {
                        empty.fill(0.0);
                        b = empty;
                    }
                    change(task * CHUNK + 2 * i, a, b, scratch);
                }
            },
        );
    }

    /// `a[k] ← Σ a[n] cos(πk(2n+1)/2N)`, and the same of `b`.
    fn take_waves(&self, a: &mut [f32], b: &mut [f32], Scratch { packed, of_fft }: &mut Scratch) {
        let count = packed.len();
        // Even samples forwards, then the odd ones backwards.
        let (evens, odds) = packed.split_at_mut(count.div_ceil(2));
        for (v, (a, b)) in evens.iter_mut().zip(a.iter().step_by(2).zip(b.iter().step_by(2))) {
            *v = Complex32::new(*a, *b);
        }
        let backwards = odds.iter_mut().rev();
        for (v, (a, b)) in backwards.zip(a[1..].iter().step_by(2).zip(b[1..].iter().step_by(2))) {
            *v = Complex32::new(*a, *b);
        }
        self.forward.process_with_scratch(packed, of_fft);
        (a[0], b[0]) = (packed[0].re, packed[0].im);
        for k in 1..count.div_ceil(2) {
            let z = packed[k] * self.quarter_turns[k];
            let mirrored = packed[count - k] * self.quarter_turns[count - k];
            (a[k], b[k]) = (0.5 * (z.re - mirrored.im), 0.5 * (z.im + mirrored.re));
            (a[count - k], b[count - k]) = (0.5 * (mirrored.re - z.im), 0.5 * (mirrored.im + z.re));
        }
        if count % 2 == 0 {
            let z = packed[count / 2] * self.quarter_turns[count / 2];
            (a[count / 2], b[count / 2]) = (0.5 * (z.re - z.im), 0.5 * (z.im + z.re));
        }
    }

    /// The inverse of [`Self::take_waves`], times the length.
    fn sum_waves(&self, a: &mut [f32], b: &mut [f32], Scratch { packed, of_fft }: &mut Scratch) {
        let count = packed.len();
        packed[0] = Complex32::new(a[0], b[0]);
        for k in 1..count {
            let (mirrored_a, mirrored_b) = (a[count - k], b[count - k]);
            let z = Complex32::new(a[k] + mirrored_b, b[k] - mirrored_a);
            packed[k] = z * self.quarter_turns[k].conj();
        }
        self.backward.process_with_scratch(packed, of_fft);
        let (evens, odds) = packed.split_at(count.div_ceil(2));
        for (v, (a, b)) in evens.iter().zip(a.iter_mut().step_by(2).zip(b.iter_mut().step_by(2))) {
            (*a, *b) = (v.re, v.im);
        }
        let backwards = odds.iter().rev();
        for (v, (a, b)) in backwards.zip(a[1..].iter_mut().step_by(2).zip(b[1..].iter_mut().step_by(2))) {
            (*a, *b) = (v.re, v.im);
        }
    }
}

/// Rows of a task, an even number.
const CHUNK: usize = 2 * ROWS_PER_TASK;

/// The inverse of such an operator.
pub(crate) struct Preconditioner {
    width: usize,
    height: usize,
    along_rows: Cosines,
    along_columns: Cosines,
    turned: Vec<f32>,
}

impl Preconditioner {
    /// For rasters of this size.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            width,
            height,
            along_rows: Cosines::new(width, &mut planner),
            along_columns: Cosines::new(height, &mut planner),
            turned: vec![0.0; width * height],
        }
    }

    /// `data` becomes the inverse of `symbol`'s operator applied to it.
    pub(crate) fn run(&mut self, data: &mut [f32], symbol: &Symbol) {
        let (width, height) = (self.width, self.height);
        let (rows, columns) = (&self.along_rows, &self.along_columns);
        rows.for_each_two(data, |_, a, b, scratch| rows.take_waves(a, b, scratch));
        transpose(data, width, height, &mut self.turned);
        let eigen = |k: usize, count: usize| {
            (2.0 - 2.0 * (std::f64::consts::PI * k as f64 / count as f64).cos()) as f32
        };
        let sine2 =
            |k: usize, count: usize| (std::f64::consts::PI * k as f64 / count as f64).sin().powi(2) as f32;
        let Symbol { mass, along_x, along_y, membrane, plate } = *symbol;
        let down: Vec<(f32, f32)> =
            (0..height).map(|k| (eigen(k, height), along_y * sine2(k, height))).collect();
        let norm = 1.0 / (width as f32 * height as f32);
        columns.for_each_two(&mut self.turned, |first, a, b, scratch| {
            columns.take_waves(a, b, scratch);
            for (k, column) in [&mut *a, &mut *b].into_iter().enumerate() {
                let (across, mass) = (eigen(first + k, width), mass + along_x * sine2(first + k, width));
                for (v, &(along, slope)) in column.iter_mut().zip(&down) {
                    let k2 = across + along;
                    *v *= norm / (mass + slope + (membrane + plate * k2) * k2);
                }
            }
            columns.sum_waves(a, b, scratch);
        });
        transpose(&self.turned, height, width, data);
        rows.for_each_two(data, |_, a, b, scratch| rows.sum_waves(a, b, scratch));
    }
}

/// `out[x][y] = source[y][x]`, in square tiles that stay in the cache.
fn transpose(source: &[f32], width: usize, height: usize, out: &mut [f32]) {
    const TILE: usize = 32;
    out.par_chunks_mut(height * TILE).enumerate().for_each(|(task, block)| {
        let left = task * TILE;
        let columns = block.len() / height;
        for top in (0..height).step_by(TILE) {
            for y in top..(top + TILE).min(height) {
                let row = &source[y * width + left..y * width + left + columns];
                for (i, &v) in row.iter().enumerate() {
                    block[i * height + y] = v;
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transformed(samples: &[f64], k: usize) -> f64 {
        let count = samples.len() as f64;
        let wave = |n: usize| (std::f64::consts::PI * k as f64 * (2 * n + 1) as f64 / (2.0 * count)).cos();
        samples.iter().enumerate().map(|(n, v)| v * wave(n)).sum()
    }

    #[test]
    fn two_rows_are_transformed_as_each_alone_and_back() {
        for count in [1, 2, 3, 6, 7, 30] {
            let row = |seed: usize| -> Vec<f32> {
                (0..count).map(|i| ((i * 37 + seed * 11) % 17) as f32 - 8.0).collect()
            };
            let (a, b) = (row(1), row(5));
            let cosines = Cosines::new(count, &mut FftPlanner::new());
            let mut scratch = cosines.scratch();
            let (mut found_a, mut found_b) = (a.clone(), b.clone());
            cosines.take_waves(&mut found_a, &mut found_b, &mut scratch);
            for (row, found) in [(&a, &found_a), (&b, &found_b)] {
                let row: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
                for (k, found) in found.iter().enumerate() {
                    let expected = transformed(&row, k);
                    assert!(
                        (f64::from(*found) - expected).abs() < 1e-4,
                        "{count} {k}: {found} for {expected}"
                    );
                }
            }
            cosines.sum_waves(&mut found_a, &mut found_b, &mut scratch);
            for (found, row) in found_a.iter().zip(&a).chain(found_b.iter().zip(&b)) {
                assert!((found / count as f32 - row).abs() < 1e-5, "{count}: {found} for {row}");
            }
        }
    }

    /// On an odd number of rows and columns, against the operator itself in a wave that it keeps.
    #[test]
    fn the_inverse_divides_a_wave_by_the_symbol() {
        let (width, height, k, l) = (15, 9, 4, 3);
        let wave = |k: usize, n: usize, count: usize| {
            (std::f64::consts::PI * k as f64 * (2 * n + 1) as f64 / (2 * count) as f64).cos() as f32
        };
        let data: Vec<f32> =
            (0..width * height).map(|at| wave(k, at % width, width) * wave(l, at / width, height)).collect();
        let symbol = Symbol { mass: 0.5, along_x: 0.2, along_y: 0.3, membrane: 0.7, plate: 0.1 };
        let (ku, kv) =
            (std::f32::consts::PI * k as f32 / width as f32, std::f32::consts::PI * l as f32 / height as f32);
        let k2 = 4.0 - 2.0 * ku.cos() - 2.0 * kv.cos();
        let factor = 0.5 + 0.2 * ku.sin().powi(2) + 0.3 * kv.sin().powi(2) + 0.7 * k2 + 0.1 * k2 * k2;
        let mut found = data.clone();
        Preconditioner::new(width, height).run(&mut found, &symbol);
        for (found, v) in found.iter().zip(&data) {
            assert!((found * factor - v).abs() < 1e-5, "{found} {v}");
        }
    }
}
