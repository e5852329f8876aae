//! The model's pictures against the pictures, and how they change with every unknown.

use super::equations::{CellEquations, Equations, PerUnknown, along, neighbours};
use super::globals::{Global, Globals, PHASE_MIDDLE, Shot, across};
use super::patch::Sight;
use super::picture::{PictureLevel, Sample};
use crate::field::filter::ROWS_PER_TASK;
use rayon::prelude::*;
use selenograph_geometry::DMatrix;
use selenograph_raster::Raster;
use selenograph_render::brdf::Brdf;

/// Cosine of incidence below which the law goes on in a straight line: a model in shadow must still feel which way is brighter.
const LEAST_MU0: f32 = 0.02;
/// Least cosine of emission.
const LEAST_MU: f32 = 0.05;

/// A law with what it needs of the phase angle in a table over `sin(g/2)`.
pub(super) struct LawTable {
    brdf: Brdf,
    /// The law's phase part, and the phase angle from the middle.
    table: Vec<[f32; 2]>,
}

/// Steps of the table: half a degree of phase holds the opposition surge to 1e-3.
const TABLE_STEPS: usize = 1024;

impl LawTable {
    pub(super) fn new(brdf: &Brdf) -> Self {
        let entry = |i: usize| {
            let sine = i as f64 / TABLE_STEPS as f64;
            let part = brdf.phase_part(1.0 - 2.0 * sine * sine);
            [part as f32, (2.0 * sine.asin()) as f32 - PHASE_MIDDLE]
        };
        Self { brdf: *brdf, table: (0..=TABLE_STEPS).map(entry).collect() }
    }

    /// Phase part, phase angle from the middle, and the phase part's derivative by the cosine of the phase angle.
    #[inline]
    fn at(&self, cos_phase: f32) -> [f32; 3] {
        let place = (0.5 - 0.5 * cos_phase).clamp(0.0, 1.0).sqrt() * TABLE_STEPS as f32;
        let first = (place as usize).min(TABLE_STEPS - 1);
        let share = place - first as f32;
        let (a, b) = (self.table[first], self.table[first + 1]);
        // cos g = 1 − 2 sin²(g/2): a step of the table is −4 sin(g/2) of it.
        let by_cos = (b[0] - a[0]) * (TABLE_STEPS * TABLE_STEPS) as f32 / (-4.0 * (first as f32 + 0.5));
        [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), by_cos]
    }
}

/// The surface at one level.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Cells of the finest level along one of this.
    pub(super) scale: f32,
    /// Lines that the heights are counted along.
    pub(super) sight: Sight,
    /// Heights in cells of this level.
    pub(super) heights: Vec<f32>,
    /// Logarithm of the albedo against the law's.
    pub(super) albedo: Vec<f32>,
}

/// A picture at the level of the surface.
pub(super) struct Shown<'a> {
    pub(super) level: &'a PictureLevel,
    /// Lit mean, the unit of residuals.
    pub(super) mean: f32,
    /// Pixels' worth of a cell, at most 1.
    pub(super) share: f32,
}

/// How well a picture is explained.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Fit {
    /// Cells that are compared.
    pub(super) count: f64,
    /// Sum of the robust weights.
    pub(super) weight: f64,
    /// Robust energy.
    pub(super) energy: f64,
    /// Sum of the weighted squares of the residuals.
    pub(super) residual2: f64,
}

impl Fit {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.weight += other.weight;
        self.energy += other.energy;
        self.residual2 += other.residual2;
    }
}

/// What a step needs.
#[derive(Clone)]
pub(super) struct Linearised {
    pub(super) cells: Vec<CellEquations>,
    pub(super) columns: Vec<Vec<f32>>,
    /// `Σ w c cᵀ` of the globals.
    pub(super) gram: DMatrix<f64>,
    /// `Σ w c r` of the globals.
    pub(super) right: Vec<f64>,
    pub(super) fits: Vec<Fit>,
}

