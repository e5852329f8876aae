//! The direction of a keypoint's surroundings and their histogram of gradients.

use super::extrema::Extremum;
use super::trigonometry::{atan2, exp_minus};
use crate::dispatch::widest;
use selenograph_raster::Raster;
use std::f32::consts::TAU;

/// Length of a descriptor: 4 × 4 cells of 8 directions.
pub const DESCRIPTOR_LEN: usize = 128;

/// What the surroundings of a keypoint look like: a unit vector without negative entries.
pub type Descriptor = [f32; DESCRIPTOR_LEN];

/// Bins of the histogram of directions.
const DIRECTION_BINS: usize = 36;

/// Standard deviation of the window over which directions are counted, in the keypoint's.
const DIRECTION_SIGMAS: f32 = 1.5;

/// A further peak this high makes a keypoint of its own.
const PEAK_SHARE: f32 = 0.8;

/// Cells of the descriptor along a side.
const CELLS: usize = 4;

/// Directions of a cell.
const BINS: usize = 8;

/// Side of a cell, in the keypoint's standard deviations.
const CELL_SIGMAS: f32 = 3.0;

/// Largest entry of the unit histogram: strong edges under another light must not rule it.
const CLIP: f32 = 0.2;

/// Gradient samples around a keypoint, one array each, so that what is computed of them vectorises.
#[derive(Default)]
pub(super) struct Samples {
    dx: Vec<f32>,
    dy: Vec<f32>,
    /// Position in the keypoint's frame (cells), or distance² for the direction.
    u: Vec<f32>,
    v: Vec<f32>,
    magnitude: Vec<f32>,
    angle: Vec<f32>,
}

impl Samples {
    fn clear(&mut self) {
        for list in [&mut self.dx, &mut self.dy, &mut self.u, &mut self.v] {
            list.clear();
        }
    }

    #[inline(always)]
    fn push(&mut self, image: &Raster<f32>, x: usize, y: usize, u: f32, v: f32) {
        let at = y * image.width + x;
        self.dx.push(image.data[at + 1] - image.data[at - 1]);
        self.dy.push(image.data[at + image.width] - image.data[at - image.width]);
        self.u.push(u);
        self.v.push(v);
    }

    fn resolve(&mut self, falloff: f32) {
        self.magnitude.resize(self.dx.len(), 0.0);
        self.angle.resize(self.dx.len(), 0.0);
        polar(&self.dx, &self.dy, &self.u, &self.v, falloff, &mut self.magnitude, &mut self.angle);
    }
}

widest! {
    /// Magnitude (weighted by `exp(−falloff · (u² + v²))`) and angle of gradients.
    fn polar(dx: &[f32], dy: &[f32], u: &[f32], v: &[f32], falloff: f32, magnitude: &mut [f32], angle: &mut [f32])
        = polar_body
}

#[inline(always)]
fn polar_body(
    dx: &[f32],
    dy: &[f32],
    u: &[f32],
    v: &[f32],
    falloff: f32,
    magnitude: &mut [f32],
    angle: &mut [f32],
) {
    let n = dx.len();
    let (dy, u, v) = (&dy[..n], &u[..n], &v[..n]);
    let (magnitude, angle) = (&mut magnitude[..n], &mut angle[..n]);
    for i in 0..n {
        let weight = exp_minus(falloff * (u[i] * u[i] + v[i] * v[i]));
        magnitude[i] = (dx[i] * dx[i] + dy[i] * dy[i]).sqrt() * weight;
        angle[i] = atan2(dy[i], dx[i]);
    }
}

/// Samples `centre ± radius` that have neighbours on both sides in a picture `side` wide.
fn span(centre: f32, radius: f32, side: usize) -> std::ops::Range<usize> {
    let low = (centre - radius).ceil().max(1.0) as usize;
    let high = ((centre + radius).floor() + 1.0).clamp(0.0, (side - 1) as f32) as usize;
    low..high.max(low)
}

/// The directions of the surroundings: each peak of their histogram, radians in `[0, 2π)`.
pub(super) fn orientations(image: &Raster<f32>, at: &Extremum, samples: &mut Samples) -> Vec<f32> {
    let sigma = DIRECTION_SIGMAS * at.sigma();
    let radius = 3.0 * sigma;
    samples.clear();
    for y in span(at.y, radius, image.height) {
        let v = y as f32 - at.y;
        for x in span(at.x, radius, image.width) {
            samples.push(image, x, y, x as f32 - at.x, v);
        }
    }
    samples.resolve(0.5 / (sigma * sigma));
    let mut histogram = [0.0f32; DIRECTION_BINS];
    for (magnitude, angle) in samples.magnitude.iter().zip(&samples.angle) {
        // Shifted by a turn, so that truncation rounds.
        let bin = (angle * (DIRECTION_BINS as f32 / TAU) + (DIRECTION_BINS as f32 + 0.5)) as usize;
        histogram[bin % DIRECTION_BINS] += magnitude;
    }
    peaks(&smoothed(&histogram))
}

