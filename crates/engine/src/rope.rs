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
        let angles =
            Angles { cos: [&self.cos[y.clone()], &self.cos[x.clone()]], sin: [&self.sin[y], &self.sin[x]] };
        rotate(level, row, angles, factor, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::levels;

    /// Rounding of f32 for values of a few units.
    const ROUNDING: f32 = 2e-6;

    #[test]
    fn shared_golden_rope() {
        let shared = std::env::var_os("SELENOGRAPH_SHARED")
            .unwrap_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").into());
        let Ok(bytes) = std::fs::read(std::path::Path::new(&shared).join("golden/rope.safetensors")) else {
            println!("SKIP shared-data: no goldens");
            return;
        };
        println!("RAN shared-data: golden rope");
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        for case in 0..4 {
            let view = |name: &str| file.tensor(&format!("case{case}.{name}")).unwrap();
            let floats = |name: &str| -> Vec<f32> {
                view(name).data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
            };
            let positions: Vec<usize> = view("pos")
                .data()
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| usize::try_from(i32::from_le_bytes(*b)).unwrap())
                .collect();
            let (tokens, expected) = (floats("tokens"), floats("out"));
            let &[_, heads, count, dim] = view("tokens").shape() else { panic!("tokens have four axes") };
            let rope = Rope::new(dim, 100.0, positions.iter().max().unwrap() + 1);
            for level in levels() {
                for (idx, (row, expected)) in tokens.chunks(dim).zip(expected.chunks(dim)).enumerate() {
                    let token = idx / (heads * count) * count + idx % count;
                    let mut out = vec![0.0; dim];
                    rope.apply(level, (positions[2 * token], positions[2 * token + 1]), row, 1.0, &mut out);
                    for (found, expected) in out.iter().zip(expected) {
                        assert!((found - expected).abs() < ROUNDING, "case {case}, {level:?}, row {idx}");
                    }
                }
            }
        }
    }
}
