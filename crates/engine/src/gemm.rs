//! Rows times packed weights, in parallel, with bias, activation and residual on the way out.

use rayon::prelude::*;

use crate::buffer::{SharedOut, with_scratch};
use crate::kernel::{PANEL, Product, ROWS, Simd, multiply};
use crate::packed::{Chunk, MAX_SEGMENTS, Packed};
use crate::vector::{Activation, activate};

/// Rows of a task: with a panel they fit the second-level cache.
const TASK_ROWS: usize = 192;
/// Panels of a task.
const TASK_PANELS: usize = 2;
const TILE: usize = ROWS * PANEL;
/// Values of scratch memory that a task takes at most.
pub(crate) const SCRATCH_LEN: usize = TASK_ROWS.div_ceil(ROWS) * TILE;

/// An image, channels last, of which a convolution reads 3×3 neighbourhoods; zeros around it.
#[derive(Clone, Copy)]
pub(crate) struct Conv3Input<'a> {
    /// Rows `first_row..` of the image.
    pub data: &'a [f32],
    /// Width and height of the image.
    pub size: (usize, usize),
    /// Channels of a pixel.
    pub channels: usize,
    /// Image row where `data` begins.
    pub first_row: usize,
    /// From one output pixel to the next.
    pub stride: usize,
    /// Width of the output.
    pub out_width: usize,
    /// Output row of the first output pixel.
    pub out_first_row: usize,
    /// At least as many zeros as a pixel has channels.
    pub zeros: &'a [f32],
}

/// Where the rows lie.
#[derive(Clone, Copy)]
pub(crate) enum Input<'a> {
    /// One after the other.
    Rows {
        /// The values.
        data: &'a [f32],
        /// From one row to the next.
        stride: usize,
    },
    /// Each row is a row of the first followed by a row of the second.
    Pair {
        /// Values and stride of either.
        parts: [(&'a [f32], usize); 2],
    },
    /// Row p holds the neighbourhood of output pixel p.
    Conv3(Conv3Input<'a>),
}

impl Input<'_> {
    /// Pointers to the segments of six rows from `first`; rows from `end` on repeat the last.
    fn locate(&self, chunk: &Chunk, first: usize, end: usize, table: &mut [*const f32]) {
        for (segment, slots) in chunk.segments.iter().zip(table.chunks_exact_mut(ROWS)) {
            for (idx, slot) in slots.iter_mut().enumerate() {
                let row = (first + idx).min(end - 1);
                let from = match self {
                    Self::Rows { data, stride } => {
                        let start = row * stride + segment.offset;
                        &data[start..start + segment.len]
                    }
                    Self::Pair { parts } => {
                        let (data, stride) = parts[segment.source];
                        let start = row * stride + segment.offset;
                        &data[start..start + segment.len]
                    }
                    Self::Conv3(conv) => {
                        let start = segment.offset;
                        &conv.tap(row, segment.source)[start..start + segment.len]
                    }
                };
                *slot = from.as_ptr();
            }
        }
    }
}

impl Conv3Input<'_> {
    fn tap(&self, pixel: usize, tap: usize) -> &[f32] {
        let (width, height) = self.size;
        let y = (self.out_first_row + pixel / self.out_width) * self.stride + tap / 3;
        let x = pixel % self.out_width * self.stride + tap % 3;
        // Both are one larger than the coordinate in the image.
        if y == 0 || x == 0 || y > height || x > width {
            return self.zeros;
        }
        let start = ((y - 1 - self.first_row) * width + x - 1) * self.channels;
        &self.data[start..start + self.channels]
    }
}

/// What becomes of the products.
#[derive(Clone, Copy)]
pub(crate) struct Finish<'a> {
    /// Receives row r from `r * stride` on.
    pub out: SharedOut,
    /// From one row of the output to the next, also of what is added.
    pub stride: usize,
    /// After the bias.
    pub activation: Activation,
    /// The output's former values are added.
    pub onto: bool,
    /// Added after the activation.
    pub add: [Option<&'a [f32]>; 2],
    /// Receives the positive part of the result.
    pub positive: Option<SharedOut>,
}

