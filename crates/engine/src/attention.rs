//! Softmax attention that never holds the matrix of scores.
//!
//! Keys and values of a head are packed as the kernel's panels (keys transposed and rotated on the way),
//! then each task takes a few queries of one head through scores, softmax and sum while they are in cache.

use rayon::prelude::*;

use crate::buffer::{Pool, SharedOut, with_scratch};
use crate::kernel::{PANEL, Product, ROWS, Simd, multiply};
use crate::rope::Rope;
use crate::vector::{exponentiate, scale};

/// Queries of a task: a multiple of the kernel's rows; their scores stay in the second-level cache.
const TASK_QUERIES: usize = 48;

/// Columns of a matrix that hold the queries, keys or values of all heads, one head after the other.
#[derive(Clone, Copy)]
pub(crate) struct Columns<'a> {
    pub data: &'a [f32],
    /// From one token to the next.
    pub stride: usize,
    /// First column.
    pub offset: usize,
}

impl<'a> Columns<'a> {
    fn row(&self, token: usize, head: usize, head_dim: usize) -> &'a [f32] {
        &self.data[token * self.stride + self.offset + head * head_dim..][..head_dim]
    }
}

/// Consecutive tokens that form a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Grid {
    /// First token.
    pub first: usize,
    /// Rows of patches.
    pub height: usize,
    /// Columns of patches.
    pub width: usize,
}

impl Grid {
    pub(crate) fn num_tokens(&self) -> usize {
        self.height * self.width
    }

    fn position(&self, idx: usize) -> (usize, usize) {
        (idx / self.width, idx % self.width)
    }
}

/// What attends to what.
pub(crate) struct Attention<'a> {
    pub level: Simd,
    pub pool: &'a Pool,
    pub rope: &'a Rope,
    pub num_heads: usize,
    pub head_dim: usize,
    pub queries: Columns<'a>,
    pub keys: Columns<'a>,
    pub values: Columns<'a>,
    /// For each group of queries the tokens that it looks at.
    pub pairs: &'a [(Grid, Grid)],
}

impl Attention<'_> {
    /// Writes all heads' results, `num_heads · head_dim` columns per query token.
    pub(crate) fn run(&self, out: &mut [f32]) {
        let out = SharedOut::new(out);
        for (queries, keys) in self.pairs {
            let layout = Layout::new(keys.num_tokens(), self.head_dim);
            let len = packed_len(keys.num_tokens(), self.head_dim);
            let mut packed = self.pool.take(self.num_heads * len);
            packed.par_chunks_mut(len).enumerate().for_each(|(head, part)| {
                self.pack(head, *keys, &layout, part);
            });
            let blocks = queries.num_tokens().div_ceil(TASK_QUERIES);
            (0..self.num_heads * blocks).into_par_iter().with_max_len(1).for_each(|task| {
                let (head, block) = (task / blocks, task % blocks);
                let part = &packed[head * len..][..len];
                self.attend(head, *queries, block * TASK_QUERIES, &layout, part, out);
            });
        }
    }

    /// Keys as panels of 64 keys, values as panels of 64 channels.
    fn pack(&self, head: usize, grid: Grid, layout: &Layout, part: &mut [f32]) {
        let dim = self.head_dim;
        let (keys, values) = part.split_at_mut(layout.keys);
        with_scratch(dim, |rotated| {
            for token in 0..layout.num_keys {
                let row = self.keys.row(grid.first + token, head, dim);
                self.rope.apply(self.level, grid.position(token), row, 1.0, rotated);
                let panel = &mut keys[token / PANEL * PANEL * dim..][..PANEL * dim];
                for (line, value) in panel.chunks_exact_mut(PANEL).zip(rotated.iter()) {
                    line[token % PANEL] = *value;
                }
                let row = self.values.row(grid.first + token, head, dim);
                for (idx, piece) in row.chunks(PANEL).enumerate() {
                    let line = &mut values[(idx * layout.num_keys + token) * PANEL..][..PANEL];
                    line[..piece.len()].copy_from_slice(piece);
                }
            }
        });
        // What lies beyond the last key is multiplied and thrown away, but must not hold NaN of old times.
        let rest = layout.num_keys % PANEL;
        if rest > 0 {
            let panel = &mut keys[layout.num_keys / PANEL * PANEL * dim..];
            for line in panel.chunks_exact_mut(PANEL) {
                line[rest..].fill(0.0);
            }
        }
    }

    fn attend(&self, head: usize, grid: Grid, first: usize, layout: &Layout, part: &[f32], out: SharedOut) {
        let dim = self.head_dim;
        let count = TASK_QUERIES.min(grid.num_tokens() - first);
        let width = layout.num_keys.next_multiple_of(PANEL);
        let (keys, values) = part.split_at(layout.keys);
        with_scratch(scratch_len(layout.num_keys, dim), |scratch| {
            let (queries, scores) = scratch.split_at_mut(TASK_QUERIES * dim);
            let factor = 1.0 / (dim as f32).sqrt();
            for (idx, query) in queries.chunks_exact_mut(dim).take(count).enumerate() {
                let row = self.queries.row(grid.first + first + idx, head, dim);
                self.rope.apply(self.level, grid.position(first + idx), row, factor, query);
            }
            for (idx, panel) in keys.chunks_exact(PANEL * dim).enumerate() {
                for strip in 0..count.div_ceil(ROWS) {
                    let rows = std::array::from_fn::<_, ROWS, _>(|row| {
                        queries[(strip * ROWS + row).min(count - 1) * dim..][..dim].as_ptr()
                    });
                    let tile =
                        &mut scores[strip * ROWS * width + idx * PANEL..][..(ROWS - 1) * width + PANEL];
                    let product = Product {
                        rows: &rows,
                        segments: &[dim],
                        panel: panel.as_ptr(),
                        tile: tile.as_mut_ptr(),
                        stride: width,
                        accumulate: false,
                    };
                    // SAFETY: rows and panel hold `dim` values and lines; the tile is inside `scores`, which
                    // has whole strips; the level is one the engine has checked.
                    unsafe { multiply(self.level, &product) };
                }
            }
            let mut sums = [1.0_f32; TASK_QUERIES];
            for (sum, row) in sums.iter_mut().zip(scores.chunks_exact_mut(width)).take(count) {
                *sum = exponentiate(self.level, &mut row[..layout.num_keys]);
            }
            let to = |idx: usize| (grid.first + first + idx) * self.num_heads * dim + head * dim;
            self.gather(scores, width, values, layout, (&sums[..count], &to), out);
        });
    }

    /// Sums the values by their weights and divides by the weights' sums.
    fn gather(
        &self,
        scores: &[f32],
        width: usize,
        values: &[f32],
        layout: &Layout,
        (sums, to): (&[f32], &dyn Fn(usize) -> usize),
        out: SharedOut,
    ) {
        let mut tile = Tile([0.0; ROWS * PANEL]);
        for (idx, panel) in values.chunks_exact(PANEL * layout.num_keys).enumerate() {
            let channels = PANEL.min(self.head_dim - idx * PANEL);
            for (strip, sums) in sums.chunks(ROWS).enumerate() {
                let rows = std::array::from_fn::<_, ROWS, _>(|row| {
                    let row = strip * ROWS + row.min(sums.len() - 1);
                    scores[row * width..][..layout.num_keys].as_ptr()
                });
                let product = Product {
                    rows: &rows,
                    segments: &[layout.num_keys],
                    panel: panel.as_ptr(),
                    tile: tile.0.as_mut_ptr(),
                    stride: PANEL,
                    accumulate: false,
                };
                // SAFETY: rows and panel hold `num_keys` values and lines; the tile is six rows of 64.
                unsafe { multiply(self.level, &product) };
                for (row, (sum, values)) in sums.iter().zip(tile.0.chunks_exact(PANEL)).enumerate() {
                    // SAFETY: each task has its own queries and head; the caller holds the output.
                    let out = unsafe { out.row(to(strip * ROWS + row) + idx * PANEL, channels) };
                    scale(self.level, &values[..channels], 1.0 / sum, out);
                }
            }
        }
    }
}

