//! How much data, plate and membrane weigh against each other: it follows from the pictures.

use super::equations::{CellEquations, Regular};
use selenograph_raster::Raster;

/// Variances of the parts of the model: noise of the pictures, curvature of the ground, steps of its albedo. A weight is a ratio of
/// two of them.
///
/// Only the noise is estimated, and the albedo follows from it: what a surface of one albedo leaves unexplained is noise and
/// albedo at once, and pictures under one Sun cannot tell them from relief. Pictures that a surface explains to parts in a
/// thousand show even ground; what leaves more is given room in the albedo, growing with the variance that is left.
///
/// # Source
/// MacKay 1992, "Bayesian interpolation", Neural Computation 4(3): the noise is what the residuals come to, over the number of
/// measurements that are not spent on the unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Weights {
    /// Of what the pictures differ by from any model of them, in squares of their lit means.
    pub(super) noise2: f64,
    /// Of the second differences of the heights, cells.
    pub(super) curvature2: f64,
    /// Of the differences of log albedo between neighbours, over the square of `noise2`.
    pub(super) albedo2_per_noise4: f64,
    /// Cells over which the albedo forgets itself: what holds it to the law's is the tension over its square.
    pub(super) reach: f64,
}

/// What the noise's variance is believed to be at all: below a part in a thousand no model is right.
const NOISE2: [f64; 2] = [1e-6, 4e-3];

/// What a level of the surface comes to.
pub(super) struct Parts<'a> {
    pub(super) cells: &'a [CellEquations],
    /// `Σ w r²` over all pictures and cells, and `Σ w`.
    pub(super) residual2: f64,
    pub(super) weight: f64,
}

/// Waves along an axis that the evidence is summed over.
const WAVES: usize = 12;

impl Weights {
    pub(super) fn regular(&self, width: usize, height: usize) -> Regular {
        Regular {
            stiffness: Raster::filled(width, height, self.stiffness() as f32),
            tension: self.tension() as f32,
            hold: self.hold() as f32,
        }
    }

    /// Of the plate that the heights form, against squares of residuals.
    pub(super) fn stiffness(&self) -> f64 {
        self.noise2 / self.curvature2
    }

    /// Of the membrane that the log albedo forms.
    pub(super) fn tension(&self) -> f64 {
        1.0 / (self.noise2 * self.albedo2_per_noise4)
    }

    /// What holds the log albedo to the law's.
    pub(super) fn hold(&self) -> f64 {
        self.tension() / (self.reach * self.reach)
    }

    /// For cells of half the side: slopes go on as they are, albedo is smooth.
    pub(super) fn finer(&self) -> Self {
        Self { albedo2_per_noise4: 0.25 * self.albedo2_per_noise4, reach: 2.0 * self.reach, ..*self }
    }

    /// For cells of twice the side.
    pub(super) fn coarser(&self) -> Self {
        Self { albedo2_per_noise4: 4.0 * self.albedo2_per_noise4, reach: 0.5 * self.reach, ..*self }
    }

    /// From what the surface comes to under the present ones.
    pub(super) fn estimated(&self, parts: &Parts<'_>) -> Self {
        let mut mean = [0.0f64; 10];
        let mut seen = 0.0f64;
        for cell in parts.cells.iter().filter(|cell| cell.matrix[9] > 0.0) {
            seen += 1.0;
            for (sum, &m) in mean.iter_mut().zip(&cell.matrix) {
                *sum += f64::from(m);
            }
        }
        if seen < 1.0 {
            return *self;
        }
        let spent = seen * self.spent(&mean.map(|sum| sum / seen));
        // Some of the measurements must be left to tell the noise.
        let left = (parts.weight - spent).max(LEAST_LEFT * parts.weight);
        Self { noise2: (parts.residual2 / left).clamp(NOISE2[0], NOISE2[1]), ..*self }
    }

    /// Measurements per cell that go into heights and albedo: the trace of `1 − Λ (D + Λ)⁻¹`, averaged over all waves on the grid.
    fn spent(&self, mean: &[f64; 10]) -> f64 {
        let mut sum = 0.0;
        for j in 0..2 * WAVES {
            for i in 0..WAVES {
                let number = |n: f64| std::f64::consts::PI * n / WAVES as f64;
                let wave = self.wave(mean, number(i as f64 + 0.5), number(j as f64 + 0.5 - WAVES as f64));
                let [of_height, of_albedo] = wave.variances();
                sum += 2.0 - wave.plate * of_height - wave.membrane * of_albedo;
            }
        }
        (sum / (2 * WAVES * WAVES) as f64).clamp(0.0, 2.0)
    }
}

/// What holds one wave of heights and albedo on ground that is everywhere alike, per cell.
pub(super) struct Wave {
    /// Of the heights: data and plate, and the plate alone.
    heights: f64,
    plate: f64,
    /// Of the log albedo: data and membrane, and the membrane alone.
    albedo: f64,
    membrane: f64,
    /// Square of what the data say of both at once.
    across2: f64,
}

impl Wave {
    /// Variances of height and log albedo in this wave, over that of the noise.
    pub(super) fn variances(&self) -> [f64; 2] {
        let determinant = self.heights * self.albedo - self.across2;
        let determinant = determinant.max(1e-12 * self.heights * self.albedo);
        [self.albedo / determinant, self.heights / determinant]
    }
}

impl Weights {
    /// What holds the wave of these numbers (radians per cell) where the cells' mean tensor is this.
    pub(super) fn wave(&self, mean: &[f64; 10], ku: f64, kv: f64) -> Wave {
        let [uu, uv, _, ua, vv, _, va, hh, ha, aa] = *mean;
        let (su, sv) = (ku.sin(), kv.sin());
        // Differences are odd, heights and albedo even: their products are imaginary and drop out of the power.
        let of_heights = uu * su * su + 2.0 * uv * su * sv + vv * sv * sv + hh;
        let curved = 2.0 * (1.0 - ku.cos()) + 2.0 * (1.0 - kv.cos());
        let (plate, membrane) = (self.stiffness() * curved * curved, self.tension() * curved + self.hold());
        Wave {
            heights: of_heights + plate,
            plate,
            albedo: aa + membrane,
            membrane,
            across2: (ua * su + va * sv).powi(2) + ha * ha,
        }
    }
}

/// Share of the measurements that are left to tell the noise, however free the surface.
const LEAST_LEFT: f64 = 0.02;
