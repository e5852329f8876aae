//! The relief as a function of the node: noise octaves, craters and a base surface, summed from coarse to fine.
//!
//! Level `l` is the lattice of every `2ˡ`-th node. Waves and craters that are long against its spacing are added there and
//! carried to the next finer level by the interpolating four-point scheme (Deslauriers & Dubuc 1989; C¹), so that a
//! node costs what its finest waves cost. Lattices are tied to the grid, not to the window asked for: a node's height
//! depends on nothing but the settings.

use super::base::BaseSurface;
use super::crater::CraterClass;
use super::noise::Octave;
use selenograph_raster::georef::Affine;

/// An octave goes to the coarsest level that samples its wavelength this often.
const SAMPLES_PER_WAVE: f64 = 8.0;
/// A crater class goes to the coarsest level that samples its smallest diameter this often.
const SAMPLES_PER_CRATER: f64 = 48.0;
/// Nodes beyond a window's edge that the four-point scheme looks at.
const MARGIN: i64 = 1;

/// A wave of relief.
#[derive(Debug, Clone)]
pub(super) struct Wave {
    pub octave: Octave,
    /// Standard deviation, metres for relief, none for roughness.
    pub amplitude: f32,
}

/// What one level adds.
#[derive(Debug, Clone, Default)]
struct Level {
    relief: Vec<Wave>,
    roughness: Vec<Wave>,
    craters: Vec<CraterClass>,
    base: bool,
}

/// The sum.
#[derive(Debug, Clone)]
pub(super) struct Relief {
    map_from_grid: Affine,
    levels: Vec<Level>,
    base: Option<BaseSurface>,
}

/// A rectangle of nodes of one level.
#[derive(Debug, Clone, Copy)]
struct Window {
    col0: i64,
    row0: i64,
    cols: usize,
    rows: usize,
}

/// Height and roughness of later detail on a window.
struct Field {
    window: Window,
    height: Vec<f32>,
    roughness: Vec<f32>,
}

impl Window {
    /// The next coarser level's window, wide enough for the four-point scheme.
    fn coarser(self) -> Self {
        let lo = |first: i64| first.div_euclid(2) - MARGIN;
        let hi = |first: i64, count: usize| (first + count as i64).div_euclid(2) + MARGIN;
        let (col0, row0) = (lo(self.col0), lo(self.row0));
        Self {
            col0,
            row0,
            cols: (hi(self.col0, self.cols) - col0 + 1) as usize,
            rows: (hi(self.row0, self.rows) - row0 + 1) as usize,
        }
    }
}

impl Relief {
    /// Sorts what there is to add into levels for cells of `cell_m` metres.
    pub fn new(
        map_from_grid: Affine,
        relief: Vec<Wave>,
        roughness: Vec<Wave>,
        craters: Vec<CraterClass>,
        base: Option<BaseSurface>,
    ) -> Self {
        let [step_x, step_y] = map_from_grid.steps();
        let cell_m = step_x.max(step_y);
        let level_of =
            |length: f64, samples: f64| (length / (samples * cell_m)).log2().floor().max(0.0) as usize;
        let of_wave = |wave: &Wave| level_of(wave.octave.wavelength_m, SAMPLES_PER_WAVE);
        let top = relief.iter().chain(&roughness).map(of_wave).max().unwrap_or(0);
        let of_class = |class: &CraterClass| level_of(class.min_diameter_m, SAMPLES_PER_CRATER);
        let top = craters.iter().map(of_class).fold(top, usize::max);
        let base_level = base.as_ref().map(|b| level_of(b.cell_m(), SAMPLES_PER_WAVE));
        let mut levels = vec![Level::default(); top.max(base_level.unwrap_or(0)) + 1];
        for wave in relief {
            levels[of_wave(&wave)].relief.push(wave);
        }
        for wave in roughness {
            levels[of_wave(&wave)].roughness.push(wave);
        }
        for class in craters {
            levels[of_class(&class)].craters.push(class);
        }
        if let Some(level) = base_level {
            levels[level].base = true;
        }
        // Large craters are older than the small ones on them.
        for level in &mut levels {
            level.craters.sort_by(|a, b| b.min_diameter_m.total_cmp(&a.min_diameter_m));
        }
        Self { map_from_grid, levels, base }
    }

    /// Heights of `cols × rows` nodes from node (`col0`, `row0`), rows first, metres; NaN where the base is absent.
    pub fn heights(&self, col0: usize, row0: usize, cols: usize, rows: usize) -> Vec<f32> {
        let mut windows = vec![Window { col0: col0 as i64, row0: row0 as i64, cols, rows }];
        for level in 1..self.levels.len() {
            windows.push(windows[level - 1].coarser());
        }
        let mut field: Option<Field> = None;
        for (number, (level, window)) in self.levels.iter().zip(windows).enumerate().rev() {
            let mut next = match field {
                Some(coarse) => coarse.finer(window),
                None => Field {
                    window,
                    height: vec![0.0; window.cols * window.rows],
                    roughness: vec![1.0; window.cols * window.rows],
                },
            };
            self.add(level, number, &mut next);
            field = Some(next);
        }
        field.map_or_else(|| vec![0.0; cols * rows], |f| f.height)
    }