#[repr(align(64))]
struct Tile([f32; ROWS * PANEL]);

/// Sizes of a head's packed keys and values.
struct Layout {
    num_keys: usize,
    keys: usize,
    values: usize,
}

impl Layout {
    fn new(num_keys: usize, head_dim: usize) -> Self {
        Self {
            num_keys,
            keys: num_keys.next_multiple_of(PANEL) * head_dim,
            values: num_keys * head_dim.next_multiple_of(PANEL),
        }
    }
}

/// Values of a head's packed keys and values.
pub(crate) fn packed_len(num_keys: usize, head_dim: usize) -> usize {
    let layout = Layout::new(num_keys, head_dim);
    layout.keys + layout.values
}

/// Values of a task's scratch memory: its queries, and their scores against all keys.
pub(crate) fn scratch_len(num_keys: usize, head_dim: usize) -> usize {
    TASK_QUERIES * (head_dim + num_keys.next_multiple_of(PANEL))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::levels;

    /// Rounding of a softmax in f32.
    const ROUNDING: f64 = 2e-6;

    /// Attention without positions, in f64.
    fn reference(q: &[f32], k: &[f32], v: &[f32], dim: usize) -> Vec<f64> {
        let mut out = Vec::new();
        for query in q.chunks_exact(dim) {
            let scores: Vec<f64> = k
                .chunks_exact(dim)
                .map(|key| {
                    let sum: f64 = query.iter().zip(key).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
                    (sum / (dim as f64).sqrt()).exp()
                })
                .collect();
            let total: f64 = scores.iter().sum();
            for c in 0..dim {
                let sum: f64 = scores.iter().enumerate().map(|(j, s)| s * f64::from(v[j * dim + c])).sum();
                out.push(sum / total);
            }
        }
        out
    }

    #[test]
    fn attention_by_its_definition() {
        let value = |idx: usize| ((idx * 7919 + 13) % 1009) as f32 / 504.5 - 1.0;
        for level in levels() {
            for (dim, num_q, num_k) in [(8, 5, 3), (64, 70, 130), (80, 49, 65)] {
                let q: Vec<f32> = (0..num_q * dim).map(value).collect();
                let k: Vec<f32> = (0..num_k * dim).map(|i| value(i + 5)).collect();
                let v: Vec<f32> = (0..num_k * dim).map(|i| value(i + 9)).collect();
                let rope = Rope::still(dim, num_q.max(num_k));
                let pool = Pool::default();
                let columns = |data| Columns { data, stride: dim, offset: 0 };
                let attention = Attention {
                    level,
                    pool: &pool,
                    rope: &rope,
                    num_heads: 1,
                    head_dim: dim,
                    queries: columns(&q),
                    keys: columns(&k),
                    values: columns(&v),
                    pairs: &[(
                        Grid { first: 0, height: 1, width: num_q },
                        Grid { first: 0, height: 1, width: num_k },
                    )],
                };
                let mut out = vec![0.0; num_q * dim];
                attention.run(&mut out);
                for (found, exact) in out.iter().zip(reference(&q, &k, &v, dim)) {
                    assert!((f64::from(*found) - exact).abs() < ROUNDING, "{level:?} {dim}");
                }
            }
        }
    }
}
