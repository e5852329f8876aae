//! How sure the answer is: standard deviations of heights, slopes and albedo, and the covariance of what is unknown of whole
//! pictures.
//!
//! The covariance of the unknowns is the inverse of the last step's matrix times the noise's variance. Its diagonal is summed over
//! waves: a wave is held by the data of an area of about its own length, so each octave takes the mean tensor of squares of that
//! size, and the spectrum of plate and membrane. What the pictures as a whole leave unsure (gains, Suns, poses) tilts and bends
//! everything; its share follows from the joint elimination, on a coarser level of the pictures: it is smooth.
//!
//! # Source
//! Rue & Held 2005, "Gaussian Markov Random Fields" (variances of stationary fields by their spectrum); Triggs et al. 2000, "Bundle
//! adjustment: a modern synthesis", §B (covariance by the Schur complement).

use super::equations::{CellEquations, Equations, Solver, along, neighbours};
use super::globals::{Free, Global};
use super::linearise::linearise;
use super::run::{Problem, Solution, TOGETHER, TOLERANCE};
use super::weights::Weights;
use crate::field::conjugate::dot;
use crate::field::filter;
use rayon::prelude::*;
use selenograph_geometry::DMatrix;
use selenograph_raster::Raster;

/// Standard deviations on the cells of the finest level.
#[derive(Debug, Clone)]
pub(super) struct Uncertainty {
    /// Of the heights, cells.
    pub(super) heights: Raster<f32>,
    /// Of the slope's tangent, where the ground is steepest.
    pub(super) slopes: Raster<f32>,
    /// Of the log albedo.
    pub(super) albedo: Raster<f32>,
    /// Covariance of the free globals, in their order.
    pub(super) globals: DMatrix<f64>,
}

impl Uncertainty {
    /// Standard deviation of the free globals that are chosen, the mean over them; `None` where none is free.
    pub(super) fn of_globals(&self, free: &[Free], chosen: impl Fn(Global) -> bool) -> Option<f64> {
        let of_chosen = (0..free.len()).filter(|&g| chosen(free[g].global));
        let variances: Vec<f64> = of_chosen.map(|g| self.globals[(g, g)]).collect();
        (!variances.is_empty()).then(|| (variances.iter().sum::<f64>() / variances.len() as f64).sqrt())
    }
}

/// What is summed over the waves of a cell: variances of height, of both slopes with their covariance, of log albedo.
const NUM_SUMS: usize = 5;
type Sums = [f64; NUM_SUMS];

/// Waves along half a side of an octave's square.
const WAVES: usize = 4;
/// How many octaves longer than a wave is the square whose data hold it.
const REACH: usize = 1;
/// Least smaller side of the level that the globals' share is found on, cells.
const COARSE_SIDE: usize = 64;
/// Conjugate-gradient steps for each global, at that level.
const ITERATIONS: usize = 60;
/// Least share of a global's own information that is left to it: rounding leaves no less.
const LEAST_LEFT: f64 = 1e-6;

/// How much larger the waves' errors are than the noise that is left says: law, albedo and interpolation err over areas and not
/// cell by cell. Settled on realistic pictures of synthetic ground, where it makes two thirds of the slopes lie within one.
const DOUBT: f32 = 2.25;

pub(super) fn uncertainty(problem: &Problem<'_>, solution: &Solution) -> Uncertainty {
    let (surface, weights) = (&solution.state.surface, &solution.weights);
    let (width, height) = (surface.width, surface.height);
    let mut linear = solution.linear.clone();
    if let Some(anchor) = problem.anchors.first() {
        anchor.hold(surface, &solution.state.globals, weights.noise2 as f32, &mut linear);
    }
    let cells = linear.cells;
    let of_waves = of_waves(&cells, width, height, weights);
    let (of_globals, covariance) = of_globals(problem, solution);
    let total = |k: usize| -> Vec<f32> {
        let both = of_waves[k].data.iter().zip(&of_globals[k].data);
        both.map(|(a, b)| DOUBT * DOUBT * a + b).collect()
    };
    let [of_heights, uu, uv, vv, of_albedo] = std::array::from_fn(total);
    let sigma =
        |variances: Vec<f32>| Raster { width, height, data: variances.iter().map(|v| v.sqrt()).collect() };
    let mut slopes = vec![0.0; width * height];
    slopes.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let (above, below, factor) = neighbours(y, height);
        let here = &surface.heights[y * width..(y + 1) * width];
        for (x, out) in out.iter_mut().enumerate() {
            let at = y * width + x;
            let (u, v) = (
                along(here, x),
                factor * (surface.heights[below * width + x] - surface.heights[above * width + x]),
            );
            // On even ground no direction is the steepest: the mean over all.
            let any = 0.5 * (uu[at] + vv[at]);
            let steepest = u * u * uu[at] + 2.0 * u * v * uv[at] + v * v * vv[at];
            *out = (steepest + any * any) / (u * u + v * v + any).max(f32::MIN_POSITIVE);
        }
    });
    Uncertainty {
        heights: sigma(of_heights),
        slopes: sigma(slopes),
        albedo: sigma(of_albedo),
        globals: covariance,
    }
}

