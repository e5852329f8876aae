//! How far an estimated relative pose is from the true one.

use selenograph_geometry::{CamA, CamB, Rigid3, Vector3};

/// Angles between an estimated and the true relative pose, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// Relative rotation error, in `[0, 180]`.
    pub rra_deg: f64,
    /// Angle between the translations in camera B, sign kept, in `[0, 180]`; `None` where one of them is zero.
    pub rta_deg: Option<f64>,
}

/// The error of an estimate.
///
/// # Source
/// Relative rotation and translation accuracy as in the paper: the angle of `R_est R_trueᵀ`, and the angle between the
/// two translations without taking its absolute value. By arctangents, which keep their digits at small angles.
pub fn pose_error(truth: &Rigid3<CamB, CamA>, estimate: &Rigid3<CamB, CamA>) -> PoseError {
    let turned = estimate * &truth.inverse();
    let rta_deg = angle_rad(&estimate.origin().coords, &truth.origin().coords).map(f64::to_degrees);
    PoseError { rra_deg: turned.rotation_angle_rad().to_degrees(), rta_deg }
}

/// Angle between two vectors, radians in `[0, π]`; `None` if one of them has no direction.
pub fn angle_rad(a: &Vector3<f64>, b: &Vector3<f64>) -> Option<f64> {
    let (a, b) = (a.try_normalize(0.0)?, b.try_normalize(0.0)?);
    let angle = a.cross(&b).norm().atan2(a.dot(&b));
    angle.is_finite().then_some(angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Point3, Rotation3};

    fn pose(turn_rad: f64, translation: [f64; 3]) -> Rigid3<CamB, CamA> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad);
        let rotation = turn * Rotation3::from_euler_angles(0.3, -0.2, 1.0);
        Rigid3::new(rotation, Point3::from(translation))
    }

    #[test]
    fn angles_are_exact_from_tiny_to_opposite() {
        let truth = pose(0.0, [3.0, 0.0, 0.0]);
        for turn in [1e-9, 1e-4, 0.5, 3.0] {
            let error = pose_error(&truth, &pose(turn, [0.1 * f64::cos(turn), 0.1 * f64::sin(turn), 0.0]));
            assert!((error.rra_deg.to_radians() - turn).abs() < 1e-12 + 1e-7 * turn.min(1e-6), "{turn}");
            assert!((error.rta_deg.unwrap().to_radians() - turn).abs() < 1e-12, "{turn}");
        }
        // The sign of the translation counts.
        assert!((pose_error(&truth, &pose(0.0, [-1.0, 0.0, 0.0])).rta_deg.unwrap() - 180.0).abs() < 1e-9);
        assert_eq!(pose_error(&truth, &pose(0.0, [0.0; 3])).rta_deg, None);
    }
}
