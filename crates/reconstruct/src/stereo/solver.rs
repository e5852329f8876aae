//! The linear step: a diagonal data term and a thin plate.

use crate::field::conjugate::{ConjugateGradients, mean_of};
use crate::field::cosine::{Preconditioner, Symbol};
use crate::field::plate;
use selenograph_raster::Raster;

/// Buffers of the conjugate gradients for one size.
pub(crate) struct Solver {
    preconditioner: Preconditioner,
    gradients: ConjugateGradients,
}

impl Solver {
    /// For rasters of this size.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self {
            preconditioner: Preconditioner::new(width, height),
            gradients: ConjugateGradients::new(width * height),
        }
    }

    /// Improves `q` towards `(weight + P) q = right`, in at most `iterations` steps or until the residual has
    /// fallen by `tolerance`.
    pub(crate) fn solve(
        &mut self,
        q: &mut Raster<f32>,
        weight: &[f32],
        right: &[f32],
        stiffness: &Raster<f32>,
        iterations: usize,
        tolerance: f64,
    ) {
        let mass = mean_of(weight).max(f32::MIN_POSITIVE * 1e6);
        let symbol = Symbol { mass, plate: mean_of(&stiffness.data), ..Symbol::default() };
        let preconditioner = &mut self.preconditioner;
        self.gradients.solve(
            &mut q.data,
            right,
            |x, out| plate::apply(x, Some(weight), stiffness, out),
            |x| preconditioner.run(x, &symbol),
            iterations,
            tolerance,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solver_finds_what_made_the_right_side() {
        let truth = Raster::from_fn(40, 30, |x, y| (0.2 * x as f32).sin() * 3.0 + 0.1 * y as f32);
        let weight: Vec<f32> =
            (0..1200).map(|i| if i % 3 == 0 { 0.0 } else { 0.5 + (i % 5) as f32 }).collect();
        let mut right = vec![0.0; 1200];
        let stiffness = Raster::from_fn(40, 30, |x, _| if x < 20 { 2.0 } else { 1.0 });
        plate::apply(&truth.data, Some(&weight), &stiffness, &mut right);
        let mut q = Raster::filled(40, 30, 0.0);
        Solver::new(40, 30).solve(&mut q, &weight, &right, &stiffness, 200, 1e-7);
        let worst = q.data.iter().zip(&truth.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{worst}");
    }
}