/// The waves' sums on the cells.
fn of_waves(
    cells: &[CellEquations],
    width: usize,
    height: usize,
    weights: &Weights,
) -> [Raster<f32>; NUM_SUMS] {
    let mut levels = vec![Raster {
        width,
        height,
        data: cells.iter().map(|cell| cell.matrix).collect::<Vec<[f32; 10]>>(),
    }];
    while let Some(last) = levels.last().filter(|last| last.width.min(last.height) > 1) {
        levels.push(mean_of_four(last));
    }
    let top = levels.len() - 1;
    let num_octaves = (width.max(height) as f64).log2().ceil() as usize;
    let at_octave = |octave: usize| (octave + REACH).min(top);
    let mut sums: Option<[Raster<f32>; NUM_SUMS]> = None;
    for level_idx in (0..=top).rev() {
        let level = &levels[level_idx];
        let (width, height) = (level.width, level.height);
        let mut here: [Raster<f32>; NUM_SUMS] = match sums {
            None => std::array::from_fn(|_| Raster::filled(width, height, 0.0)),
            Some(coarser) => coarser.map(|c| filter::double(&c, width, height, 1.0)),
        };
        let octaves: Vec<usize> = (0..num_octaves).filter(|&octave| at_octave(octave) == level_idx).collect();
        if !octaves.is_empty() {
            let found: Vec<Sums> = level
                .data
                .par_iter()
                .map(|mean| {
                    let mean = mean.map(f64::from);
                    let mut sums = [0.0; NUM_SUMS];
                    for &octave in &octaves {
                        add_octave(&mut sums, &mean, octave, weights);
                    }
                    sums
                })
                .collect();
            for (k, raster) in here.iter_mut().enumerate() {
                for (sum, found) in raster.data.iter_mut().zip(&found) {
                    *sum += found[k] as f32;
                }
            }
        }
        sums = Some(here);
    }
    sums.unwrap_or_else(|| std::array::from_fn(|_| Raster::filled(width, height, 0.0)))
}

/// Means over two by two; an odd last row or column stands alone.
fn mean_of_four(finer: &Raster<[f32; 10]>) -> Raster<[f32; 10]> {
    Raster::from_fn(finer.width.div_ceil(2), finer.height.div_ceil(2), |x, y| {
        let (right, below) = ((2 * x + 1).min(finer.width - 1), (2 * y + 1).min(finer.height - 1));
        let four = [(2 * x, 2 * y), (right, 2 * y), (2 * x, below), (right, below)];
        std::array::from_fn(|i| 0.25 * four.iter().map(|&at| finer[at][i]).sum::<f32>())
    })
}

/// Adds the variances in the waves between half and all of a largest wave number.
fn add_octave(sums: &mut Sums, mean: &[f64; 10], octave: usize, weights: &Weights) {
    let largest = std::f64::consts::PI / f64::from(1u32 << octave);
    let step = largest / WAVES as f64;
    // Every wave of this half plane stands for its opposite too.
    let share = weights.noise2 * 2.0 * (step / std::f64::consts::TAU).powi(2);
    for j in 0..2 * WAVES {
        for i in 0..WAVES {
            let (ku, kv) = ((i as f64 + 0.5) * step, (j as f64 + 0.5 - WAVES as f64) * step);
            if ku.max(kv.abs()) < 0.5 * largest {
                continue;
            }
            let [of_height, of_albedo] = weights.wave(mean, ku, kv).variances();
            let (su, sv) = (ku.sin(), kv.sin());
            let parts = [1.0, su * su, su * sv, sv * sv].map(|part| part * of_height);
            for (sum, part) in sums.iter_mut().zip(parts.into_iter().chain([of_albedo])) {
                *sum += share * part;
            }
        }
    }
}