/// One cell in one picture.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    sample: Sample,
    ground: Ground,
    /// The model's grey level in the picture's lit mean, without the offset.
    pub(super) model: f32,
    /// Picture less model, in the picture's lit mean.
    pub(super) residual: f32,
    by_mu0: f32,
    by_mu: f32,
    by_cos_phase: f32,
    mu0: f32,
    mu: f32,
    eye: [f32; 3],
    sun: [f32; 3],
    inverse_range: f32,
    /// Phase angle from the middle of the phase polynomial.
    phase: f32,
}

/// The geometry and the residual of a cell; `None` where the picture tells nothing.
#[inline]
pub(super) fn see(
    law: &LawTable,
    globals: &Globals,
    shot: &Shot,
    shown: &Shown<'_>,
    ground: Ground,
    albedo: f32,
) -> Option<Seen> {
    let placed = &shot.placed;
    let sample = shown.level.sample(placed.in_cam(ground.position))?;
    let normal = ground.normal;
    let to_eye: [f32; 3] = std::array::from_fn(|i| placed.eye[i] - ground.position[i]);
    let inverse_range = 1.0 / product(to_eye, to_eye).sqrt();
    let eye = to_eye.map(|c| c * inverse_range);
    let mu0 = product(normal, placed.sun);
    let mu = product(normal, eye).max(LEAST_MU);
    let held = mu0.max(LEAST_MU0);
    let [part, phase, part_by_cos] = law.at(product(eye, placed.sun));
    let reflected = law.brdf.slopes(f64::from(held), f64::from(mu), f64::from(part));
    let [one, two] = globals.phase;
    let scale = shot.gain * (albedo + (one + two * phase) * phase).exp();
    let (value, by_mu0, by_mu) =
        (reflected.value as f32 * scale, reflected.by_mu0 as f32 * scale, reflected.by_mu as f32 * scale);
    let by_cos_phase = reflected.by_phase_part as f32 * scale * part_by_cos;
    let model = value + by_mu0 * (mu0 - held);
    let residual = sample.grey / shown.mean - model - shot.offset;
    Some(Seen {
        sample,
        ground,
        model,
        residual,
        by_mu0,
        by_mu,
        by_cos_phase,
        mu0,
        mu,
        eye,
        sun: placed.sun,
        inverse_range,
        phase,
    })
}

