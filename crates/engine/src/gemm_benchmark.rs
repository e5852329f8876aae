//! A plain matrix product, to measure what the machine can do.

use crate::buffer::Buffer;
use crate::gemm::{Finish, Input, gemm};
use crate::kernel::Simd;
use crate::packed::Packed;

/// A product of arbitrary matrices by the engine's own kernel, as large as its layers.
pub struct GemmBenchmark {
    rows: Buffer,
    weights: Packed,
    out: Buffer,
    num_rows: usize,
}

impl GemmBenchmark {
    /// `num_rows × inputs` times `inputs × outputs`.
    #[must_use]
    pub fn new(num_rows: usize, inputs: usize, outputs: usize) -> Self {
        let mut rows = Buffer::zeroed(num_rows * inputs);
        for (idx, value) in rows.iter_mut().enumerate() {
            *value = (idx % 251) as f32 / 251.0;
        }
        let weights =
            Packed::new(&[inputs], outputs, None, |output, input| ((output + input) % 127) as f32 / 127.0);
        Self { rows, weights, out: Buffer::zeroed(num_rows * outputs), num_rows }
    }

    /// Floating-point operations of a run.
    #[must_use]
    pub fn num_flops(&self) -> f64 {
        2.0 * self.num_rows as f64 * self.weights.inputs as f64 * self.weights.outputs as f64
    }

    /// Multiplies once.
    pub fn run(&mut self) {
        let input = Input::Rows { data: &self.rows, stride: self.weights.inputs };
        let finish = Finish::store(&mut self.out, self.weights.outputs);
        gemm(Simd::detect(), &input, self.num_rows, &self.weights, &finish);
    }
}