impl<'a> Finish<'a> {
    /// Bias only.
    pub(crate) fn store(out: &'a mut [f32], stride: usize) -> Self {
        Self {
            out: SharedOut::new(out),
            stride,
            activation: Activation::None,
            onto: false,
            add: [None; 2],
            positive: None,
        }
    }

    /// With an activation.
    pub(crate) fn with(self, activation: Activation) -> Self {
        Self { activation, ..self }
    }

    /// Adds to the output's former values.
    pub(crate) fn onto(self) -> Self {
        Self { onto: true, ..self }
    }

    /// Adds an array of the output's layout.
    pub(crate) fn plus(self, values: &'a [f32]) -> Self {
        Self { add: [Some(values), self.add[0]], ..self }
    }

    /// Stores the positive part, too.
    pub(crate) fn with_positive(self, out: &'a mut [f32]) -> Self {
        Self { positive: Some(SharedOut::new(out)), ..self }
    }
}

/// `out = finish(rows · weights)`.
pub(crate) fn gemm(level: Simd, input: &Input<'_>, num_rows: usize, weights: &Packed, finish: &Finish<'_>) {
    let row_tasks = num_rows.div_ceil(TASK_ROWS);
    let panel_tasks = weights.num_panels().div_ceil(TASK_PANELS);
    (0..row_tasks * panel_tasks).into_par_iter().with_max_len(1).for_each(|task| {
        let (row, panel) = (task / panel_tasks * TASK_ROWS, task % panel_tasks * TASK_PANELS);
        let rows = (row, num_rows.min(row + TASK_ROWS));
        let panels = (panel, weights.num_panels().min(panel + TASK_PANELS));
        gemm_part(level, input, rows, panels, weights, finish);
    });
}

/// Rows `rows.0..rows.1` times panels `panels.0..panels.1`, by the calling thread.
pub(crate) fn gemm_part(
    level: Simd,
    input: &Input<'_>,
    rows: (usize, usize),
    panels: (usize, usize),
    weights: &Packed,
    finish: &Finish<'_>,
) {
    let num_strips = (rows.1 - rows.0).div_ceil(ROWS);
    let num_tiles = if weights.chunks.len() == 1 { 1 } else { num_strips };
    with_scratch(num_tiles * TILE, |tiles| {
        let mut table = [std::ptr::null(); ROWS * MAX_SEGMENTS];
        for panel in panels.0..panels.1 {
            for (idx, chunk) in weights.chunks.iter().enumerate() {
                let lines = weights.lines(panel, chunk);
                let table = &mut table[..chunk.segments.len() * ROWS];
                for strip in 0..num_strips {
                    let first = rows.0 + strip * ROWS;
                    input.locate(chunk, first, rows.1, table);
                    let tile = &mut tiles[strip % num_tiles * TILE..][..TILE];
                    let product = Product {
                        rows: table,
                        segments: &chunk.lens,
                        panel: lines.as_ptr(),
                        tile: tile.as_mut_ptr(),
                        stride: PANEL,
                        accumulate: idx > 0,
                    };
                    // SAFETY: `locate` has checked the rows' bounds, `lines` those of the panel; the tile
                    // has six rows of 64; the level is one the engine has checked.
                    unsafe { multiply(level, &product) };
                    if idx + 1 == weights.chunks.len() {
                        store(level, tile, first, rows.1.min(first + ROWS), panel, weights, finish);
                    }
                }
            }
        }
    });
}