#[inline]
fn product(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Seen {
    /// How the model less the picture changes with the cell's unknowns.
    #[inline]
    pub(super) fn jacobian(&self, shot: &Shot, shown: &Shown<'_>, sight: &Sight, scale: f32) -> PerUnknown {
        let (sun, eye) = (shot.placed.sun, self.eye);
        let Ground { line, normal, inverse_length, .. } = self.ground;
        // The normal before it gets its length changes by `d`: so do both cosines, less what is along the normal.
        let by = |d: [f32; 3]| {
            let along = product(normal, d);
            inverse_length
                * (self.by_mu0 * (product(sun, d) - self.mu0 * along)
                    + self.by_mu * (product(eye, d) - self.mu * along))
        };
        let moved = std::array::from_fn(|i| scale * product(shot.placed.rotation[i], line));
        let by_height = by([0.0, 0.0, -sight.inverse * scale]) + self.eye_change(line.map(|c| -scale * c))
            - self.picture_change(moved, shown);
        [by([-1.0, 0.0, line[0]]), by([0.0, -1.0, line[1]]), by_height, self.model]
    }

    /// How the model changes when the camera moves against the cell, along the grid's axes.
    #[inline]
    fn eye_change(&self, moved: [f32; 3]) -> f32 {
        let along = product(self.eye, moved);
        let by_mu = product(self.ground.normal, moved) - self.mu * along;
        let by_cos_phase = product(self.sun, moved) - product(self.sun, self.eye) * along;
        self.inverse_range * (self.by_mu * by_mu + self.by_cos_phase * by_cos_phase)
    }

    /// How the picture changes in its lit mean when the cell moves in the camera's axes.
    #[inline]
    fn picture_change(&self, moved: [f32; 3], shown: &Shown<'_>) -> f32 {
        let [by_x, by_y] = ray_change(self.sample.at, moved);
        (self.sample.by_ray[0] * by_x + self.sample.by_ray[1] * by_y) / shown.mean
    }

    /// How the model less the picture changes with a global unknown.
    #[inline]
    pub(super) fn column(&self, axes: &Axes, global: Global, shown: &Shown<'_>) -> f32 {
        let at = self.sample.at;
        match global {
            Global::Gain(_) => self.model,
            Global::Offset(_) => 1.0,
            Global::Phase(power) => self.model * self.phase.powi(power as i32 + 1),
            Global::Sun(_, axis) => {
                let across = axes.sun[axis];
                self.by_mu0 * product(self.ground.normal, across)
                    + self.by_cos_phase * product(self.eye, across)
            }
            Global::Turn(..) => -self.picture_change(axes.ground_moves(global, at), shown),
            Global::Move(_, axis) => {
                let moved = axes.ground_moves(global, at);
                self.eye_change(axes.eye_moves[axis]) - self.picture_change(moved, shown)
            }
        }
    }
}

/// Axes of a picture's own unknowns.
pub(super) struct Axes {
    sun: [[f32; 3]; 2],
    /// Moves of the ground in the camera's axes.
    moves: [[f32; 3]; 3],
    /// What they are of the camera along the grid's axes.
    eye_moves: [[f32; 3]; 3],
}

impl Axes {
    pub(super) fn of(globals: &Globals, picture: usize) -> Self {
        let first_eye = globals.shots.first().map_or([0.0; 3], |shot| shot.placed.eye);
        let shot = &globals.shots[picture];
        let (moves, r) = (shot.moves(first_eye), &shot.placed.rotation);
        let eye_moves =
            moves.map(|m| std::array::from_fn(|i| -(r[0][i] * m[0] + r[1][i] * m[1] + r[2][i] * m[2])));
        Self { sun: across(shot.placed.sun), moves, eye_moves }
    }

    /// How the ground at a place in the camera's axes moves there with an unknown of the camera's pose.
    #[inline]
    fn ground_moves(&self, global: Global, at: [f32; 3]) -> [f32; 3] {
        match global {
            Global::Turn(_, 0) => [0.0, -at[2], at[1]],
            Global::Turn(_, 1) => [at[2], 0.0, -at[0]],
            Global::Turn(..) => [-at[1], at[0], 0.0],
            Global::Move(_, axis) => self.moves[axis],
            _ => [0.0; 3],
        }
    }
}

/// How `x/z` and `y/z` of a place in the camera's axes change when it moves.
#[inline]
fn ray_change(at: [f32; 3], moved: [f32; 3]) -> [f32; 2] {
    let inverse = 1.0 / at[2];
    let by = |axis: usize| (moved[axis] - at[axis] * inverse * moved[2]) * inverse;
    [by(0), by(1)]
}

/// Residuals, robust weights and derivatives of all pictures on the cells.
pub(super) fn linearise(
    surface: &Surface,
    globals: &Globals,
    shown: &[Shown<'_>],
    law: &LawTable,
    robust: f32,
) -> Linearised {
    let (width, height) = (surface.width, surface.height);
    let count = width * height;
    let num_free = globals.free.len();
    let mut out = Linearised {
        cells: vec![CellEquations::default(); count],
        columns: vec![vec![0.0; 2 * count]; num_free],
        gram: DMatrix::zeros(num_free, num_free),
        right: vec![0.0; num_free],
        fits: Vec::with_capacity(shown.len()),
    };
    let inverse_robust = 1.0 / (robust * robust);
    for (k, (shot, shown)) in globals.shots.iter().zip(shown).enumerate() {
        let own: Vec<usize> = (0..num_free).filter(|&g| globals.free[g].global.is_of(k)).collect();
        let axes = Axes::of(globals, k);
        let mut fields = vec![[0.0f32; 4]; own.len() * count];
        let rows = width * ROWS_PER_TASK;
        let field_rows = (rows * own.len()).max(1);
        let mut no_fields = vec![[]; count.div_ceil(rows)];
        let field_chunks: Vec<&mut [PerUnknown]> = if own.is_empty() {
            no_fields.iter_mut().map(|empty: &mut [PerUnknown; 0]| empty.as_mut_slice()).collect()
        } else {
            fields.chunks_mut(field_rows).collect()
        };
        let parts: Vec<(Fit, Vec<f64>)> = out
            .cells
            .par_chunks_mut(rows)
            .zip(field_chunks)
            .enumerate()
            .map(|(task, (cells, fields))| {
                let mut fit = Fit::default();
                let mut sums = vec![0.0f64; own.len() * (own.len() + 1)];
                let mut c = vec![0.0f32; own.len()];
                for (i, cell) in cells.iter_mut().enumerate() {
                    let (x, y) = (i % width, task * ROWS_PER_TASK + i / width);
                    let (ground, albedo) = (surface.ground(x, y), surface.albedo[y * width + x]);
                    let Some(seen) = see(law, globals, shot, shown, ground, albedo) else { continue };
                    let r = seen.residual;
                    let pull = 1.0 / (1.0 + r * r * inverse_robust);
                    let weight = shown.share * pull * pull;
                    let j = seen.jacobian(shot, shown, &surface.sight, surface.scale);
                    cell.add(weight, j, r);
                    fit.tell(&seen, weight, f64::from(shown.share * r * r * pull));
                    for (c, &g) in c.iter_mut().zip(&own) {
                        *c = seen.column(&axes, globals.free[g].global, shown);
                    }
                    for a in 0..own.len() {
                        let scaled = weight * c[a];
                        // A field lies whole within its chunk: row block by row block, unknown by unknown.
                        fields[a * cells_of(fields.len(), own.len()) + i] = j.map(|j| scaled * j);
                        for b in a..own.len() {
                            sums[a * own.len() + b] += f64::from(scaled * c[b]);
                        }
                        sums[own.len() * own.len() + a] += f64::from(scaled * r);
                    }
                }
                (fit, sums)
            })
            .collect();
        let mut fit = Fit::default();
        for (part, sums) in &parts {
            fit.add(part);
            for (a, &ga) in own.iter().enumerate() {
                for (b, &gb) in own.iter().enumerate().skip(a) {
                    let value = sums[a * own.len() + b];
                    out.gram[(ga, gb)] += value;
                    if ga != gb {
                        out.gram[(gb, ga)] += value;
                    }
                }
                out.right[ga] += sums[own.len() * own.len() + a];
            }
        }
        out.fits.push(fit);
        for (a, &g) in own.iter().enumerate() {
            let mut field = Vec::with_capacity(count);
            for chunk in fields.chunks(field_rows) {
                let cells = cells_of(chunk.len(), own.len());
                field.extend_from_slice(&chunk[a * cells..(a + 1) * cells]);
            }
            let gathered = Equations::gathered(width, height, &field);
            for (sum, v) in out.columns[g].iter_mut().zip(gathered) {
                *sum += v;
            }
        }
    }
    out
}

/// How many pictures show each cell lit.
pub(super) fn num_seen(surface: &Surface, globals: &Globals, shown: &[Shown<'_>]) -> Raster<u8> {
    let (width, height) = (surface.width, surface.height);
    let mut out = Raster::filled(width, height, 0u8);
    out.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, count) in row.iter_mut().enumerate() {
            let position = surface.ground(x, y).position;
            let sees = |(shot, shown): &(&Shot, &Shown<'_>)| {
                shown.level.sample(shot.placed.in_cam(position)).is_some()
            };
            *count = globals.shots.iter().zip(shown).filter(sees).count().min(255) as u8;
        }
    });
    out
}

