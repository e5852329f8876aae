//! How high camera A stands over the predicted surface, in the prediction's unit.
//!
//! The definition is that of an altimeter: the distance from the camera's centre straight down to the surface below.
//!
//! 1. *Straight down* is against the local vertical where the attitude is known, else against the normal of the plane
//!    fitted to the surface.
//! 2. If the picture shows the ground below the camera (at least [`MIN_POINTS_BELOW`] measured points within
//!    [`BELOW_RAD`] of straight down), the altitude is the median of their distances along the vertical; its error is
//!    that of a median of correlated points: their spread (1.4826 × the median deviation).
//! 3. Else the ground below is not seen, and the fitted plane is carried on to it. The error is the plane's own
//!    residual, grown with the distance over which it is carried on.

use crate::Error;
use crate::grid::plane;
use crate::prediction::{Fill, Prediction};
use selenograph_geometry::{Vector3, robust::MAD_TO_SIGMA};
use selenograph_raster::statistics::median;

/// Half angle of the cone straight below the camera, radians (2°: a laser altimeter's spot is smaller, a few pixels of
/// a lunar camera are not).
pub const BELOW_RAD: f64 = 0.035;
/// Fewer points than this in the cone are too few for a median that one blunder cannot move.
pub const MIN_POINTS_BELOW: usize = 30;

/// Height of camera A over the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AboveSurface {
    /// Prediction's unit.
    pub altitude: f64,
    /// Standard deviation, prediction's unit.
    pub sigma: f64,
    /// Whether the ground below was seen; else a plane was carried on to it.
    pub seen_below: bool,
}

/// Height of camera A over the predicted surface; `up` in the axes of camera A where the attitude is known.
///
/// # Errors
/// [`Error::TooFewPoints`] without a surface; [`Error::Undetermined`] where it lies level with the camera or above it.
pub fn above_surface(prediction: &Prediction, up: Option<&Vector3<f64>>) -> Result<AboveSurface, Error> {
    let points = measured_points(prediction);
    let plane = plane::fit(&points, &Vector3::zeros())?;
    let up = up.copied().unwrap_or(plane.normal);
    let inside = BELOW_RAD.cos();
    let drop_of = |p: &Vector3<f64>| -p.dot(&up);
    let below: Vec<f64> = points.iter().filter(|p| drop_of(p) > inside * p.norm()).map(drop_of).collect();
    let found = if below.len() >= MIN_POINTS_BELOW {
        let altitude = median(below.iter().copied()).unwrap_or(f64::NAN);
        let deviation = median(below.iter().map(|d| (d - altitude).abs())).unwrap_or(f64::NAN);
        AboveSurface { altitude, sigma: MAD_TO_SIGMA * deviation, seen_below: true }
    } else {
        // The plane (p − c)·n = 0, met by p = −t·up.
        let facing = up.dot(&plane.normal);
        let altitude = -plane.center.dot(&plane.normal) / facing;
        let away = (plane.center + up * altitude).norm() / plane.spread;
        AboveSurface { altitude, sigma: plane.residual_rms * (1.0 + away * away).sqrt(), seen_below: false }
    };
    if found.altitude.is_finite() && found.altitude > 0.0 {
        return Ok(found);
    }
    Err(Error::Undetermined {
        what: "scale from the altitude",
        why: format!("the surface is not below camera A (altitude {:.3} of its unit)", found.altitude),
    })
}

/// Measured points of view A, thinned to at most some ten thousand.
fn measured_points(prediction: &Prediction) -> Vec<Vector3<f64>> {
    let Some([a, _]) = &prediction.views else { return Vec::new() };
    let step = ((a.points.data.len() as f64 / 65_536.0).sqrt().ceil() as usize).max(1);
    let (width, height) = (a.points.width, a.points.height);
    let pixels = (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| (x, y)));
    pixels
        .filter(|&at| a.fill[at] == Fill::Measured)
        .map(|at| Vector3::from(a.points[at].map(f64::from)))
        .filter(|p| p.norm_squared().is_finite())
        .collect()
}