fn store(
    level: Simd,
    tile: &mut [f32],
    first: usize,
    end: usize,
    panel: usize,
    weights: &Packed,
    finish: &Finish<'_>,
) {
    let (rows, _) = tile.as_chunks_mut::<PANEL>();
    let (bias, _) = weights.bias(panel).as_chunks::<PANEL>();
    let count = PANEL.min(weights.outputs - panel * PANEL);
    for (idx, values) in rows[..end - first].iter_mut().enumerate() {
        activate(level, values, &bias[0], finish.activation);
        let start = (first + idx) * finish.stride + panel * PANEL;
        for add in finish.add.into_iter().flatten() {
            for (value, add) in values.iter_mut().zip(&add[start..start + count]) {
                *value += add;
            }
        }
        // SAFETY: tasks have rows or panels of their own, so no two write the same values; the caller of
        // `gemm` holds the output borrowed for that long.
        let out = unsafe { finish.out.row(start, count) };
        if finish.onto {
            for (value, out) in values.iter_mut().zip(out.iter()) {
                *value += out;
            }
        }
        out.copy_from_slice(&values[..count]);
        if let Some(positive) = finish.positive {
            // SAFETY: as above.
            let out = unsafe { positive.row(start, count) };
            for (out, value) in out.iter_mut().zip(values) {
                *out = if *value > 0.0 { *value } else { 0.0 };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::levels;

    /// Rounding of sums of a few thousand products in f32, relative to the sum of their sizes.
    const ROUNDING: f64 = 2e-6;

    fn value(idx: usize) -> f32 {
        ((idx * 7919 + 13) % 1009) as f32 / 504.5 - 1.0
    }

    #[test]
    fn linear_layers_of_any_size() {
        for level in levels() {
            for (rows, inputs, outputs) in [(7, 5, 3), (200, 70, 130), (13, 2500, 64)] {
                let data: Vec<f32> = (0..rows * inputs).map(value).collect();
                let weights: Vec<f32> = (0..outputs * inputs).map(|k| value(k + 3)).collect();
                let bias: Vec<f32> = (0..outputs).map(value).collect();
                let packed = Packed::linear(&weights, inputs, outputs, Some(&bias));
                let mut out = vec![1.0; rows * outputs];
                let finish = Finish::store(&mut out, outputs).onto();
                gemm(level, &Input::Rows { data: &data, stride: inputs }, rows, &packed, &finish);
                for row in 0..rows {
                    for col in 0..outputs {
                        let mut exact = f64::from(bias[col]) + 1.0;
                        let mut size = 2.0;
                        for k in 0..inputs {
                            let product =
                                f64::from(data[row * inputs + k]) * f64::from(weights[col * inputs + k]);
                            exact += product;
                            size += product.abs();
                        }
                        let error = (f64::from(out[row * outputs + col]) - exact).abs();
                        assert!(error < ROUNDING * size, "{level:?} {rows} {inputs}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn convolutions_by_their_definition() {
        let (width, height, channels, outputs) = (9_usize, 5_usize, 7_usize, 5_usize);
        let data: Vec<f32> = (0..width * height * channels).map(value).collect();
        let weights: Vec<f32> = (0..outputs * channels * 9).map(|k| value(k + 3)).collect();
        let packed = Packed::conv3(&weights, channels, outputs, None);
        let zeros = vec![0.0; channels];
        for stride in [1, 2] {
            let (out_width, out_height) = (width.div_ceil(stride), height.div_ceil(stride));
            let mut out = vec![0.0; out_width * out_height * outputs];
            let input = Input::Conv3(Conv3Input {
                data: &data,
                size: (width, height),
                channels,
                first_row: 0,
                stride,
                out_width,
                out_first_row: 0,
                zeros: &zeros,
            });
            let finish = Finish::store(&mut out, outputs);
            gemm(Simd::detect(), &input, out_width * out_height, &packed, &finish);
            for (idx, found) in out.iter().enumerate() {
                let (pixel, output) = (idx / outputs, idx % outputs);
                let (y, x) = (pixel / out_width * stride, pixel % out_width * stride);
                let mut exact = 0.0;
                let mut size = 1.0;
                for (dy, dx) in (0..9).map(|tap| (tap / 3, tap % 3)) {
                    if y + dy < 1 || x + dx < 1 || y + dy > height || x + dx > width {
                        continue;
                    }
                    let from = ((y + dy - 1) * width + x + dx - 1) * channels;
                    for c in 0..channels {
                        let weight = weights[(output * channels + c) * 9 + dy * 3 + dx];
                        let product = f64::from(data[from + c]) * f64::from(weight);
                        exact += product;
                        size += product.abs();
                    }
                }
                assert!((f64::from(*found) - exact).abs() < ROUNDING * size, "{stride} {idx}");
            }
        }
    }
}