/// Rounds of reweighting of the first gain.
const GAIN_ROUNDS: usize = 4;
/// Residual that counts a quarter when the first gain is sought.
const GAIN_ROBUST: f32 = 0.15;

/// The gain that makes the model of a picture as bright as the picture.
pub(super) fn first_gain(
    surface: &Surface,
    globals: &Globals,
    picture: usize,
    shown: &Shown<'_>,
    law: &LawTable,
) -> f32 {
    let shot = Shot { gain: 1.0, ..globals.shots[picture] };
    let mut seen: Vec<[f32; 2]> = Vec::new();
    for y in 0..surface.height {
        for x in 0..surface.width {
            let found = see(law, globals, &shot, shown, surface.ground(x, y), 0.0);
            seen.extend(found.filter(|s| s.mu0 > LEAST_MU0).map(|s| [s.sample.grey / shown.mean, s.model]));
        }
    }
    let mut gain = None;
    for _ in 0..GAIN_ROUNDS {
        let (mut above, mut below) = (0.0f64, 0.0f64);
        for [grey, model] in &seen {
            let r = gain.map_or(0.0, |gain: f32| (grey - gain * model) / GAIN_ROBUST);
            let weight = f64::from(1.0 / (1.0 + r * r).powi(2));
            above += weight * f64::from(grey * model);
            below += weight * f64::from(model * model);
        }
        gain = (below > 0.0).then_some((above / below) as f32);
    }
    gain.unwrap_or(1.0)
}

