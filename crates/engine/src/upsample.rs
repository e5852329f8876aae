//! Bilinear enlargement by two with fixed corners, alone or on the way into a convolution.

use rayon::prelude::*;

use crate::buffer::{SharedOut, with_scratch};
use crate::gemm::{Conv3Input, Finish, Input, gemm_part};
use crate::kernel::Simd;
use crate::packed::Packed;
use crate::vector::mix;

/// Output rows of a task of the fused convolution.
const TASK_ROWS: usize = 8;

/// Values of scratch memory that a task of [`Pixels::enlarge_into_conv`] takes for an image `width` wide: rows of the
/// enlarged image, and of the convolution's output.
pub(crate) fn scratch_lens(width: usize, inputs: usize, outputs: usize) -> [usize; 2] {
    [(TASK_ROWS + 2) * 2 * width * inputs, TASK_ROWS * 2 * width * outputs]
}

/// An image, channels last.
#[derive(Clone, Copy)]
pub(crate) struct Pixels<'a> {
    pub data: &'a [f32],
    pub width: usize,
    pub height: usize,
    pub channels: usize,
}

/// What a linear layer makes of another image's pixels.
#[derive(Clone, Copy)]
pub(crate) struct Join<'a> {
    pub map: &'a [f32],
    pub layer: &'a Packed,
}

/// Index and weight of the two source pixels: `dst (in − 1) / (out − 1)` with `out = 2 in`.
fn sources(dst: usize, len: usize) -> ([usize; 2], f32) {
    let ratio = (len - 1) as f32 / (2 * len - 1) as f32;
    let at = ratio * dst as f32;
    let low = (at as usize).min(len - 1);
    ([low, (low + 1).min(len - 1)], at - low as f32)
}

impl<'a> Pixels<'a> {
    fn at(&self, y: usize, x: usize) -> &'a [f32] {
        &self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// Row `y` of the enlarged image, its first `out.len() / channels` pixels.
    pub(crate) fn enlarged_row(&self, level: Simd, y: usize, out: &mut [f32]) {
        let (rows, down) = sources(y, self.height);
        for (x, out) in out.chunks_exact_mut(self.channels).enumerate() {
            let (cols, right) = sources(x, self.width);
            let corners = [
                self.at(rows[0], cols[0]),
                self.at(rows[0], cols[1]),
                self.at(rows[1], cols[0]),
                self.at(rows[1], cols[1]),
            ];
            let weights =
                [(1.0 - down) * (1.0 - right), (1.0 - down) * right, down * (1.0 - right), down * right];
            mix(level, corners, weights, out);
        }
    }

    /// The first rows and columns of the enlarged image, as many as `out` has (rows of `width` pixels).
    pub(crate) fn enlarge(&self, level: Simd, width: usize, out: &mut [f32]) {
        out.par_chunks_mut(width * self.channels).enumerate().for_each(|(y, row)| {
            self.enlarged_row(level, y, row);
        });
    }

    /// A 3×3 convolution of the enlarged image, which exists only a few rows at a time; `join` is added to it before.
    ///
    /// `last` receives the output row where a band begins and the band's pixels, `outputs` channels each.
    pub(crate) fn enlarge_into_conv(
        &self,
        level: Simd,
        weights: &Packed,
        zeros: &[f32],
        join: Option<Join<'_>>,
        prepare: impl Fn(Finish<'_>) -> Finish<'_> + Sync,
        last: impl Fn(usize, &[f32]) + Sync,
    ) {
        let (width, height) = (2 * self.width, 2 * self.height);
        let row_len = width * self.channels;
        let bands = height.div_ceil(TASK_ROWS);
        (0..bands).into_par_iter().with_max_len(1).for_each(|band| {
            let (top, bottom) = (band * TASK_ROWS, height.min((band + 1) * TASK_ROWS));
            let (first, end) = (top.saturating_sub(1), height.min(bottom + 1));
            with_scratch((end - first) * row_len, |rows| {
                for (y, row) in (first..end).zip(rows.chunks_exact_mut(row_len)) {
                    self.enlarged_row(level, y, row);
                }
                if let Some(Join { map, layer }) = join {
                    let data = &map[first * width * layer.inputs..end * width * layer.inputs];
                    let input = Input::Rows { data, stride: layer.inputs };
                    let finish = Finish::store(rows, self.channels).onto();
                    let num_pixels = (end - first) * width;
                    gemm_part(level, &input, (0, num_pixels), (0, layer.num_panels()), layer, &finish);
                }
                let input = Input::Conv3(Conv3Input {
                    data: rows,
                    size: (width, height),
                    channels: self.channels,
                    first_row: first,
                    stride: 1,
                    out_width: width,
                    out_first_row: top,
                    zeros,
                });
                let num_pixels = (bottom - top) * width;
                with_scratch(num_pixels * weights.outputs, |out| {
                    let finish = prepare(Finish::store(out, weights.outputs));
                    gemm_part(level, &input, (0, num_pixels), (0, weights.num_panels()), weights, &finish);
                    last(top, out);
                });
            });
        });
    }
}

/// Copies a band of rows to its place.
///
/// # Safety
/// As [`SharedOut::row`]: bands do not overlap, and the output lives.
pub(crate) unsafe fn place(out: SharedOut, first_row: usize, row_len: usize, band: &[f32]) {
    // SAFETY: the caller's promise.
    unsafe { out.row(first_row * row_len, band.len()) }.copy_from_slice(band);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_stay_and_planes_stay_planes() {
        let (width, height) = (5, 3);
        let data: Vec<f32> =
            (0..width * height).flat_map(|i| [(i % width) as f32, (i / width) as f32]).collect();
        let pixels = Pixels { data: &data, width, height, channels: 2 };
        let mut out = vec![0.0; 4 * width * height * 2];
        pixels.enlarge(Simd::detect(), 2 * width, &mut out);
        for (idx, value) in out.chunks_exact(2).enumerate() {
            let x = (idx % (2 * width)) as f32 * (width - 1) as f32 / (2 * width - 1) as f32;
            let y = (idx / (2 * width)) as f32 * (height - 1) as f32 / (2 * height - 1) as f32;
            assert!((value[0] - x).abs() < 1e-5 && (value[1] - y).abs() < 1e-5, "{idx}");
        }
        assert_eq!(out[out.len() - 2..], [4.0, 2.0]);
    }
}
