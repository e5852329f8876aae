//! Coarse to fine: steps of Gauss and Newton, each judged by the energy.

use super::ShadingOptions;
use super::anchor::Anchor;
use super::equations::{Equations, Solver};
use super::globals::Globals;
use super::linearise::{LawTable, Linearised, Shown, Surface, linearise};
use super::picture::PicturePyramid;
use super::weights::{Parts, Weights};
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
    /// Stereo's answer, the finest level first.
    pub(super) anchors: Vec<Anchor>,
}

/// Everything that is sought.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) surface: Surface,
    pub(super) globals: Globals,
}

/// The answer on the cells.
pub(super) struct Solution {
    pub(super) state: State,
    pub(super) weights: Weights,
    /// Energy before the first and after each accepted step of the finest level.
    pub(super) energies: Vec<f64>,
    /// The last step's equations.
    pub(super) linear: Linearised,
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

    /// Energy over the cells that are seen, scaled to `count` of them.
    fn energy(&self, state: &State, linear: &Linearised, weights: &Weights, level_idx: usize) -> f64 {
        let State { surface, globals } = state;
        let data: f64 = linear.fits.iter().map(|fit| fit.energy).sum();
        let bent = weights.stiffness() * surface.bent();
        let [stepped, squared] = surface.spotted();
        let spotted = weights.tension() * stepped + weights.hold() * squared;
        let anchor = self.anchors.get(level_idx);
        let anchored = anchor.map_or(0.0, |anchor| anchor.energy(surface, globals, weights.noise2 as f32));
        let known_weight = TOGETHER * weights.noise2;
        let known: f64 = globals.free.iter().map(|f| known_weight * (f.deviation / f.sigma).powi(2)).sum();
        data + bent + spotted + anchored + known
    }

    /// What the residuals say of the weights.
    fn reweighted(&self, linear: &Linearised, weights: &Weights) -> Weights {
        // One picture can be explained by albedo alone: it leaves nothing to tell the noise.
        if !self.options.estimate_weights || linear.fits.len() < 2 {
            return *weights;
        }
        weights.estimated(&Parts {
            cells: &linear.cells,
            residual2: linear.fits.iter().map(|fit| fit.residual2).sum(),
            weight: linear.fits.iter().map(|fit| fit.weight).sum(),
        })
    }

    /// From a start at the coarsest level to the finest.
    pub(super) fn run(&self, start: Vec<Surface>, globals: Globals) -> Option<Solution> {
        let mut state = State { surface: start.last()?.clone(), globals };
        let mut weights = self.options.weights(start.last()?, start.len() - 1);
        let mut solution = None;
        for level_idx in (0..start.len()).rev() {
            let at = &start[level_idx];
            if state.surface.width != at.width {
                state.surface = state.surface.doubled(at);
                weights = weights.finer();
            }
            let done = self.level(state, weights, level_idx);
            state = done.state.clone();
            weights = done.weights;
            solution = Some(done);
        }
        solution
    }

    fn level(&self, mut state: State, mut weights: Weights, level_idx: usize) -> Solution {
        let shown = self.shown(level_idx);
        let mut solver = Solver::new(state.surface.width, state.surface.height);
        let options = self.options;
        let steps = options.steps[level_idx.min(options.steps.len() - 1)];
        let linearised =
            |state: &State| linearise(&state.surface, &state.globals, &shown, &self.law, options.robust);
        let seen = |linear: &Linearised| linear.fits.iter().map(|fit| fit.count).sum::<f64>().max(1.0);
        let mut linear = linearised(&state);
        let mut energies = Vec::new();
        let mut damping = 0.0;
        for step_idx in 0..steps {
            // A surface that is still far away tells its distance and not the noise: coarse levels, and the first steps.
            if level_idx == 0 && step_idx >= FIRST_STEPS {
                weights = self.reweighted(&linear, &weights);
            }
            let energy = self.energy(&state, &linear, &weights, level_idx) / seen(&linear);
            energies.push(energy);
            let next = self.step(&state, &linear, &weights, level_idx, damping, &mut solver);
            let there = linearised(&next);
            let found = self.energy(&next, &there, &weights, level_idx) / seen(&there);
            // NaN ends here too.
            if found <= energy * (1.0 + RISE) + SLACK * weights.noise2 {
                (state, linear) = (next, there);
                damping *= 0.25;
            } else {
                damping = (damping * 8.0).max(FIRST_DAMPING);
            }
        }
        energies.push(self.energy(&state, &linear, &weights, level_idx) / seen(&linear));
        Solution { state, weights, energies, linear }
    }

