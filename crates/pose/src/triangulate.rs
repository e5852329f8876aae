//! Points from two views.

use crate::decompose::Motion;
use selenograph_geometry::{Matrix3, Point3, Vector3};

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangulated {
    /// In camera A, in units of the motion's translation.
    pub x_in_a: Point3<f64>,
    /// Angle between the two rays, radians.
    pub parallax_rad: f64,
    /// Distance between the two rays where they are nearest, in units of the translation.
    pub gap: f64,
}

/// The midpoint of the shortest segment between the two rays; none where they are parallel.
///
/// # Shapes and units
/// `a`, `b`: directions of any length in their cameras. The point may lie behind: see [`crate::cheirality::in_front`].
pub fn midpoint(motion: &Motion, a: &Vector3<f64>, b: &Vector3<f64>) -> Option<Triangulated> {
    let p = (motion.rotation * a).normalize();
    let q = b.normalize();
    let t = &motion.translation;
    let cosine = p.dot(&q);
    let sine = p.cross(&q).norm();
    let sine_squared = sine * sine;
    if sine_squared < f64::EPSILON * f64::EPSILON {
        return None;
    }
    let (pt, qt) = (p.dot(t), q.dot(t));
    let along_a = (cosine * qt - pt) / sine_squared;
    let along_b = (qt - cosine * pt) / sine_squared;
    let (on_a, on_b) = (along_a * p + t, along_b * q);
    let middle = 0.5 * (on_a + on_b) - t;
    Some(Triangulated {
        x_in_a: Point3::from(motion.rotation.transpose() * middle),
        parallax_rad: sine.atan2(cosine),
        gap: (on_a - on_b).norm(),
    })
}

/// The smallest change of both image points (least squares on the planes `z = 1`) that makes their rays meet.
///
/// Two steps of the iteration reach machine precision for any noise worth triangulating.
/// # Source
/// Lindstrom 2010, "Triangulation made easy", CVPR, listing 3 (`niter2`), with `bᵀ E a = 0`.
pub fn corrected(e: &Matrix3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let upper = e.fixed_view::<2, 2>(0, 0).into_owned();
    let mut line_b = (e * a).xy();
    let mut line_a = (e.transpose() * b).xy();
    let top = line_b.dot(&(upper * line_a));
    let half = 0.5 * (line_a.norm_squared() + line_b.norm_squared());
    let error = b.dot(&(e * a));
    let root = (half * half - top * error).max(0.0).sqrt();
    let step = error / (half + root).max(f64::MIN_POSITIVE);
    let (first_a, first_b) = (step * line_a, step * line_b);
    line_b -= upper * first_a;
    line_a -= upper.transpose() * first_b;
    let norm = line_a.norm_squared() + line_b.norm_squared();
    let scale = step * 2.0 * root / norm.max(f64::MIN_POSITIVE);
    let (move_a, move_b) = (scale * line_a, scale * line_b);
    (a - Vector3::new(move_a.x, move_a.y, 0.0), b - Vector3::new(move_b.x, move_b.y, 0.0))
}

/// The point of least squared image error: [`corrected`], then [`midpoint`].
pub fn optimal(motion: &Motion, a: &Vector3<f64>, b: &Vector3<f64>) -> Option<Triangulated> {
    let (a, b) = corrected(&motion.essential(), a, b);
    midpoint(motion, &a, &b)
}
