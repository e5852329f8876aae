//! Rotary position encoding in two dimensions.

use crate::kernel::Simd;
use crate::vector::{Angles, rotate};

/// Cosines and sines of the angles of grid rows and columns.
pub(crate) struct Rope {
    cos: Vec<f32>,
    sin: Vec<f32>,
    quarter: usize,
}

impl Rope {
    /// For heads of `head_dim` channels (a multiple of four) and grids of up to `max_side` tokens a side.
    pub(crate) fn new(head_dim: usize, base: f64, max_side: usize) -> Self {
        let quarter = head_dim / 4;
        let angles: Vec<f64> = (0..max_side * quarter)
            .map(|idx| {
                let (position, k) = (idx / quarter, idx % quarter);
                position as f64 / base.powf(2.0 * k as f64 / (2 * quarter) as f64)
            })
            .collect();
        Self {
            cos: angles.iter().map(|a| a.cos() as f32).collect(),
            sin: angles.iter().map(|a| a.sin() as f32).collect(),
            quarter,
        }
    }

    /// Angles of zero, for tests of what surrounds the rotation.
    #[cfg(test)]
    pub(crate) fn still(head_dim: usize, max_side: usize) -> Self {
        let quarter = head_dim / 4;
        Self { cos: vec![1.0; max_side * quarter], sin: vec![0.0; max_side * quarter], quarter }
    }

    /// Rotates one token's head at grid position (`y`, `x`) and scales it by `factor`.
    pub(crate) fn apply(&self, level: Simd, at: (usize, usize), row: &[f32], factor: f32, out: &mut [f32]) {
        let part = |table: &'_ [f32], position: usize| -> std::ops::Range<usize> {
            debug_assert!((position + 1) * self.quarter <= table.len());
            position * self.quarter..(position + 1) * self.quarter
        };
        let (y, x) = (part(&self.cos, at.0), part(&self.cos, at.1));
        let angles = Angles {
            cos: [&self.cos[y.clone()], &self.cos[x.clone()]],
            sin: [&self.sin[y], &self.sin[x]],
        };
        rotate(level, row, angles, factor, out);
    }
}