    /// One linear step.
    fn step(
        &self,
        State { surface, globals }: &State,
        linear: &Linearised,
        weights: &Weights,
        level_idx: usize,
        damping: f32,
        solver: &mut Solver,
    ) -> State {
        let mut linear = linear.clone();
        if let Some(anchor) = self.anchors.get(level_idx) {
            anchor.hold(surface, globals, weights.noise2 as f32, &mut linear);
        }
        let Linearised { mut cells, columns, gram: mut own, right: mut pulled, .. } = linear;
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
        for (g, free) in globals.free.iter().enumerate() {
            let precision = TOGETHER * weights.noise2 / (free.sigma * free.sigma);
            own[(g, g)] += precision + LEAST_PRECISION + f64::from(damping) * own[(g, g)];
            pulled[g] -= precision * free.deviation;
        }
        let inverse = own.try_inverse().unwrap_or_else(|| DMatrix::zeros(num_free, num_free));
        let equations = Equations {
            width: surface.width,
            height: surface.height,
            cells,
            regular: weights.regular(surface.width, surface.height),
            columns,
            inverse,
        };
        let mut right = equations.right(&surface.heights, &surface.albedo);
        let shares = times(&equations.inverse, &pulled);
        for (column, weight) in equations.columns.iter().zip(&shares) {
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
        State { surface: next, globals: globals.stepped(&step) }
    }
}

/// Cells whose errors go together: law, albedo, interpolation and compression err over areas, and what is known beforehand of a
/// picture as a whole yields to so many fewer of them. Settled on realistic pictures of synthetic ground.
pub(super) const TOGETHER: f64 = 16.0;
/// Share by which the energy may rise: cells that come into view or leave it change it too.
const RISE: f64 = 1e-3;
/// The same as a share of the noise's variance.
const SLACK: f64 = 0.05;
const FIRST_DAMPING: f32 = 0.3;
/// Steps before the weights are estimated.
const FIRST_STEPS: usize = 2;
/// Damping of the slopes of cells that no picture shows, in that of typical ones: they follow their neighbours in small steps, and
/// the equations stay well conditioned.
const UNSEEN: f64 = 0.01;
/// Keeps the globals' matrix definite.
const LEAST_PRECISION: f64 = 1e-9;

/// The conjugate gradients stop when their residual has fallen by this.
pub(super) const TOLERANCE: f64 = 1e-3;

fn times(matrix: &DMatrix<f64>, vector: &[f64]) -> Vec<f64> {
    let row = |k: usize| vector.iter().enumerate().map(|(l, v)| matrix[(k, l)] * v).sum();
    (0..vector.len()).map(row).collect()
}

impl Surface {
    /// The plate's energy at stiffness 1.
    fn bent(&self) -> f64 {
        let mut pulled = vec![0.0; self.heights.len()];
        plate::apply(&self.heights, None, &Raster::filled(self.width, self.height, 1.0), &mut pulled);
        crate::field::conjugate::dot(&self.heights, &pulled)
    }

    /// Sums of the squares of the log albedo's steps between neighbours and of itself.
    fn spotted(&self) -> [f64; 2] {
        let (width, a) = (self.width, &self.albedo);
        let mut sums = [0.0f64; 2];
        for (i, v) in a.iter().enumerate() {
            let right = if i % width + 1 < width { a[i + 1] - v } else { 0.0 };
            let below = a.get(i + width).map_or(0.0, |b| b - v);
            sums[0] += f64::from(right * right + below * below);
            sums[1] += f64::from(v * v);
        }
        sums
    }

    /// On the cells of the next finer level.
    fn doubled(&self, finer: &Self) -> Self {
        let double = |data: &[f32], scale: f32| {
            let raster = Raster { width: self.width, height: self.height, data: data.to_vec() };
            crate::field::filter::double(&raster, finer.width, finer.height, scale).data
        };
        Self { heights: double(&self.heights, 2.0), albedo: double(&self.albedo, 1.0), ..finer.clone() }
    }

    /// On cells of twice the side; both sides are even.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |data: &[f32], x: usize, y: usize| {
            let at = 2 * y * self.width + 2 * x;
            0.25 * (data[at] + data[at + 1] + data[at + self.width] + data[at + self.width + 1])
        };
        let halve =
            |data: &[f32], scale: f32| Raster::from_fn(width, height, |x, y| scale * mean(data, x, y)).data;
        Self {
            width,
            height,
            scale: 2.0 * self.scale,
            sight: self.sight,
            heights: halve(&self.heights, 0.5),
            albedo: halve(&self.albedo, 1.0),
        }
    }
}
