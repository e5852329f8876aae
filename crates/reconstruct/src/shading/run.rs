//! Coarse to fine: steps of Gauss and Newton, each judged by the energy.

use super::ShadingOptions;
use super::anchor::Anchor;
use super::equations::{Equations, Regular, Solver};
use super::globals::Globals;
use super::linearise::{Fit, LawTable, Linearised, Shown, Surface, linearise};
use super::picture::PicturePyramid;
use crate::field::plate;
use selenograph_geometry::DMatrix;
use selenograph_raster::Raster;

/// What stays over the whole run.
pub(super) struct Problem<'a> {
    pub(super) pyramids: Vec<PicturePyramid>,
    /// Pixels of each picture along a cell of the finest level.
    pub(super) pixels_per_cell: Vec<f64>,
    pub(super) law: LawTable,
    pub(super) options: &'a ShadingOptions,
    /// Variance of what the pictures differ by from any model of them, in squares of their lit means.
    pub(super) noise2: f64,
    /// Stereo's answer, the finest level first.
    pub(super) anchors: Vec<Anchor>,
}

/// The answer on the cells.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub(super) surface: Surface,
    pub(super) globals: Globals,
    pub(super) fits: Vec<Fit>,
    /// Energy before the first and after each accepted step of the finest level.
    pub(super) energies: Vec<f64>,
}

impl Problem<'_> {
    /// The pictures at a level of the surface.
    pub(super) fn shown(&self, level_idx: usize) -> Vec<Shown<'_>> {
        let pictures = self.pyramids.iter().zip(&self.pixels_per_cell);
        pictures
            .map(|(pyramid, &pixels)| {
                let along = pixels * f64::from(1u32 << level_idx);
                let halvings = along.log2().round().max(0.0) as usize;
                let halvings = halvings.min(pyramid.levels.len() - 1);
                let share = (along / f64::from(1u32 << halvings)).powi(2).min(1.0) as f32;
                Shown { level: &pyramid.levels[halvings], mean: pyramid.mean, share }
            })
            .collect()
    }

    /// How much the priors weigh at a level against residuals in squares of the lit mean.
    fn weight_of_priors(&self) -> f32 {
        (self.noise2 / f64::from(self.options.typical_noise).powi(2)) as f32
    }

    pub(super) fn regular(&self, surface: &Surface, level_idx: usize) -> Regular {
        let weight = self.weight_of_priors();
        Regular {
            stiffness: Raster::filled(surface.width, surface.height, weight * self.options.stiffness),
            tension: weight * self.options.albedo_tension / f32::from(4u16.pow(level_idx as u32)),
            hold: weight * self.options.albedo_hold,
        }
    }

    /// Energy over the cells that are seen, scaled to `count` of them.
    fn energy(&self, surface: &Surface, globals: &Globals, linear: &Linearised, level_idx: usize) -> f64 {
        let regular = self.regular(surface, level_idx);
        let data: f64 = linear.fits.iter().map(|fit| fit.energy).sum();
        let mut pulled = vec![0.0; surface.heights.len()];
        plate::apply(&surface.heights, None, &regular.stiffness, &mut pulled);
        let bent = crate::field::conjugate::dot(&surface.heights, &pulled);
        let spotted = membrane_energy(surface, &regular);
        let anchored = self.anchors.get(level_idx).map_or(0.0, |a| a.energy(surface, self.anchor_weight()));
        let known: f64 = globals.free.iter().map(|f| self.noise2 * (f.deviation / f.sigma).powi(2)).sum();
        data + bent + spotted + anchored + known
    }

    fn anchor_weight(&self) -> f32 {
        self.weight_of_priors() * self.options.stereo_weight
    }

    /// From a start at the coarsest level to the finest.
    pub(super) fn run(&self, start: Vec<Surface>, mut globals: Globals) -> Option<Solution> {
        let mut surface = start.last()?.clone();
        let mut solution = None;
        for level_idx in (0..start.len()).rev() {
            let at = &start[level_idx];
            if surface.width != at.width {
                surface = surface.doubled(at);
            }
            let done = self.level(surface, globals, level_idx);
            surface = done.surface.clone();
            globals = done.globals.clone();
            solution = Some(done);
        }
        solution
    }

    fn level(&self, mut surface: Surface, mut globals: Globals, level_idx: usize) -> Solution {
        let shown = self.shown(level_idx);
        let mut solver = Solver::new(surface.width, surface.height);
        let options = self.options;
        let steps = options.steps[level_idx.min(options.steps.len() - 1)];
        let mut linear = linearise(&surface, &globals, &shown, &self.law, options.robust);
        let mut energy = self.energy(&surface, &globals, &linear, level_idx);
        let mut counted = linear.fits.iter().map(|fit| fit.count).sum::<f64>().max(1.0);
        let mut energies = vec![energy / counted];
        let mut damping = 0.0;
        for _ in 0..steps {
            let (stepped, next) = self.step(&surface, &globals, &linear, level_idx, damping, &mut solver);
            let there = linearise(&stepped, &next, &shown, &self.law, options.robust);
            let found = self.energy(&stepped, &next, &there, level_idx);
            let seen = there.fits.iter().map(|fit| fit.count).sum::<f64>().max(1.0);
            // NaN ends here too.
            if found / seen <= energy / counted * (1.0 + RISE) + SLACK * self.noise2 {
                (surface, globals, linear) = (stepped, next, there);
                (energy, counted) = (found, seen);
                energies.push(energy / counted);
                damping *= 0.25;
            } else {
                damping = (damping * 8.0).max(FIRST_DAMPING);
            }
        }
        Solution { surface, globals, fits: linear.fits, energies }
    }

    /// One linear step.
    fn step(
        &self,
        surface: &Surface,
        globals: &Globals,
        linear: &Linearised,
        level_idx: usize,
        damping: f32,
        solver: &mut Solver,
    ) -> (Surface, Globals) {
        let mut cells = linear.cells.clone();
        if let Some(anchor) = self.anchors.get(level_idx) {
            anchor.hold(surface, self.anchor_weight(), &mut cells);
        }
        let tells: Vec<f64> =
            cells.iter().map(|c| f64::from(c.matrix[0] + c.matrix[4])).filter(|t| *t > 0.0).collect();
        let typical = 0.5 * tells.iter().sum::<f64>() / tells.len().max(1) as f64;
        let (least, extra) = ((UNSEEN * typical) as f32, damping * typical as f32);
        for cell in &mut cells {
            for at in [0, 4] {
                cell.matrix[at] = cell.matrix[at].max(least) + extra;
            }
        }
        let num_free = globals.free.len();
        let mut own = linear.gram.clone();
        let mut pulled = linear.right.clone();
        for (g, free) in globals.free.iter().enumerate() {
            let precision = self.noise2 / (free.sigma * free.sigma);
            own[(g, g)] += precision + LEAST_PRECISION + f64::from(damping) * own[(g, g)];
            pulled[g] -= precision * free.deviation;
        }
        let inverse = own.try_inverse().unwrap_or_else(|| DMatrix::zeros(num_free, num_free));
        let equations = Equations {
            width: surface.width,
            height: surface.height,
            cells,
            regular: self.regular(surface, level_idx),
            columns: linear.columns.clone(),
            inverse,
        };
        let mut right = equations.right(&surface.heights, &surface.albedo);
        let weights = times(&equations.inverse, &pulled);
        for (column, weight) in equations.columns.iter().zip(&weights) {
            super::equations::add_scaled(&mut right, column, -*weight as f32);
        }
        let x = equations.solve(&right, solver, self.options.iterations, TOLERANCE);
        let explained: Vec<f64> = equations
            .columns
            .iter()
            .zip(&pulled)
            .map(|(column, pulled)| pulled - crate::field::conjugate::dot(column, &x))
            .collect();
        let step = times(&equations.inverse, &explained);
        let mut next = surface.clone();
        let (heights, albedo) = x.split_at(next.heights.len());
        super::equations::add_scaled(&mut next.heights, heights, 1.0);
        super::equations::add_scaled(&mut next.albedo, albedo, 1.0);
        (next, globals.stepped(&step))
    }
}

