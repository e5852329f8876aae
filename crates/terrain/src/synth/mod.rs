//! Synthetic lunar relief: seeded fractal waves and craters, a pure function of the node, made in row bands of any size.

mod base;
mod crater;
mod noise;
mod output;
mod relief;

pub use base::BaseSurface;

use crate::{Error, Grid};
use crater::CraterClass;
use noise::{Octave, SLOPE_PER_SIGMA, stream};
use rayon::prelude::*;
use relief::{Relief, Wave};
use selenograph_geometry::{Body, Projection, proj_string::Crs};
use selenograph_raster::georef::Affine;
use serde::{Deserialize, Serialize};

/// Columns of a tile, the unit of parallel work.
const TILE_COLS: usize = 256;
/// Waves shorter than this many cells are not drawn.
const CELLS_OF_WAVE: f64 = 2.5;
/// Craters smaller than this many cells are not drawn: they would be single dots.
const CELLS_OF_CRATER: f64 = 4.5;
/// A base shows waves down to this many of its cells; shorter ones are made.
const CELLS_OF_BASE: f64 = 2.2;
/// Craters above this many of a base's cells are in the base already.
const CRATER_CELLS_OF_BASE: f64 = 2.5;
/// Longest synthetic wave, metres.
const LONGEST_WAVE_M: f64 = 163_840.0;

/// Standard deviation of the slope (tangent, one component) that one octave of relief adds, by its wavelength in metres.
/// Between the entries the logarithms are interpolated. Tuned until slopes at baselines of 5 to 6400 m resemble those
/// of the polar sites (another table is another Moon, not another format).
const SLOPE_SPECTRUM: [(f64, f64); 8] = [
    (160_000.0, 0.024),
    (40_000.0, 0.046),
    (10_000.0, 0.074),
    (5_000.0, 0.054),
    (1_300.0, 0.0140),
    (300.0, 0.0068),
    (60.0, 0.0100),
    (12.0, 0.0126),
];

/// What kind of Moon to make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SynthSettings {
    /// Another seed, another Moon.
    pub seed: u64,
    /// Factor on the fractal waves; 1 is polar highland.
    pub relief: f64,
    /// Cumulative crater density `N(>D)·D²`; 0 makes none.
    pub crater_density: f64,
    /// Largest crater, metres.
    pub max_crater_m: f64,
}

impl Default for SynthSettings {
    fn default() -> Self {
        Self { seed: 1, relief: 1.0, crater_density: 0.065, max_crater_m: 64_000.0 }
    }
}

/// Synthetic relief on a grid, ready to be read by rows.
#[derive(Debug, Clone)]
pub struct Synth {
    grid: Grid,
    settings: SynthSettings,
    relief: Relief,
}

/// The grid of a square polar cap in the layout of LOLA's products: `size × size` pixels of `cell_m` metres centred on the
/// south pole, pixel edges at `±size/2 · cell_m`.
///
/// # Errors
/// [`Error::Grid`] for a size below 2 or a cell that is not positive.
pub fn south_polar_grid(body: Body, size: usize, cell_m: f64) -> Result<Grid, Error> {
    let half = (size as f64 - 1.0) / 2.0 * cell_m;
    let projection = Projection::south_polar(body.radius_m);
    Grid::new(Crs { body, projection }, size, size, Affine::north_up(-half, half, cell_m, cell_m))
}

