//! Max and min heights over 2ᵏ × 2ᵏ cells, built row by row so that a DEM larger than memory streams through.

use std::sync::Arc;

/// Floats in memory or in a mapped file.
pub type Block = Arc<dyn AsRef<[f32]> + Send + Sync>;

/// Min levels start here (8×8 cells): they bound where a ray can *start*, which needs no finer steps, and the whole
/// pyramid stays at 1.36 × the heights.
pub const FIRST_MIN_LEVEL: usize = 3;

/// Sizes and offsets of the levels of one grid. Level `k ≥ 1` holds `⌈cells / 2ᵏ⌉` entries a side; level 0 (single
/// cells) is not stored, it is read from the node heights.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PyramidShape {
    /// Entries along a row, per level (entry 0 describes single cells).
    pub cols: Vec<usize>,
    /// Rows, per level.
    pub rows: Vec<usize>,
    /// Where a level starts in the block of max levels (entry 0 is unused).
    pub max_offset: Vec<usize>,
    /// Where a level starts in the block of min levels (entries below `FIRST_MIN_LEVEL` are unused).
    pub min_offset: Vec<usize>,
    /// Length of the block of max levels.
    pub max_len: usize,
    /// Length of the block of min levels.
    pub min_len: usize,
}

impl PyramidShape {
    /// For a grid of `cols × rows` nodes. The top level has one entry.
    pub fn new(cols: usize, rows: usize) -> Self {
        let (mut c, mut r) = (cols - 1, rows - 1);
        let mut shape = Self {
            cols: vec![c],
            rows: vec![r],
            max_offset: vec![0],
            min_offset: vec![0],
            max_len: 0,
            min_len: 0,
        };
        while c > 1 || r > 1 || shape.cols.len() <= FIRST_MIN_LEVEL {
            (c, r) = (c.div_ceil(2), r.div_ceil(2));
            shape.cols.push(c);
            shape.rows.push(r);
            shape.max_offset.push(shape.max_len);
            shape.max_len += c * r;
            shape.min_offset.push(shape.min_len);
            if shape.cols.len() > FIRST_MIN_LEVEL {
                shape.min_len += c * r;
            }
        }
        shape
    }

    /// Number of the top level.
    pub fn top(&self) -> usize {
        self.cols.len() - 1
    }
}

/// The max and min levels of a grid.
#[derive(Clone)]
pub struct Pyramid {
    /// Sizes and offsets.
    pub shape: PyramidShape,
    /// Max levels one after another: the highest node of a block; −∞ where every node is absent.
    pub max: Block,
    /// Min levels one after another: the lowest node of a block; −∞ where any node is absent.
    pub min: Block,
}

impl Pyramid {
    /// Builds both in memory from row-major node heights.
    pub fn build(cols: usize, rows: usize, heights: &[f32]) -> Self {
        let shape = PyramidShape::new(cols, rows);
        let mut max = vec![f32::NEG_INFINITY; shape.max_len];
        let mut min = vec![f32::NEG_INFINITY; shape.min_len];
        let mut builder = PyramidBuilder::new(cols, rows);
        for row in heights.chunks_exact(cols) {
            builder.push_row(row, |out| {
                let width = out.max.len();
                let at = shape.max_offset[out.level] + out.row * width;
                max[at..at + width].copy_from_slice(out.max);
                if out.level >= FIRST_MIN_LEVEL {
                    let at = shape.min_offset[out.level] + out.row * width;
                    min[at..at + width].copy_from_slice(out.min);
                }
            });
        }
        Self { shape, max: Arc::new(max), min: Arc::new(min) }
    }

    /// Highest node of a block of level `level ≥ 1`.
    pub(crate) fn max_at(&self, level: usize, i: usize, j: usize) -> f32 {
        (*self.max).as_ref()[self.shape.max_offset[level] + j * self.shape.cols[level] + i]
    }