/// Cells of a chunk of fields.
fn cells_of(length: usize, num_fields: usize) -> usize {
    length / num_fields.max(1)
}

impl Fit {
    fn tell(&mut self, seen: &Seen, weight: f32, energy: f64) {
        self.count += 1.0;
        self.weight += f64::from(weight);
        self.energy += energy;
        self.residual2 += f64::from(weight * seen.residual * seen.residual);
    }
}

impl Surface {
    /// How a cell's height, as the disparity of two pictures tells it, changes with the pose of this one: the ground stays at the
    /// pixel where it was matched, as far as that is told along the way that height moves it.
    pub(super) fn heights_follow(
        &self,
        (x, y): (usize, usize),
        shot: &Shot,
        axes: &Axes,
        pose: impl Iterator<Item = Global>,
    ) -> impl Iterator<Item = f32> {
        let ground = self.ground(x, y);
        let at = shot.placed.in_cam(ground.position);
        let higher = std::array::from_fn(|i| self.scale * product(shot.placed.rotation[i], ground.line));
        let [hx, hy] = ray_change(at, higher);
        let squared = hx * hx + hy * hy;
        pose.map(move |global| {
            let [px, py] = ray_change(at, axes.ground_moves(global, at));
            let change = -(hx * px + hy * py) / squared;
            if change.is_finite() { change } else { 0.0 }
        })
    }

    /// A cell's ground.
    #[inline]
    pub(super) fn ground(&self, x: usize, y: usize) -> Ground {
        let width = self.width;
        let (above, below, factor) = neighbours(y, self.height);
        let here = &self.heights[y * width..(y + 1) * width];
        let slopes =
            [along(here, x), factor * (self.heights[below * width + x] - self.heights[above * width + x])];
        let place = [(x as f32 + 0.5) * self.scale, (y as f32 + 0.5) * self.scale, here[x] * self.scale];
        let line = self.sight.line(place[0], place[1]);
        let upright = self.sight.narrowing(place[2]) + line[0] * slopes[0] + line[1] * slopes[1];
        let inverse_length = 1.0 / (slopes[0] * slopes[0] + slopes[1] * slopes[1] + upright * upright).sqrt();
        let normal = [-slopes[0] * inverse_length, -slopes[1] * inverse_length, upright * inverse_length];
        Ground { position: self.sight.position(place), line, normal, inverse_length }
    }
}

/// The ground of a cell. With the line `d = (dx, dy, 1)` and what it narrows to, `κ`, the normal is along
/// `(−h_u, −h_v, κ + dx h_u + dy h_v)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ground {
    pub(super) position: [f32; 3],
    line: [f32; 3],
    normal: [f32; 3],
    inverse_length: f32,
}
