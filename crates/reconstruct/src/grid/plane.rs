//! The plane through a surface, which a few blunders cannot turn.

use crate::Error;
use selenograph_geometry::{Matrix3, Vector3, robust::MAD_TO_SIGMA};

/// A plane `(p − center)·normal = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Middle of the points that count.
    pub center: Vector3<f64>,
    /// Unit normal, towards the viewer.
    pub normal: Vector3<f64>,
    /// Root mean square distance of the points that count.
    pub residual_rms: f64,
    /// Root mean square distance of the points that count from the middle, along the plane.
    pub spread: f64,
}

/// Fewest points of a plane.
const MIN_POINTS: usize = 3;
/// Rounds of reweighting: each halves what a blunder can still do, eight are past any change in print.
const ROUNDS: usize = 8;
/// Cauchy's constant: 95 % efficient where there are no blunders (Holland & Welsch 1977).
const CAUCHY: f64 = 2.385;

/// The plane with the least distances, in total least squares reweighted by Cauchy's function.
///
/// # Errors
/// [`Error::TooFewPoints`] below three points; [`Error::Undetermined`] if they lie on a line.
/// # Source
/// Holland & Welsch 1977, "Robust regression using iteratively reweighted least-squares".
pub fn fit(points: &[Vector3<f64>], viewer: &Vector3<f64>) -> Result<Plane, Error> {
    if points.len() < MIN_POINTS {
        let (what, needed) = ("a plane", MIN_POINTS);
        return Err(Error::TooFewPoints { what, needed, found: points.len() });
    }
    let mut weights = vec![1.0; points.len()];
    let mut plane = weighted(points, &weights, viewer)?;
    for _ in 0..ROUNDS {
        let distance = |p: &Vector3<f64>| (p - plane.center).dot(&plane.normal).abs();
        let typical = selenograph_raster::statistics::median(points.iter().map(distance)).unwrap_or(0.0);
        if typical <= 1e-12 * plane.spread {
            break;
        }
        let limit = CAUCHY * MAD_TO_SIGMA * typical;
        for (weight, p) in weights.iter_mut().zip(points) {
            *weight = 1.0 / (1.0 + (distance(p) / limit).powi(2));
        }
        plane = weighted(points, &weights, viewer)?;
    }
    Ok(plane)
}

fn weighted(points: &[Vector3<f64>], weights: &[f64], viewer: &Vector3<f64>) -> Result<Plane, Error> {
    let total: f64 = weights.iter().sum();
    let center = points.iter().zip(weights).map(|(p, w)| p * *w).sum::<Vector3<f64>>() / total;
    let mut scatter = Matrix3::zeros();
    for (p, w) in points.iter().zip(weights) {
        let d = p - center;
        scatter += d * d.transpose() * *w;
    }
    let eigen = (scatter / total).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let [least, middle, most] = order.map(|i| eigen.eigenvalues[i].max(0.0));
    if middle <= 1e-12 * most || most <= 0.0 {
        return Err(Error::Undetermined { what: "a plane", why: "the points lie on a line".to_owned() });
    }
    let mut normal: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
    if normal.dot(&(viewer - center)) < 0.0 {
        normal = -normal;
    }
    Ok(Plane { center, normal, residual_rms: least.sqrt(), spread: (middle + most).sqrt() })
}