/// The histogram blurred round the circle by (1 4 6 4 1)/16.
fn smoothed(histogram: &[f32; DIRECTION_BINS]) -> [f32; DIRECTION_BINS] {
    let at = |i: usize| histogram[i % DIRECTION_BINS];
    std::array::from_fn(|i| {
        let i = i + DIRECTION_BINS;
        (at(i - 2) + at(i + 2) + 4.0 * (at(i - 1) + at(i + 1)) + 6.0 * at(i)) / 16.0
    })
}

fn peaks(histogram: &[f32; DIRECTION_BINS]) -> Vec<f32> {
    let highest = histogram.iter().copied().fold(0.0, f32::max);
    let mut found = Vec::with_capacity(2);
    for (i, &value) in histogram.iter().enumerate() {
        let left = histogram[(i + DIRECTION_BINS - 1) % DIRECTION_BINS];
        let right = histogram[(i + 1) % DIRECTION_BINS];
        if value > left && value >= right && value >= PEAK_SHARE * highest {
            let offset = 0.5 * (left - right) / (left - 2.0 * value + right);
            found.push(((i as f32 + offset) * (TAU / DIRECTION_BINS as f32)).rem_euclid(TAU));
        }
    }
    found
}

/// Cells and directions with room for what falls beside them: `(CELLS + 2)²` cells of `BINS + 1` directions.
type Histogram = [f32; (CELLS + 2) * (CELLS + 2) * (BINS + 1)];

/// The descriptor of a keypoint turned by `angle_rad`.
///
/// The Gaussian that a keypoint lives on is smooth over two samples, so that gradients at every second one are enough.
pub(super) fn describe(
    image: &Raster<f32>,
    at: &Extremum,
    angle_rad: f32,
    samples: &mut Samples,
) -> Descriptor {
    let cell = CELL_SIGMAS * at.sigma();
    let reach = 0.5 * (CELLS as f32 + 1.0);
    let radius = reach * cell * std::f32::consts::SQRT_2;
    let (sin, cos) = angle_rad.sin_cos();
    let (sin_cell, cos_cell) = (sin / cell, cos / cell);
    samples.clear();
    for y in span(at.y, radius, image.height).step_by(2) {
        let dy = y as f32 - at.y;
        for x in span(at.x, radius, image.width).step_by(2) {
            let dx = x as f32 - at.x;
            let u = cos_cell * dx + sin_cell * dy;
            let v = cos_cell * dy - sin_cell * dx;
            if u.abs() < reach && v.abs() < reach {
                samples.push(image, x, y, u, v);
            }
        }
    }
    // The window's standard deviation is half the descriptor's side.
    samples.resolve(0.5 / (0.25 * (CELLS * CELLS) as f32));
    let mut histogram: Histogram = [0.0; (CELLS + 2) * (CELLS + 2) * (BINS + 1)];
    for i in 0..samples.dx.len() {
        let turned = (samples.angle[i] - angle_rad) * (BINS as f32 / TAU);
        scatter(&mut histogram, samples.u[i], samples.v[i], turned, samples.magnitude[i]);
    }
    normalised(&histogram)
}

/// Shares a gradient among the two nearest cells of each axis and the two nearest directions.
#[inline(always)]
fn scatter(histogram: &mut Histogram, u: f32, v: f32, turned: f32, magnitude: f32) {
    // Shifted so that truncation is the floor: cells from −0.5 … CELLS + 0.5 to 0 … CELLS + 1.
    let shift = 0.5 * CELLS as f32 + 0.5;
    let (column, row, bin) = (u + shift, v + shift, turned + 2.0 * BINS as f32);
    let (c, r, b) = (column as usize, row as usize, bin as usize);
    let (fc, fr, fb) = (column - c as f32, row - r as f32, bin - b as f32);
    let b = b % BINS;
    let (low, high) = (magnitude * (1.0 - fr), magnitude * fr);
    let stride = BINS + 1;
    for (r, share) in [(r, low), (r + 1, high)] {
        let base = (r * (CELLS + 2) + c) * stride + b;
        if let Some(cells) = histogram.get_mut(base..base + stride + 2) {
            let (near, far) = (share * (1.0 - fc), share * fc);
            cells[0] += near * (1.0 - fb);
            cells[1] += near * fb;
            cells[stride] += far * (1.0 - fb);
            cells[stride + 1] += far * fb;
        }
    }
}

/// Unit length, clipped, then the root of the shares: Euclidean distances become Hellinger's.
fn normalised(histogram: &Histogram) -> Descriptor {
    let mut descriptor = [0.0f32; DESCRIPTOR_LEN];
    for row in 0..CELLS {
        for column in 0..CELLS {
            let from = ((row + 1) * (CELLS + 2) + column + 1) * (BINS + 1);
            let cell = &mut descriptor[(row * CELLS + column) * BINS..][..BINS];
            cell.copy_from_slice(&histogram[from..from + BINS]);
            cell[0] += histogram[from + BINS];
        }
    }
    let length = descriptor.iter().map(|d| d * d).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    let clip = CLIP * length;
    let sum = descriptor.iter().map(|d| d.min(clip)).sum::<f32>().max(f32::MIN_POSITIVE);
    descriptor.map(|d| (d.min(clip) / sum).sqrt())
}
