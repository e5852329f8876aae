//! The data term: locally normalised grey levels, so that neither gain nor offset of a picture matters.

use super::level::ViewLevel;
use super::options::StereoOptions;
use super::warp::Warped;
use crate::field::filter::gaussian;
use rayon::prelude::*;
use selenograph_raster::Raster;

/// The linearised data term at the present surface: `weight · δ = right` for the change `δ` of the unknown.
#[derive(Debug)]
pub(crate) struct Term {
    /// Curvature: `K * (w g²)`.
    pub weight: Raster<f32>,
    /// Pull: `K * (w g r)`.
    pub right: Raster<f32>,
}

/// Local mean and the inverse of local contrast (with a floor) inside a mask.
fn local(
    image: &Raster<f32>,
    mask: &Raster<f32>,
    area: &Raster<f32>,
    sigma_px: f32,
    floor: f32,
) -> (Raster<f32>, Raster<f32>) {
    let masked = product(image, mask);
    let mut mean = gaussian(&masked, sigma_px);
    let mut scale = gaussian(&product(&masked, image), sigma_px);
    for ((m, s), &a) in mean.data.iter_mut().zip(&mut scale.data).zip(&area.data) {
        let inverse = 1.0 / a.max(1e-6);
        *m *= inverse;
        *s = 1.0 / ((*s * inverse - *m * *m).max(0.0) + floor * floor).sqrt();
    }
    (mean, scale)
}

fn product(a: &Raster<f32>, b: &Raster<f32>) -> Raster<f32> {
    let data = a.data.iter().zip(&b.data).map(|(a, b)| a * b).collect();
    Raster { width: a.width, height: a.height, data }
}

/// Both pictures without local gain and offset, on this view's pixels.
#[derive(Debug)]
pub(crate) struct Normalised {
    here: Raster<f32>,
    there: Raster<f32>,
    /// Derivative of `there` by the unknown.
    slope: Raster<f32>,
    /// 1 where both views see the point, else 0.
    mask: Raster<f32>,
}

/// Takes gain and offset out of both pictures. `visible` is 1 where the other view sees the point and 0 where it is hidden.
pub(crate) fn normalise(
    here: &ViewLevel,
    there: &ViewLevel,
    warped: Warped,
    visible: &Raster<f32>,
    options: &StereoOptions,
) -> Normalised {
    let mask = product(&warped.mask, visible);
    let sigma = options.normalise_sigma_px;
    let area = gaussian(&mask, sigma);
    let floor = |level: &ViewLevel| options.noise_floor * level.amplitude.max(1e-9);
    let (mean_a, scale_a) = local(&here.image, &mask, &area, sigma, floor(here));
    let (mean_b, scale_b) = local(&warped.image, &mask, &area, sigma, floor(there));
    let slope_mean = gaussian(&product(&warped.slope, &mask), sigma);
    let Warped { image: mut there, mut slope, .. } = warped;
    let mut here = here.image.clone();
    let width = here.width;
    let rows = here
        .data
        .par_chunks_mut(width)
        .zip(there.data.par_chunks_mut(width))
        .zip(slope.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(y, ((a, b), g))| {
        let (ma, sa, mb, sb) = (mean_a.row(y), scale_a.row(y), mean_b.row(y), scale_b.row(y));
        let (mg, m, n) = (slope_mean.row(y), mask.row(y), area.row(y));
        for x in 0..width {
            a[x] = m[x] * (a[x] - ma[x]) * sa[x];
            b[x] = m[x] * (b[x] - mb[x]) * sb[x];
            g[x] = m[x] * (g[x] - mg[x] / n[x].max(1e-6)) * sb[x];
        }
    });
    Normalised { here, there, slope, mask }
}

impl Normalised {
    /// The linearised term.
    pub(crate) fn term(&self, options: &StereoOptions) -> Term {
        let (mut weight, mut right) = (self.mask.clone(), self.mask.clone());
        let width = weight.width;
        let inverse_c2 = 1.0 / (options.robust_scale * options.robust_scale);
        let rows = weight.data.par_chunks_mut(width).zip(right.data.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (weight, right))| {
            let (a, b, g) = (self.here.row(y), self.there.row(y), self.slope.row(y));
            for x in 0..width {
                let residual = a[x] - b[x];
                let pull = weight[x] * g[x] / (1.0 + residual * residual * inverse_c2);
                weight[x] = pull * g[x];
                right[x] = pull * residual;
            }
        });
        let window = options.window_sigma_px;
        Term { weight: gaussian(&weight, window), right: gaussian(&right, window) }
    }

    /// Local correlation of the two pictures and their mean squared difference.
    pub(crate) fn agreement(&self, sigma_px: f32) -> Agreement {
        let smooth = |a: &Raster<f32>, b: &Raster<f32>| gaussian(&product(a, b), sigma_px);
        let mut correlation = smooth(&self.here, &self.there);
        let (aa, bb) = (smooth(&self.here, &self.here), smooth(&self.there, &self.there));
        let mut residual2 = gaussian(&self.mask, sigma_px);
        for (i, c) in correlation.data.iter_mut().enumerate() {
            let (a, b, n) = (aa.data[i], bb.data[i], residual2.data[i]);
            residual2.data[i] = (a + b - 2.0 * *c).max(0.0) / n.max(1e-6);
            *c = if n > 1e-3 { *c / (a * b).sqrt().max(1e-9) } else { 0.0 };
        }
        Agreement { correlation, residual2 }
    }
}

/// How well the pictures fit each other after the last warp.
#[derive(Debug)]
pub(crate) struct Agreement {
    /// Correlation of the local patterns, in [-1, 1]; 0 where there is nothing to compare.
    pub correlation: Raster<f32>,
    /// Mean squared difference of the normalised grey levels.
    pub residual2: Raster<f32>,
}
