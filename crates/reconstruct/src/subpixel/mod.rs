//! Matches to a few hundredths of a pixel: picture B is warped onto A by what is known, and small windows are aligned.
//!
//! A homography and a smooth field on top of it, both from the matches so far, carry B's pixels to A, so that roll, scale and
//! foreshortening are gone before windows are compared. What the windows find improves the field, B is warped again, and so on:
//! first at half resolution, then twice at full. Windows are aligned in both directions; where the two disagree, nothing is said.
//!
//! # Source
//! Lucas & Kanade 1981, "An iterative image registration technique"; Baker & Matthews 2004, "Lucas-Kanade 20 years on", IJCV
//! 56(3); gradients of both pictures averaged as in Malis 2004, "Improving vision-based control using efficient second-order
//! minimization techniques", ICRA.

mod corners;
mod field;
mod homography;
mod warp;
mod window;

use crate::features::blur::{decimated, gaussian};
use crate::features::coordinate_of;
use crate::features::intensity::Intensity;
use crate::matching::Match;
use field::Field;
use homography::Homography;
use rayon::prelude::*;
use selenograph_geometry::{Point2, Vector2};
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};
use warp::Warp;
use window::{Aligned, RADIUS};

/// Points of one piece of work.
const CHUNK: usize = 32;

/// Blur before every second sample is taken, samples.
const HALVING_SIGMA: f64 = 1.0;

/// Fewer matches fix no homography.
const MIN_SEEDS: usize = 8;

/// What windows are aligned and which results count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// One window for every square of this side, pixels.
    pub spacing_px: usize,
    /// Blur of both pictures before their windows are interpolated, pixels.
    pub smoothing_px: f64,
    /// Blur that a picture of the cameras has: the finer of two scales gets what it lacks, pixels.
    pub camera_blur_px: f64,
    /// Largest shift from where the field expects the window, pixels.
    pub max_shift_px: f32,
    /// Largest disagreement of the two directions, pixels.
    pub max_return_px: f32,
    /// Smallest correlation of aligned windows.
    pub min_correlation: f32,
    /// Largest standard deviation of a match, pixels.
    pub max_sigma_px: f32,
    /// Passes at full resolution.
    pub passes: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            spacing_px: 14,
            smoothing_px: 0.5,
            camera_blur_px: 0.65,
            max_shift_px: 2.5,
            max_return_px: 0.1,
            min_correlation: 0.8,
            max_sigma_px: 0.1,
            passes: 2,
        }
    }
}

/// A match to a fraction of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// In picture A, pixels from its corner.
    pub a: Point2<f64>,
    /// In picture B.
    pub b: Point2<f64>,
    /// Standard deviation of the shift from the windows' residual, pixels of A, mean of both axes.
    pub sigma_px: f64,
    /// Correlation of the aligned windows.
    pub correlation: f64,
}

/// Finds matches by aligning windows of A with B, starting from `seeds` that are mostly right.
///
/// # Shapes and units
/// Pixels from the pictures' corners. Seeds come back only where their windows align. Empty for fewer than 8 seeds.
pub fn refine(a: &Intensity, b: &Intensity, seeds: &[Match], options: &Options) -> Vec<Refined> {
    if seeds.len() < MIN_SEEDS {
        return Vec::new();
    }
    let Some(homography) = Homography::fit(seeds) else { return Vec::new() };
    let size = [a.image.width, a.image.height];
    let mut known: Vec<(Point2<f64>, Point2<f64>)> = seeds.iter().map(|m| (m.a, m.b)).collect();
    let pictures = Pictures::new(a, b, &homography, options);
    for pass in 0..=options.passes {
        let warp =
            Warp { field: Field::fit(size, &residuals(&homography, &known)), homography: homography.clone() };
        let last = pass == options.passes;
        let found = if pass == 0 {
            let half_a = decimated(&gaussian(&pictures.a, HALVING_SIGMA));
            let half_b = warp.apply(&gaussian(&pictures.b, HALVING_SIGMA * pictures.scale), size, 2);
            align_all(&half_a, &half_b, 2.0, &[], options)
        } else {
            let warped = warp.apply(&pictures.b, size, 1);
            align_all(&pictures.a, &warped, 1.0, if last { seeds } else { &[] }, options)
        };
        let mapped: Vec<_> = found.iter().filter_map(|f| Some((f.at, warp.point(f.shifted())?))).collect();
        if mapped.len() >= MIN_SEEDS {
            known = mapped;
        }
        if last {
            return found.iter().filter_map(|f| resolve(f, &warp, a, b, options)).collect();
        }
    }
    Vec::new()
}

