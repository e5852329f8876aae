//! Both views' points in the coordinates of a grid, around a local origin so that f32 holds them.

use super::frame::{GridFrame, sampled_points};
use crate::Error;
use crate::prediction::{Fill, PredictedView, Prediction};
use rayon::prelude::*;
use selenograph_geometry::{Point3, Vector3};
use selenograph_raster::Raster;

/// The points of one view.
#[derive(Debug, Clone)]
pub struct LiftedView<'a> {
    /// x, y, height against [`Lifted::origin`]; NaN where absent.
    pub points: Raster<[f32; 3]>,
    /// Confidence, as predicted.
    pub confidence: &'a Raster<f32>,
    /// Standard deviation along the ray in the grid's unit, where the method has one.
    pub sigma: Option<Raster<f32>>,
    /// Where each point comes from.
    pub fill: &'a Raster<Fill>,
    /// The camera's centre against [`Lifted::origin`]; `None` where it is not known.
    pub center: Option<[f32; 3]>,
}

/// The points of both views in the coordinates of a grid.
#[derive(Debug, Clone)]
pub struct Lifted<'a> {
    /// x, y and height from which the points are counted.
    pub origin: [f64; 3],
    /// View A, view B.
    pub views: [LiftedView<'a>; 2],
}

/// Carries every point into the grid's coordinates.
///
/// # Errors
/// [`Error::TooFewPoints`] for a prediction without points; [`Error::SizeMismatch`] if the rasters of a view differ in
/// size.
pub fn lift<'a>(prediction: &'a Prediction, frame: &GridFrame) -> Result<Lifted<'a>, Error> {
    let none = || Error::TooFewPoints { what: "an elevation model", needed: 3, found: 0 };
    let views = prediction.views.as_ref().ok_or_else(none)?;
    let sample = sampled_points(prediction);
    if sample.is_empty() {
        return Err(none());
    }
    let middle = sample.iter().sum::<Vector3<f64>>() / sample.len() as f64;
    // Whole units: an origin that people can read in a file's header.
    let origin = frame.point(&Point3::from(middle)).ok_or_else(none)?.map(|v| round_to(v, 3.0));
    let cam_b = prediction.cam_b_from_cam_a.as_ref().ok();
    let centers = [Some(Point3::origin()), cam_b.map(|b| b.inverse().origin())];
    let [a, b] = views;
    let lifted = |view: &'a PredictedView, center: Option<Point3<f64>>| -> Result<LiftedView<'a>, Error> {
        let size = (view.points.width, view.points.height);
        let others = [(view.confidence.width, view.confidence.height), (view.fill.width, view.fill.height)];
        let sigma_size = view.sigma.as_ref().map_or(size, |s| (s.width, s.height));
        if let Some(found) = others.into_iter().chain([sigma_size]).find(|&other| other != size) {
            return Err(Error::SizeMismatch {
                what: "confidence, sigma and fill of a view",
                expected: format!("{}×{}", size.0, size.1),
                found: format!("{}×{}", found.0, found.1),
            });
        }
        Ok(LiftedView {
            points: carried(&view.points, &view.fill, frame, &origin),
            confidence: &view.confidence,
            sigma: view.sigma.as_ref().map(|s| s.map(|v| v * frame.scale() as f32)),
            fill: &view.fill,
            center: center.and_then(|c| frame.point(&c)).map(|c| relative(c, &origin)),
        })
    };
    let (a, b) = rayon::join(|| lifted(a, centers[0]), || lifted(b, centers[1]));
    Ok(Lifted { origin, views: [a?, b?] })
}

/// A number with so many significant digits.
pub(crate) fn round_to(value: f64, digits: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let step = 10f64.powf(value.abs().log10().floor() + 1.0 - digits);
    // Dividing by a whole number keeps 0.1 what it is; multiplying by its inverse would not.
    if step >= 1.0 { (value / step).round() * step } else { (value / step).round() / (1.0 / step).round() }
}

fn relative(p: [f64; 3], origin: &[f64; 3]) -> [f32; 3] {
    std::array::from_fn(|i| (p[i] - origin[i]) as f32)
}

const ABSENT: [f32; 3] = [f32::NAN; 3];

fn carried(
    points: &Raster<[f32; 3]>,
    fill: &Raster<Fill>,
    frame: &GridFrame,
    origin: &[f64; 3],
) -> Raster<[f32; 3]> {
    let mut out = Raster::filled(points.width, points.height, ABSENT);
    let width = points.width.max(1);
    out.data
        .par_chunks_mut(width)
        .zip(points.data.par_chunks(width))
        .zip(fill.data.par_chunks(width))
        .for_each(|((out, points), fill)| {
            for ((out, point), fill) in out.iter_mut().zip(points).zip(fill) {
                if *fill == Fill::Absent || !point.iter().all(|v| v.is_finite()) {
                    continue;
                }
                let p = Point3::from(point.map(f64::from));
                *out = frame.point(&p).map_or(ABSENT, |p| relative(p, origin));
            }
        });
    out
}