    /// Adds what belongs to a level.
    fn add(&self, level: &Level, number: usize, field: &mut Field) {
        let stride = (1i64 << number) as f64;
        let window = field.window;
        let map_at = |i: usize, j: usize| {
            self.map_from_grid
                .apply((window.col0 + i as i64) as f64 * stride, (window.row0 + j as i64) as f64 * stride)
        };
        if let (true, Some(base)) = (level.base, &self.base) {
            for j in 0..window.rows {
                for i in 0..window.cols {
                    let [x, y] = map_at(i, j);
                    field.height[j * window.cols + i] += base.height(x, y);
                }
            }
        }
        if !level.roughness.is_empty() || !level.relief.is_empty() {
            for j in 0..window.rows {
                for i in 0..window.cols {
                    let [x, y] = map_at(i, j);
                    let at = j * window.cols + i;
                    for wave in &level.roughness {
                        let factor = 1.0 + wave.amplitude * wave.octave.at(x, y);
                        field.roughness[at] *= factor.clamp(0.35, 2.2);
                    }
                    let sum: f32 = level.relief.iter().map(|w| w.amplitude * w.octave.at(x, y)).sum();
                    field.height[at] += field.roughness[at] * sum;
                }
            }
        }
        for class in &level.craters {
            self.add_craters(class, stride, field);
        }
    }

    /// Adds one class: older craters first, each erasing part of its class under it.
    fn add_craters(&self, class: &CraterClass, stride: f64, field: &mut Field) {
        let window = field.window;
        let corner = |i: usize, j: usize| {
            self.map_from_grid
                .apply((window.col0 + i as i64) as f64 * stride, (window.row0 + j as i64) as f64 * stride)
        };
        let corners = [
            corner(0, 0),
            corner(window.cols - 1, 0),
            corner(0, window.rows - 1),
            corner(window.cols - 1, window.rows - 1),
        ];
        let bound =
            |k: usize, pick: fn(f64, f64) -> f64| corners.iter().map(|c| c[k]).fold(corners[0][k], pick);
        let rectangle = [bound(0, f64::min), bound(1, f64::min), bound(0, f64::max), bound(1, f64::max)];
        let craters = class.in_rectangle(rectangle);
        if craters.is_empty() {
            return;
        }
        let Ok(grid_from_map) = self.map_from_grid.inverse() else { return };
        let [step_x, step_y] = self.map_from_grid.steps();
        let mut added = vec![0f32; window.cols * window.rows];
        for crater in &craters {
            let [c, r] = grid_from_map.apply(crater.x, crater.y);
            let (c, r) = (c / stride - window.col0 as f64, r / stride - window.row0 as f64);
            // Reach in lattice steps; the map's axes need not be the grid's.
            let reach = crater.reach_m() / (step_x.min(step_y) * stride) * std::f64::consts::SQRT_2;
            let range = |at: f64, count: usize| {
                let lo = (at - reach).ceil().clamp(0.0, count as f64) as usize;
                let hi = (at + reach + 1.0).floor().clamp(0.0, count as f64) as usize;
                lo..hi
            };
            for j in range(r, window.rows) {
                for i in range(c, window.cols) {
                    let [x, y] = corner(i, j);
                    let Some([height, erased, roughness]) = class.effect(crater, x - crater.x, y - crater.y)
                    else {
                        continue;
                    };
                    let at = j * window.cols + i;
                    added[at] = added[at] * (1.0 - erased) + height;
                    field.roughness[at] *= roughness;
                }
            }
        }
        for (height, added) in field.height.iter_mut().zip(&added) {
            *height += added;
        }
    }
}

impl Field {
    /// Carries the field to the next finer level.
    fn finer(&self, window: Window) -> Self {
        Self {
            window,
            height: refine(&self.height, self.window, window),
            roughness: refine(&self.roughness, self.window, window),
        }
    }
}

/// Four-point interpolation from a coarse window to one of half its spacing.
fn refine(coarse: &[f32], from: Window, to: Window) -> Vec<f32> {
    let mut across = vec![0f32; to.cols * from.rows];
    for (row, out) in coarse.chunks_exact(from.cols).zip(across.chunks_exact_mut(to.cols)) {
        for (i, value) in out.iter_mut().enumerate() {
            let col = to.col0 + i as i64;
            let at = (col.div_euclid(2) - from.col0) as usize;
            *value = if col.rem_euclid(2) == 0 {
                row[at]
            } else {
                0.5625 * (row[at] + row[at + 1]) - 0.0625 * (row[at - 1] + row[at + 2])
            };
        }
    }
    let mut fine = vec![0f32; to.cols * to.rows];
    let row_of = |n: usize| &across[n * to.cols..(n + 1) * to.cols];
    for (j, out) in fine.chunks_exact_mut(to.cols).enumerate() {
        let row = to.row0 + j as i64;
        let at = (row.div_euclid(2) - from.row0) as usize;
        if row.rem_euclid(2) == 0 {
            out.copy_from_slice(row_of(at));
        } else {
            let (a, b, c, d) = (row_of(at - 1), row_of(at), row_of(at + 1), row_of(at + 2));
            for i in 0..to.cols {
                out[i] = 0.5625 * (b[i] + c[i]) - 0.0625 * (a[i] + d[i]);
            }
        }
    }
    fine
}