impl Synth {
    /// Prepares the relief of a grid. With a base, its long waves and large craters come from there.
    ///
    /// # Errors
    /// [`Error::Grid`] for a grid in degrees (waves are made in metres of the map), [`Error::Settings`] for numbers
    /// outside their range.
    pub fn new(grid: Grid, settings: &SynthSettings, base: Option<BaseSurface>) -> Result<Self, Error> {
        if matches!(grid.crs.projection, Projection::Geographic { .. }) {
            return Err(Error::Grid {
                expected: "a map in metres for synthetic relief",
                found: "degrees".into(),
            });
        }
        let check = |name: &'static str, value: f64, range: std::ops::RangeInclusive<f64>| {
            if range.contains(&value) {
                Ok(())
            } else {
                let expected = format!("{} to {}", range.start(), range.end());
                Err(Error::Settings { name, expected, found: value.to_string() })
            }
        };
        check("relief", settings.relief, 0.0..=10.0)?;
        check("crater_density", settings.crater_density, 0.0..=0.5)?;
        check("max_crater_m", settings.max_crater_m, 0.0..=300_000.0)?;
        let [step_x, step_y] = grid.map_from_grid().steps();
        let cell = step_x.max(step_y);
        let base_cell_m = base.as_ref().map(BaseSurface::cell_m);
        let longest = base_cell_m.map_or(LONGEST_WAVE_M, |cell| CELLS_OF_BASE * cell);
        let largest = base_cell_m
            .map_or(settings.max_crater_m, |cell| settings.max_crater_m.min(CRATER_CELLS_OF_BASE * cell));
        let relief = Relief::new(
            *grid.map_from_grid(),
            relief_waves(settings, longest, CELLS_OF_WAVE * cell),
            roughness_waves(settings, longest),
            crater_classes(settings, largest, CELLS_OF_CRATER * cell),
            base,
        );
        Ok(Self { grid, settings: settings.clone(), relief })
    }

    /// Where the nodes lie.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Heights of `num_rows` rows from `first_row`, metres above the sphere, into `out` (replaced). The same values
    /// whatever the bands and the number of threads.
    pub fn read_rows(&self, first_row: usize, num_rows: usize, out: &mut Vec<f32>) {
        let cols = self.grid.cols;
        out.clear();
        out.resize(num_rows * cols, 0.0);
        let starts: Vec<usize> = (0..cols).step_by(TILE_COLS).collect();
        let tiles: Vec<Vec<f32>> = starts
            .par_iter()
            .map(|&col| self.relief.heights(col, first_row, TILE_COLS.min(cols - col), num_rows))
            .collect();
        for (&col, tile) in starts.iter().zip(&tiles) {
            let width = TILE_COLS.min(cols - col);
            for (row, part) in tile.chunks_exact(width).enumerate() {
                out[row * cols + col..][..width].copy_from_slice(part);
            }
        }
    }
}

/// Octaves of relief from `longest` down to `shortest`, each half as long as the one before.
fn relief_waves(settings: &SynthSettings, longest: f64, shortest: f64) -> Vec<Wave> {
    octaves(longest, shortest)
        .map(|(k, wavelength_m)| Wave {
            octave: Octave::new(stream(settings.seed, "relief", k), wavelength_m),
            amplitude: (settings.relief * slope_sigma(wavelength_m) * wavelength_m / SLOPE_PER_SIGMA) as f32,
        })
        .collect()
}

/// Octaves that make some ground rougher than other ground.
fn roughness_waves(settings: &SynthSettings, longest: f64) -> Vec<Wave> {
    octaves(longest.min(40_000.0), 300.0)
        .filter(|(k, _)| k % 2 == 1)
        .map(|(k, wavelength_m)| Wave {
            octave: Octave::new(stream(settings.seed, "roughness", k), wavelength_m),
            amplitude: 0.3,
        })
        .collect()
}

/// Wavelengths of [`LONGEST_WAVE_M`] / 2ᵏ within the limits, with their k: the same octaves whatever the limits.
fn octaves(longest: f64, shortest: f64) -> impl Iterator<Item = (u64, f64)> {
    (0..40u64)
        .map(|k| (k, LONGEST_WAVE_M / (1u64 << k) as f64))
        .filter(move |(_, wavelength)| (shortest..=longest).contains(wavelength))
}

/// Classes of craters by powers of two of a metre.
fn crater_classes(settings: &SynthSettings, largest: f64, shortest: f64) -> Vec<CraterClass> {
    (0..20u32)
        .map(|k| f64::from(1 << k))
        .filter(|d| settings.crater_density > 0.0 && *d >= shortest && 2.0 * d <= largest.max(2.0 * shortest))
        .map(|d| CraterClass::new(settings.seed, d, settings.crater_density))
        .collect()
}

/// [`SLOPE_SPECTRUM`] at a wavelength.
fn slope_sigma(wavelength_m: f64) -> f64 {
    let (first, last) = (SLOPE_SPECTRUM[0], SLOPE_SPECTRUM[SLOPE_SPECTRUM.len() - 1]);
    let wavelength = wavelength_m.clamp(last.0, first.0);
    let segment = SLOPE_SPECTRUM.windows(2).find(|s| wavelength >= s[1].0).unwrap_or(&SLOPE_SPECTRUM[..2]);
    let t = (wavelength / segment[0].0).ln() / (segment[1].0 / segment[0].0).ln();
    (segment[0].1.ln() * (1.0 - t) + segment[1].1.ln() * t).exp()
}