    /// Lowest node of a block of level `level ≥ FIRST_MIN_LEVEL`; −∞ if a node is absent.
    pub(crate) fn min_at(&self, level: usize, i: usize, j: usize) -> f32 {
        (*self.min).as_ref()[self.shape.min_offset[level] + j * self.shape.cols[level] + i]
    }

    /// Bounds of the nodes of all cells touched by the cell rectangle `[c0, c1] × [r0, r1]` (clamped to the grid), from at
    /// most 4×4 blocks of the finest level that manages it. The lower bound is −∞ if a node may be absent.
    pub fn bounds(&self, c0: f64, r0: f64, c1: f64, r1: f64) -> (f32, f32) {
        let clamp = |v: f64, n: usize| (v.max(0.0) as usize).min(n - 1);
        let (i0, i1) = (clamp(c0.floor(), self.shape.cols[0]), clamp(c1.floor(), self.shape.cols[0]));
        let (j0, j1) = (clamp(r0.floor(), self.shape.rows[0]), clamp(r1.floor(), self.shape.rows[0]));
        let mut level = FIRST_MIN_LEVEL;
        while level < self.shape.top()
            && ((i1 >> level) - (i0 >> level) > 3 || (j1 >> level) - (j0 >> level) > 3)
        {
            level += 1;
        }
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for j in j0 >> level..=j1 >> level {
            for i in i0 >> level..=i1 >> level {
                low = low.min(self.min_at(level, i, j));
                high = high.max(self.max_at(level, i, j));
            }
        }
        (low, high)
    }
}

/// One finished row of one level, handed out by [`PyramidBuilder::push_row`].
pub(crate) struct LevelRow<'a> {
    /// Level, 1 or higher. Min values count from `FIRST_MIN_LEVEL` on.
    pub level: usize,
    /// Row within the level.
    pub row: usize,
    /// Max per block.
    pub max: &'a [f32],
    /// Min per block.
    pub min: &'a [f32],
}

struct Partial {
    max: Vec<f32>,
    min: Vec<f32>,
    /// Rows of the level below that are in (two fill it).
    filled: usize,
    next_row: usize,
}

/// Builds a pyramid from node rows pushed in order; holds two rows per level.
pub(crate) struct PyramidBuilder {
    shape: PyramidShape,
    /// Bounds between the last node row and the one before it need both.
    previous: Option<(Vec<f32>, Vec<f32>)>,
    pushed: usize,
    levels: Vec<Partial>,
}

impl PyramidBuilder {
    /// For a grid of `cols × rows` nodes.
    pub fn new(cols: usize, rows: usize) -> Self {
        let shape = PyramidShape::new(cols, rows);
        let levels = shape.cols[1..]
            .iter()
            .map(|&c| Partial {
                max: vec![f32::NEG_INFINITY; c],
                min: vec![f32::INFINITY; c],
                filled: 0,
                next_row: 0,
            })
            .collect();
        Self { shape, previous: None, pushed: 0, levels }
    }