/// What the globals' uncertainty adds on the cells, and their covariance.
fn of_globals(problem: &Problem<'_>, solution: &Solution) -> ([Raster<f32>; NUM_SUMS], DMatrix<f64>) {
    let (globals, mut weights) = (&solution.state.globals, solution.weights);
    let mut surface = solution.state.surface.clone();
    let mut sizes = vec![(surface.width, surface.height)];
    while surface.width.min(surface.height) >= 2 * COARSE_SIDE
        && surface.width % 2 + surface.height % 2 == 0
        && problem.pyramids.iter().all(|pyramid| sizes.len() < pyramid.levels.len())
    {
        surface = surface.halved();
        weights = weights.coarser();
        sizes.push((surface.width, surface.height));
    }
    let level_idx = sizes.len() - 1;
    let shown = problem.shown(level_idx);
    let mut linear = linearise(&surface, globals, &shown, &problem.law, problem.options.robust);
    if let Some(anchor) = problem.anchors.get(level_idx) {
        anchor.hold(&surface, globals, weights.noise2 as f32, &mut linear);
    }
    let (width, height) = (surface.width, surface.height);
    let columns = linear.columns;
    let num_free = columns.len();
    let equations = Equations {
        width,
        height,
        cells: linear.cells,
        regular: weights.regular(width, height),
        columns: Vec::new(),
        inverse: DMatrix::zeros(0, 0),
    };
    let mut solver = Solver::new(width, height);
    let responses: Vec<Vec<f32>> =
        columns.iter().map(|column| equations.solve(column, &mut solver, ITERATIONS, TOLERANCE)).collect();
    let own = |g: usize| linear.gram[(g, g)] + TOGETHER * weights.noise2 / globals.free[g].sigma.powi(2);
    // In units of each unknown's own information, so that they can be compared.
    let unit: Vec<f64> = (0..num_free).map(|g| own(g).max(f64::MIN_POSITIVE).sqrt()).collect();
    let left = DMatrix::from_fn(num_free, num_free, |g, h| {
        let known = if g == h { own(g) } else { linear.gram[(g, h)] };
        let spent = 0.5 * (dot(&columns[g], &responses[h]) + dot(&columns[h], &responses[g]));
        (known - spent) / (unit[g] * unit[h])
    });
    let eigen = left.symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|v| TOGETHER * weights.noise2 / v.max(LEAST_LEFT));
    let turned = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    let covariance = DMatrix::from_fn(num_free, num_free, |g, h| turned[(g, h)] / (unit[g] * unit[h]));
    let mut sums = shares_of(&responses, &covariance, width, height, level_idx);
    for &(width, height) in sizes.iter().rev().skip(1) {
        sums = sums.map(|coarser| filter::double(&coarser, width, height, 1.0));
    }
    (sums, covariance)
}

/// Variances that a covariance of the globals makes through what heights and albedo answer to each.
fn shares_of(
    responses: &[Vec<f32>],
    covariance: &DMatrix<f64>,
    width: usize,
    height: usize,
    halvings: usize,
) -> [Raster<f32>; NUM_SUMS] {
    let count = width * height;
    let cells = f64::from(1u32 << halvings);
    let mut out: [Raster<f32>; NUM_SUMS] = std::array::from_fn(|_| Raster::filled(width, height, 0.0));
    for y in 0..height {
        let (above, below, factor) = neighbours(y, height);
        for x in 0..width {
            let at = y * width + x;
            let told: Vec<[f64; 4]> = responses
                .iter()
                .map(|response| {
                    let u = along(&response[y * width..(y + 1) * width], x);
                    let v = factor * (response[below * width + x] - response[above * width + x]);
                    [
                        cells * f64::from(response[at]),
                        f64::from(u),
                        f64::from(v),
                        f64::from(response[count + at]),
                    ]
                })
                .collect();
            let of = |a: usize, b: usize| -> f32 {
                let mut sum = 0.0;
                for (g, one) in told.iter().enumerate() {
                    for (h, other) in told.iter().enumerate() {
                        sum += one[a] * covariance[(g, h)] * other[b];
                    }
                }
                sum as f32
            };
            for (raster, (a, b)) in out.iter_mut().zip([(0, 0), (1, 1), (1, 2), (2, 2), (3, 3)]) {
                raster.data[at] = of(a, b);
            }
        }
    }
    out
}