/// What the homography leaves over.
fn residuals(
    homography: &Homography,
    known: &[(Point2<f64>, Point2<f64>)],
) -> Vec<(Point2<f64>, Vector2<f64>)> {
    known.iter().filter_map(|(a, b)| Some((*a, b - homography.point(a)?))).collect()
}

/// Both pictures with the same blur on the ground.
struct Pictures {
    a: Raster<f32>,
    b: Raster<f32>,
    /// Pixels of B a pixel of A, in the middle.
    scale: f64,
}

impl Pictures {
    fn new(a: &Intensity, b: &Intensity, homography: &Homography, options: &Options) -> Self {
        let middle = Point2::new(0.5 * a.image.width as f64, 0.5 * a.image.height as f64);
        let scale = homography.scale_at(&middle).clamp(0.1, 10.0);
        // Variances add; a picture that is finer by `scale` lacks the difference.
        let lacking = |scale: f64| options.camera_blur_px * (scale * scale - 1.0).max(0.0).sqrt();
        let blurred = |image: &Raster<f32>, lacking: f64, unit: f64| {
            gaussian(image, lacking.hypot(options.smoothing_px * unit))
        };
        Self {
            a: blurred(&a.image, lacking(1.0 / scale), 1.0),
            b: blurred(&b.image, lacking(scale), scale),
            scale,
        }
    }
}

/// A window of A that was aligned.
#[derive(Debug, Clone, Copy)]
struct Found {
    /// Its centre, pixels.
    at: Point2<f64>,
    /// From there to its place in the warped B, pixels.
    shift: Vector2<f64>,
    sigma_px: f64,
    correlation: f64,
}

impl Found {
    fn shifted(&self) -> Point2<f64> {
        self.at + self.shift
    }
}

/// Aligns a window in every square of the grid, and at the seeds.
fn align_all(
    a: &Raster<f32>,
    warped: &Raster<f32>,
    step: f64,
    seeds: &[Match],
    options: &Options,
) -> Vec<Found> {
    let mut centres = corners::strongest(a, warped, options.spacing_px);
    centres.extend(seeds.iter().filter_map(|m| {
        let index = |coordinate: f64| usize::try_from(selenograph_geometry::pixel::index_of(coordinate)).ok();
        Some([index(m.a.x)?, index(m.a.y)?])
    }));
    let chunks: Vec<Vec<Found>> = centres
        .par_chunks(CHUNK)
        .map(|chunk| {
            chunk.iter().filter_map(|&centre| align_both(a, warped, centre, step, options)).collect()
        })
        .collect();
    chunks.concat()
}

fn align_both(
    a: &Raster<f32>,
    warped: &Raster<f32>,
    [x, y]: [usize; 2],
    step: f64,
    options: &Options,
) -> Option<Found> {
    let limit = options.max_shift_px;
    let there = window::align(a, warped, [x, y], [0.0, 0.0], limit)?;
    if there.correlation < options.min_correlation {
        return None;
    }
    let [qx, qy] = [(x, there.shift[0]), (y, there.shift[1])].map(|(p, d)| p as i64 + d.round() as i64);
    let from = [usize::try_from(qx).ok()?, usize::try_from(qy).ok()?];
    let back: Aligned = window::align(warped, a, from, there.shift.map(|d| -d), limit)?;
    let apart = (there.shift[0] + back.shift[0]).hypot(there.shift[1] + back.shift[1]);
    if apart > options.max_return_px {
        return None;
    }
    // The mean of both directions: what interpolation adds to one it takes from the other.
    let mean = |i: usize| 0.5 * step * f64::from(there.shift[i] - back.shift[i]);
    let centre = |idx: usize| coordinate_of(idx as f64 * step);
    Some(Found {
        at: Point2::new(centre(x), centre(y)),
        shift: Vector2::new(mean(0), mean(1)),
        sigma_px: step * f64::from(there.sigma),
        correlation: f64::from(there.correlation),
    })
}

/// The match of an aligned window, if it is sharp enough and both pictures are known around it.
fn resolve(found: &Found, warp: &Warp, a: &Intensity, b: &Intensity, options: &Options) -> Option<Refined> {
    let to = warp.point(found.shifted())?;
    let known = |intensity: &Intensity, at: &Point2<f64>| {
        let [x, y] = [at.x, at.y].map(selenograph_geometry::pixel::sample_position);
        intensity.is_known_around(x, y, RADIUS as f64)
    };
    (found.sigma_px <= f64::from(options.max_sigma_px) && known(a, &found.at) && known(b, &to))
        .then_some(Refined { a: found.at, b: to, sigma_px: found.sigma_px, correlation: found.correlation })
}
