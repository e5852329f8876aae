//! Extrema of the differences of Gaussians over place and scale, to a fraction of a sample.

use super::options::Options;
use super::scale_space::{LEVELS, Octave, sigma_of_level};
use crate::dispatch::widest;
use rayon::prelude::*;
use selenograph_raster::Raster;

/// Rows of one piece of work.
const STRIP_ROWS: usize = 32;

/// Samples at the rim where no extremum is looked for.
const RIM: usize = 5;

/// Steps to the neighbouring sample before a point that does not settle is given up.
const MAX_MOVES: usize = 5;

/// An extremum of an octave.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremum {
    /// Position in the list of octaves.
    pub octave_idx: usize,
    /// The Gaussian level nearest to it.
    pub level: usize,
    /// Level with its fraction.
    pub fine_level: f32,
    /// Position between samples of the octave.
    pub x: f32,
    /// Position between samples of the octave.
    pub y: f32,
    /// Contrast.
    pub response: f32,
}

impl Extremum {
    /// Standard deviation of its Gaussian, samples of the octave.
    pub(super) fn sigma(&self) -> f32 {
        sigma_of_level(self.fine_level)
    }
}

/// The extrema of an octave, from the top.
pub(super) fn find(octave: &Octave, octave_idx: usize, options: &Options) -> Vec<Extremum> {
    let height = octave.gaussians[0].height;
    if height <= 2 * RIM || octave.gaussians[0].width <= 2 * RIM {
        return Vec::new();
    }
    let threshold = options.contrast / LEVELS as f32;
    let strips: Vec<Vec<Extremum>> = (RIM..height - RIM)
        .step_by(STRIP_ROWS)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|top| {
            let bottom = (top + STRIP_ROWS).min(height - RIM);
            let mut found = Vec::new();
            for (x, y, level) in candidates(octave, top, bottom, 0.5 * threshold) {
                if let Some(extremum) = refine(octave, [x, y, level], threshold, options.edge_ratio) {
                    found.push(Extremum { octave_idx, ..extremum });
                }
            }
            found
        })
        .collect();
    strips.into_iter().flatten().collect()
}

/// Samples of rows `top..bottom` that are larger, or smaller, than their 26 neighbours.
fn candidates(octave: &Octave, top: usize, bottom: usize, threshold: f32) -> Vec<(usize, usize, usize)> {
    let width = octave.gaussians[0].width;
    let rows = bottom - top + 2;
    let first = top - 1;
    // The differences of these rows only: they stay in the cache.
    let mut differences = vec![vec![0.0f32; rows * width]; LEVELS + 2];
    for (level, difference) in differences.iter_mut().enumerate() {
        let span = first * width..(first + rows) * width;
        subtract(
            &octave.gaussians[level + 1].data[span.clone()],
            &octave.gaussians[level].data[span],
            difference,
        );
    }
    let mut flags = vec![0u8; width];
    let mut found = Vec::new();
    for row in 1..rows - 1 {
        for level in 1..=LEVELS {
            let line = |level: usize, row: usize| &differences[level][row * width..(row + 1) * width];
            flag(line(level, row), line(level, row - 1), line(level, row + 1), threshold, &mut flags);
            for x in flagged(&flags) {
                if x >= RIM && x < width - RIM && is_extremum(&differences, width, [x, row, level]) {
                    found.push((x, first + row, level));
                }
            }
        }
    }
    found
}

widest! {
    fn subtract(minuend: &[f32], subtrahend: &[f32], out: &mut [f32]) = subtract_body
}

#[inline(always)]
fn subtract_body(minuend: &[f32], subtrahend: &[f32], out: &mut [f32]) {
    for ((out, a), b) in out.iter_mut().zip(minuend).zip(subtrahend) {
        *out = a - b;
    }
}

widest! {
    /// Marks samples of a row beyond the threshold that their four nearest neighbours do not exceed.
    fn flag(row: &[f32], above: &[f32], below: &[f32], threshold: f32, flags: &mut [u8]) = flag_body
}

#[inline(always)]
fn flag_body(row: &[f32], above: &[f32], below: &[f32], threshold: f32, flags: &mut [u8]) {
    let n = row.len();
    let (left, centre, right) = (&row[..n - 2], &row[1..n - 1], &row[2..]);
    let (above, below, flags) = (&above[1..n - 1], &below[1..n - 1], &mut flags[1..n - 1]);
    for i in 0..n - 2 {
        let v = centre[i];
        let high = left[i].max(right[i]).max(above[i].max(below[i]));
        let low = left[i].min(right[i]).min(above[i].min(below[i]));
        flags[i] = u8::from((v > threshold) & (v >= high)) | u8::from((v < -threshold) & (v <= low));
    }
}

/// Positions of the marks.
fn flagged(flags: &[u8]) -> impl Iterator<Item = usize> {
    flags.chunks(16).enumerate().filter(|(_, chunk)| chunk.iter().any(|&f| f != 0)).flat_map(|(i, chunk)| {
        chunk.iter().enumerate().filter(|&(_, &f)| f != 0).map(move |(j, _)| 16 * i + j)
    })
}

