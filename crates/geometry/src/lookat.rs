//! Camera orientations from a viewing direction, exactly orthonormal.

use crate::{Cam, Error, Frame, Rigid3};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

/// Below this sine the viewing direction and the hint coincide and the roll is undefined.
const MIN_SINE: f64 = 1e-9;

/// A camera at `origin` that looks along `forward`, with its X axis as near as possible to `right_hint`
/// (Gram-Schmidt on X, so the frame is exactly orthonormal).
///
/// # Errors
/// [`Error::Degenerate`] if the two directions coincide or one is zero.
pub fn from_forward_and_right<W: Frame>(
    origin: Point3<f64>,
    forward: &Vector3<f64>,
    right_hint: &Vector3<f64>,
) -> Result<Rigid3<W, Cam>, Error> {
    let degenerate =
        Error::Degenerate { what: "the viewing direction and the direction of the image's right" };
    let z = forward.try_normalize(0.0).ok_or(degenerate.clone())?;
    let hint = right_hint.try_normalize(0.0).ok_or(degenerate.clone())?;
    let x = (hint - z * z.dot(&hint)).try_normalize(MIN_SINE).ok_or(degenerate)?;
    let y = z.cross(&x);
    Ok(Rigid3::new(Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z])), origin))
}

/// A camera at `origin` that looks along `forward` with a level horizon: its X axis is `forward × up`.
///
/// # Errors
/// [`Error::Degenerate`] if it looks straight up or down, where a level horizon is undefined.
pub fn level<W: Frame>(
    origin: Point3<f64>,
    forward: &Vector3<f64>,
    up: &Vector3<f64>,
) -> Result<Rigid3<W, Cam>, Error> {
    from_forward_and_right(origin, forward, &forward.cross(up))
        .map_err(|_| Error::Degenerate { what: "the viewing direction and the vertical" })
}

/// The same camera turned about its own axes: first `roll` about Z (clockwise in the picture's scene), in the camera.
pub fn rolled<W: Frame>(world_from_cam: &Rigid3<W, Cam>, roll_rad: f64) -> Rigid3<W, Cam> {
    let turn =
        Rigid3::<Cam, Cam>::new(Rotation3::from_axis_angle(&Vector3::z_axis(), roll_rad), Point3::origin());
    world_from_cam * &turn
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BodyFixed;

    #[test]
    fn frames_are_orthonormal_and_look_where_told() {
        let origin = Point3::new(1.0e6, 2.0e6, -3.0e5);
        let forward = Vector3::new(0.3, -0.5, -0.8);
        let m: Rigid3<BodyFixed, Cam> = level(origin, &forward, &Vector3::z()).unwrap();
        assert!((m.vector(&Vector3::z()) - forward.normalize()).norm() < 1e-14);
        assert!((m.rotation() * m.rotation().transpose() - Matrix3::identity()).amax() < 1e-14);
        // Level: the X axis is horizontal, and down in the picture is down in the world.
        assert!(m.vector(&Vector3::x()).z.abs() < 1e-14);
        assert!(m.vector(&Vector3::y()).z < 0.0);
        let turned = rolled(&m, 0.4);
        assert!((turned.vector(&Vector3::z()) - m.vector(&Vector3::z())).norm() < 1e-14);
    }

    #[test]
    fn looking_straight_down_has_no_level_horizon() {
        let down = level::<BodyFixed>(Point3::new(0.0, 0.0, 5.0), &-Vector3::z(), &Vector3::z());
        assert!(matches!(down, Err(Error::Degenerate { .. })));
    }
}
