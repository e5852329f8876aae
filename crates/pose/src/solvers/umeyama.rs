//! The similarity or rigid motion of least squared distance between weighted points.
//!
//! With weighted means removed: `M = Σ w q pᵀ = U S Vᵀ`, `R = U D Vᵀ`, `s = tr(S D) / Σ w ‖p‖²`, `t = q̄ − s R p̄`.
//!
//! Precondition: at least three points that are not on a line.
//! # Source
//! Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns", IEEE TPAMI 13(4), eq. 40-42.

use crate::solvers::rotation::rotation_of_correlation;
use selenograph_geometry::{Frame, Matrix3, Point3, Rigid3, Rotation3, Sim3, Vector3};

/// Whether a scale is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scaling {
    /// A scale is estimated: a similarity.
    #[default]
    Free,
    /// The scale stays 1: a rigid motion.
    One,
}

/// Weighted sums of point pairs; moments can be added up in parts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moments {
    shift_p: Vector3<f64>,
    shift_q: Vector3<f64>,
    weight: f64,
    sum_p: Vector3<f64>,
    sum_q: Vector3<f64>,
    correlation: Matrix3<f64>,
    square_p: f64,
}

impl Moments {
    /// Empty sums about two points near the data, which keeps map coordinates from losing digits.
    pub fn about(p: &Point3<f64>, q: &Point3<f64>) -> Self {
        Self {
            shift_p: p.coords,
            shift_q: q.coords,
            weight: 0.0,
            sum_p: Vector3::zeros(),
            sum_q: Vector3::zeros(),
            correlation: Matrix3::zeros(),
            square_p: 0.0,
        }
    }

    /// Takes a pair in.
    pub fn add(&mut self, p: &Point3<f64>, q: &Point3<f64>, weight: f64) {
        let (p, q) = (p.coords - self.shift_p, q.coords - self.shift_q);
        let wp = weight * p;
        self.weight += weight;
        self.sum_p += wp;
        self.sum_q += weight * q;
        self.correlation += q * wp.transpose();
        self.square_p += p.dot(&wp);
    }

    /// The best similarity or rigid motion; none where the points do not fix one.
    pub fn solve<To: Frame, From: Frame>(&self, scaling: Scaling) -> Option<Sim3<To, From>> {
        if self.weight.is_nan() || self.weight <= 0.0 {
            return None;
        }
        let (mean_p, mean_q) = (self.sum_p / self.weight, self.sum_q / self.weight);
        let correlation = self.correlation / self.weight - mean_q * mean_p.transpose();
        let variance = self.square_p / self.weight - mean_p.norm_squared();
        let (rotation, trace) = rotation_of_correlation(&correlation)?;
        let scale = match scaling {
            Scaling::Free => trace / variance,
            Scaling::One => 1.0,
        };
        let origin = mean_q + self.shift_q - scale * rotation * (mean_p + self.shift_p);
        let rigid = Rigid3::new(Rotation3::from_matrix_unchecked(rotation), Point3::from(origin));
        Sim3::new(scale, rigid).ok()
    }
}

/// The similarity (or rigid motion) that carries `from` to `to` with the least sum of weighted squared distances.
///
/// # Shapes and units
/// Iterates over `(point in From, point in To, weight)`.
pub fn umeyama<To: Frame, From: Frame>(
    pairs: impl IntoIterator<Item = (Point3<f64>, Point3<f64>, f64)>,
    scaling: Scaling,
) -> Option<Sim3<To, From>> {
    let mut pairs = pairs.into_iter();
    let (p, q, weight) = pairs.next()?;
    let mut moments = Moments::about(&p, &q);
    moments.add(&p, &q, weight);
    for (p, q, weight) in pairs {
        moments.add(&p, &q, weight);
    }
    moments.solve(scaling)
}