fn is_extremum(differences: &[Vec<f32>], width: usize, [x, row, level]: [usize; 3]) -> bool {
    let v = differences[level][row * width + x];
    let (mut high, mut low) = (f32::NEG_INFINITY, f32::INFINITY);
    for difference in &differences[level - 1..=level + 1] {
        for y in row - 1..=row + 1 {
            for &neighbour in &difference[y * width + x - 1..=y * width + x + 1] {
                high = high.max(neighbour);
                low = low.min(neighbour);
            }
        }
    }
    if v > 0.0 { v >= high } else { v <= low }
}

/// The extremum of the quadratic through the neighbours; `None` for weak ones, edges, and those that do not settle.
fn refine(octave: &Octave, start: [usize; 3], threshold: f32, edge_ratio: f32) -> Option<Extremum> {
    let [mut x, mut y, mut level] = start;
    let (width, height) = (octave.gaussians[0].width, octave.gaussians[0].height);
    for _ in 0..MAX_MOVES {
        let cube = Cube::around(&octave.gaussians, [x, y, level]);
        let (gradient, hessian) = cube.derivatives();
        let offset = solve3(&hessian, &gradient)?;
        if offset.iter().all(|o| o.abs() <= 0.5) {
            let dot: f32 = (0..3).map(|i| gradient[i] * offset[i]).sum();
            let contrast = (cube.at(0, 0, 0) + 0.5 * dot).abs();
            return (contrast >= threshold && is_corner(&hessian, edge_ratio)).then(|| Extremum {
                octave_idx: 0,
                level,
                fine_level: level as f32 + offset[2],
                x: x as f32 + offset[0],
                y: y as f32 + offset[1],
                response: contrast,
            });
        }
        let moved = |at: usize, offset: f32, low: usize, high: usize| {
            let to = at as i64 + offset.round().clamp(-8.0, 8.0) as i64;
            usize::try_from(to).ok().filter(|to| (low..=high).contains(to))
        };
        x = moved(x, offset[0], RIM, width - RIM - 1)?;
        y = moved(y, offset[1], RIM, height - RIM - 1)?;
        level = moved(level, offset[2], 1, LEVELS)?;
    }
    None
}

/// Both principal curvatures have one sign, and their ratio is below the limit.
fn is_corner(hessian: &[[f32; 3]; 3], ratio: f32) -> bool {
    let trace = hessian[0][0] + hessian[1][1];
    let determinant = hessian[0][0] * hessian[1][1] - hessian[0][1] * hessian[0][1];
    determinant > 0.0 && trace * trace * ratio < (ratio + 1.0) * (ratio + 1.0) * determinant
}

/// The differences of Gaussians around a sample.
struct Cube([[[f32; 3]; 3]; 3]);

impl Cube {
    fn around(gaussians: &[Raster<f32>], [x, y, level]: [usize; 3]) -> Self {
        Self(std::array::from_fn(|s| {
            let (upper, lower) = (&gaussians[level + s], &gaussians[level + s - 1]);
            std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    let at = (y + j - 1) * upper.width + x + i - 1;
                    upper.data[at] - lower.data[at]
                })
            })
        }))
    }

    /// The sample at an offset of -1, 0 or 1 in each direction.
    fn at(&self, dx: i32, dy: i32, ds: i32) -> f32 {
        self.0[(ds + 1) as usize][(dy + 1) as usize][(dx + 1) as usize]
    }

    /// Central differences: gradient and Hessian over x, y, level.
    fn derivatives(&self) -> ([f32; 3], [[f32; 3]; 3]) {
        let unit = |axis: usize| -> [i32; 3] { std::array::from_fn(|i| i32::from(i == axis)) };
        let at = |d: [i32; 3]| self.at(d[0], d[1], d[2]);
        let centre = self.at(0, 0, 0);
        let gradient = std::array::from_fn(|i| {
            let u = unit(i);
            0.5 * (at(u) - at(u.map(|c| -c)))
        });
        let hessian = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let (u, v) = (unit(i), unit(j));
                if i == j {
                    at(u) + at(u.map(|c| -c)) - 2.0 * centre
                } else {
                    let corner =
                        |su: i32, sv: i32| at(std::array::from_fn(|axis| su * u[axis] + sv * v[axis]));
                    0.25 * (corner(1, 1) + corner(-1, -1) - corner(1, -1) - corner(-1, 1))
                }
            })
        });
        (gradient, hessian)
    }
}

/// Solves `hessian · offset = −gradient` by Cramer's rule.
fn solve3(h: &[[f32; 3]; 3], g: &[f32; 3]) -> Option<[f32; 3]> {
    let determinant = |m: &[[f32; 3]; 3]| {
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    };
    let whole = determinant(h);
    let offset: [f32; 3] = std::array::from_fn(|column| {
        let mut replaced = *h;
        for (row, g) in replaced.iter_mut().zip(g) {
            row[column] = -g;
        }
        determinant(&replaced) / whole
    });
    offset.iter().all(|o| o.is_finite()).then_some(offset)
}