    /// Takes the next node row; calls `emit` for each level row that this completes.
    pub(crate) fn push_row(&mut self, nodes: &[f32], mut emit: impl FnMut(LevelRow<'_>)) {
        let num_cells = self.shape.cols[0];
        // Bounds of neighbouring node pairs in this row.
        let low = |v: f32| if v.is_nan() { f32::NEG_INFINITY } else { v };
        let pair_max: Vec<f32> =
            (0..num_cells).map(|i| nodes[i].max(nodes[i + 1]).max(f32::NEG_INFINITY)).collect();
        let pair_min: Vec<f32> = (0..num_cells).map(|i| low(nodes[i]).min(low(nodes[i + 1]))).collect();
        if let Some((last_max, last_min)) = self.previous.take() {
            let cell_max: Vec<f32> = last_max.iter().zip(&pair_max).map(|(a, b)| a.max(*b)).collect();
            let cell_min: Vec<f32> = last_min.iter().zip(&pair_min).map(|(a, b)| a.min(*b)).collect();
            self.merge(0, &cell_max, &cell_min, &mut emit);
        }
        self.previous = Some((pair_max, pair_min));
        self.pushed += 1;
    }

    /// Merges a finished row of `level` into the level above, and goes on while that completes rows.
    fn merge(&mut self, level: usize, max: &[f32], min: &[f32], emit: &mut impl FnMut(LevelRow<'_>)) {
        if level == self.shape.top() {
            return;
        }
        let last_child = if level == 0 {
            self.pushed == self.shape.rows[0]
        } else {
            self.levels[level - 1].next_row == self.shape.rows[level]
        };
        let partial = &mut self.levels[level];
        for (i, (&high, &low)) in max.iter().zip(min).enumerate() {
            partial.max[i / 2] = partial.max[i / 2].max(high);
            partial.min[i / 2] = partial.min[i / 2].min(low);
        }
        partial.filled += 1;
        if partial.filled < 2 && !last_child {
            return;
        }
        let width = partial.max.len();
        let done_max = std::mem::replace(&mut partial.max, vec![f32::NEG_INFINITY; width]);
        let done_min = std::mem::replace(&mut partial.min, vec![f32::INFINITY; width]);
        let row = partial.next_row;
        partial.filled = 0;
        partial.next_row += 1;
        emit(LevelRow { level: level + 1, row, max: &done_max, min: &done_min });
        self.merge(level + 1, &done_max, &done_min, emit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_bounds_its_nodes_for_odd_and_even_sizes() {
        for (cols, rows) in [(2, 2), (9, 17), (33, 20), (50, 3), (65, 65)] {
            let mut heights: Vec<f32> =
                (0..cols * rows).map(|n| ((n as f32 * 12.9898).sin() * 437.585).fract() * 100.0).collect();
            heights[cols * rows / 2] = f32::NAN;
            let pyramid = Pyramid::build(cols, rows, &heights);
            assert!(pyramid.shape.max_len > 0);
            for level in 1..=pyramid.shape.top() {
                let size = 1usize << level;
                for j in 0..pyramid.shape.rows[level] {
                    for i in 0..pyramid.shape.cols[level] {
                        let (mut high, mut low) = (f32::NEG_INFINITY, f32::INFINITY);
                        for r in j * size..=((j + 1) * size).min(rows - 1) {
                            for c in i * size..=((i + 1) * size).min(cols - 1) {
                                let h = heights[r * cols + c];
                                high = high.max(h);
                                low = low.min(if h.is_nan() { f32::NEG_INFINITY } else { h });
                            }
                        }
                        assert_eq!(
                            pyramid.max_at(level, i, j),
                            high,
                            "{cols}×{rows} level {level} ({i}, {j})"
                        );
                        if level >= FIRST_MIN_LEVEL {
                            assert_eq!(pyramid.min_at(level, i, j), low);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn levels_cost_at_most_four_tenths_of_the_heights() {
        let shape = PyramidShape::new(30_336, 30_336);
        let ratio = 1.0 + (shape.max_len + shape.min_len) as f64 / (30_336f64 * 30_336.0);
        assert!(ratio < 1.36, "{ratio}");
    }

    #[test]
    fn bounds_hold_over_rectangles() {
        let (cols, rows) = (100, 80);
        let heights: Vec<f32> = (0..cols * rows).map(|n| (n as f32 * 0.37).sin() * 50.0).collect();
        let pyramid = Pyramid::build(cols, rows, &heights);
        for (c0, r0, c1, r1) in [(0.0, 0.0, 98.9, 78.9), (10.2, 5.5, 12.0, 40.0), (-5.0, 70.0, 3.0, 200.0)] {
            let (low, high) = pyramid.bounds(c0, r0, c1, r1);
            for r in (r0.max(0.0) as usize)..=(r1.min(78.0) as usize + 1) {
                for c in (c0.max(0.0) as usize)..=(c1.min(98.0) as usize + 1) {
                    assert!((low..=high).contains(&heights[r * cols + c]));
                }
            }
        }
    }
}
