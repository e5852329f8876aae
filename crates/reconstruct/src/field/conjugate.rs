//! Preconditioned conjugate gradients over flat rasters, the same for any number of threads.

use rayon::prelude::*;

/// Sum of products in f64 over fixed runs: the same for any number of threads.
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f64 {
    const RUN: usize = 1 << 14;
    let parts: Vec<f64> = a
        .par_chunks(RUN)
        .zip(b.par_chunks(RUN))
        .map(|(a, b)| {
            let mut lanes = [0.0f32; 16];
            let mut sum = 0.0f64;
            for (a, b) in a.chunks(512).zip(b.chunks(512)) {
                lanes.fill(0.0);
                for (a, b) in a.chunks_exact(16).zip(b.chunks_exact(16)) {
                    for i in 0..16 {
                        lanes[i] += a[i] * b[i];
                    }
                }
                let rest = a.len() / 16 * 16;
                let tail: f32 = a[rest..].iter().zip(&b[rest..]).map(|(a, b)| a * b).sum();
                sum += lanes.iter().map(|&v| f64::from(v)).sum::<f64>() + f64::from(tail);
            }
            sum
        })
        .collect();
    parts.iter().sum()
}

/// Their mean, 0 for none.
pub(crate) fn mean_of(values: &[f32]) -> f32 {
    (values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len().max(1) as f64) as f32
}

/// Buffers for one size.
pub(crate) struct ConjugateGradients {
    residual: Vec<f32>,
    direction: Vec<f32>,
    image: Vec<f32>,
    scaled: Vec<f32>,
}

impl ConjugateGradients {
    /// For this many unknowns.
    pub(crate) fn new(count: usize) -> Self {
        let empty = || vec![0.0; count];
        Self { residual: empty(), direction: empty(), image: empty(), scaled: empty() }
    }

    /// Improves `x` towards `apply(x) = right` in at most `iterations` steps, or until the residual has fallen by `tolerance`
    /// in the preconditioner's norm. `apply` fills its second argument; `precondition` works in place.
    pub(crate) fn solve(
        &mut self,
        x: &mut [f32],
        right: &[f32],
        mut apply: impl FnMut(&[f32], &mut [f32]),
        mut precondition: impl FnMut(&mut [f32]),
        iterations: usize,
        tolerance: f64,
    ) {
        apply(x, &mut self.image);
        for ((r, &b), &i) in self.residual.iter_mut().zip(right).zip(&self.image) {
            *r = b - i;
        }
        let mut rho_before = 0.0;
        let mut first = None;
        for _ in 0..iterations {
            self.scaled.copy_from_slice(&self.residual);
            precondition(&mut self.scaled);
            let rho = dot(&self.residual, &self.scaled);
            let start = *first.get_or_insert(rho);
            if rho <= start * tolerance * tolerance || !rho.is_finite() {
                return;
            }
            let beta = if rho_before > 0.0 { (rho / rho_before) as f32 } else { 0.0 };
            for (d, &s) in self.direction.iter_mut().zip(&self.scaled) {
                *d = s + beta * *d;
            }
            apply(&self.direction, &mut self.image);
            let curvature = dot(&self.direction, &self.image);
            if curvature <= 0.0 || curvature.is_nan() {
                return;
            }
            let step = (rho / curvature) as f32;
            for ((v, r), (&d, &i)) in
                x.iter_mut().zip(&mut self.residual).zip(self.direction.iter().zip(&self.image))
            {
                *v += step * d;
                *r -= step * i;
            }
            rho_before = rho;
        }
    }
}