/// Share by which the energy may rise: cells that come into view or leave it change it too.
const RISE: f64 = 1e-3;
/// The same as a share of the noise's variance.
const SLACK: f64 = 0.05;
const FIRST_DAMPING: f32 = 0.3;
/// Damping of the slopes of cells that no picture shows, in that of typical ones: they follow their neighbours in small steps, and
/// the equations stay well conditioned.
const UNSEEN: f64 = 0.01;
/// Keeps the globals' matrix definite.
const LEAST_PRECISION: f64 = 1e-9;
/// The conjugate gradients stop when their residual has fallen by this.
const TOLERANCE: f64 = 1e-3;

fn times(matrix: &DMatrix<f64>, vector: &[f64]) -> Vec<f64> {
    let row = |k: usize| vector.iter().enumerate().map(|(l, v)| matrix[(k, l)] * v).sum();
    (0..vector.len()).map(row).collect()
}

fn membrane_energy(surface: &Surface, regular: &Regular) -> f64 {
    let (width, a) = (surface.width, &surface.albedo);
    let mut sum = 0.0f64;
    for (i, v) in a.iter().enumerate() {
        let right = if i % width + 1 < width { a[i + 1] - v } else { 0.0 };
        let below = a.get(i + width).map_or(0.0, |b| b - v);
        sum += f64::from(regular.tension * (right * right + below * below) + regular.hold * v * v);
    }
    sum
}

impl Surface {
    /// On the cells of the next finer level.
    fn doubled(&self, finer: &Self) -> Self {
        let double = |data: &[f32], scale: f32| {
            let raster = Raster { width: self.width, height: self.height, data: data.to_vec() };
            crate::field::filter::double(&raster, finer.width, finer.height, scale).data
        };
        Self { heights: double(&self.heights, 2.0), albedo: double(&self.albedo, 1.0), ..finer.clone() }
    }
}
