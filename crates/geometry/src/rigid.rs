//! Rigid motions between named frames.

use crate::{Error, Frame};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::marker::PhantomData;
use std::ops::Mul;

/// Largest entry of `R Rᵀ − I` that still counts as a rotation: float32 poses of public datasets reach 1e-6.
const ORTHONORMAL_TOLERANCE: f64 = 1e-5;

/// A rigid motion: `x_in_to = to_from * x_in_from`.
///
/// Motions multiply only where the inner frames are the same:
/// ```compile_fail
/// use selenograph_geometry::{BodyFixed, CamA, CamB, Rigid3};
/// fn wrong(world_from_a: Rigid3<BodyFixed, CamA>, world_from_b: Rigid3<BodyFixed, CamB>) {
///     let _ = &world_from_a * &world_from_b;
/// }
/// ```
pub struct Rigid3<To, From> {
    iso: Isometry3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Clone for Rigid3<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Rigid3<To, From> {}
impl<To, From> PartialEq for Rigid3<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.iso == other.iso
    }
}
impl<To: Frame, From: Frame> std::fmt::Debug for Rigid3<To, From> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}_from_{} {:?}", To::NAME, From::NAME, self.iso)
    }
}

impl<To: Frame, From: Frame> Rigid3<To, From> {
    /// From a rotation and the origin of `From` in `To`.
    pub fn new(rotation: Rotation3<f64>, origin_in_to: Point3<f64>) -> Self {
        let quaternion = UnitQuaternion::from_rotation_matrix(&rotation);
        Self::from_iso(Isometry3::from_parts(Translation3::from(origin_in_to.coords), quaternion))
    }

    /// From a unit quaternion (scalar part named `w`) and the origin of `From` in `To`.
    pub fn from_quaternion(w: f64, x: f64, y: f64, z: f64, origin_in_to: Point3<f64>) -> Self {
        let quaternion = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        Self::from_iso(Isometry3::from_parts(Translation3::from(origin_in_to.coords), quaternion))
    }

    /// From a 3×3 matrix that must already be a rotation, and the origin of `From` in `To`.
    ///
    /// # Errors
    /// [`Error::NotARotation`] if the matrix is not orthonormal to 1e-5 or its determinant is not +1.
    pub fn from_matrix(matrix: &Matrix3<f64>, origin_in_to: Point3<f64>) -> Result<Self, Error> {
        let residual = (matrix * matrix.transpose() - Matrix3::identity()).amax();
        if !residual.is_finite() || residual > ORTHONORMAL_TOLERANCE {
            return Err(Error::NotARotation {
                what: format!("R Rᵀ differs from the identity by {residual:.2e}"),
            });
        }
        let determinant = matrix.determinant();
        if determinant < 0.0 {
            return Err(Error::NotARotation {
                what: format!("determinant {determinant:.3} (mirrored axes)"),
            });
        }
        // The nearest rotation removes the float32 noise of a stored pose. By SVD: nalgebra's iterative projection stalls
        // at some half turns.
        let nearest = matrix.svd(true, true);
        let (Some(u), Some(v_t)) = (nearest.u, nearest.v_t) else {
            return Err(Error::NotARotation { what: "its singular values cannot be found".into() });
        };
        let quaternion = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t));
        Ok(Self::from_iso(Isometry3::from_parts(Translation3::from(origin_in_to.coords), quaternion)))
    }

    /// The motion that changes nothing (two names of one frame).
    pub fn identity() -> Self {
        Self::from_iso(Isometry3::identity())
    }

    fn from_iso(iso: Isometry3<f64>) -> Self {
        Self { iso, frames: PhantomData }
    }

    /// The opposite motion.
    pub fn inverse(&self) -> Rigid3<From, To> {
        Rigid3::from_iso(self.iso.inverse())
    }

    /// Where the origin of `From` lies in `To`, metres.
    pub fn origin(&self) -> Point3<f64> {
        Point3::from(self.iso.translation.vector)
    }

    /// The rotation, as a matrix whose columns are the axes of `From` seen in `To`.
    pub fn rotation(&self) -> Matrix3<f64> {
        self.iso.rotation.to_rotation_matrix().into_inner()
    }

    /// The rotation's unit quaternion as `[w, x, y, z]`, with `w ≥ 0`.
    pub fn quaternion_wxyz(&self) -> [f64; 4] {
        let q = self.iso.rotation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        [sign * q.w, sign * q.i, sign * q.j, sign * q.k]
    }

    /// Angle of the rotation, radians in `[0, π]`.
    pub fn rotation_angle_rad(&self) -> f64 {
        self.iso.rotation.angle()
    }

    /// Carries a point.
    pub fn point(&self, point_in_from: &Point3<f64>) -> Point3<f64> {
        self.iso * point_in_from
    }

    /// Carries a direction or displacement (no translation).
    pub fn vector(&self, vector_in_from: &Vector3<f64>) -> Vector3<f64> {
        self.iso.rotation * vector_in_from
    }

    /// The 3×4 matrix `[R | t]`, rows first, as camera files hold it.
    pub fn rows_3x4(&self) -> [[f64; 4]; 3] {
        let r = self.rotation();
        let t = self.origin();
        std::array::from_fn(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]])
    }

    /// Renames the frames without moving anything: for codecs and tests, where the names come from a file.
    pub fn relabel<To2: Frame, From2: Frame>(&self) -> Rigid3<To2, From2> {
        Rigid3::from_iso(self.iso)
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<&Rigid3<B, C>> for &Rigid3<A, B> {
    type Output = Rigid3<A, C>;
    fn mul(self, rhs: &Rigid3<B, C>) -> Rigid3<A, C> {
        Rigid3::from_iso(self.iso * rhs.iso)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BodyFixed, Cam, CamA, CamB};

    fn sample<T: Frame, F: Frame>(seed: f64) -> Rigid3<T, F> {
        let rotation = Rotation3::from_euler_angles(seed, 0.7 * seed - 1.0, 2.0 - seed);
        Rigid3::new(rotation, Point3::new(1.7e6 * seed, -20.0, 4.0 + seed))
    }

    #[test]
    fn inverse_undoes_and_products_chain() {
        let world_from_a: Rigid3<BodyFixed, CamA> = sample(0.3);
        let world_from_b: Rigid3<BodyFixed, CamB> = sample(1.1);
        let b_from_a = &world_from_b.inverse() * &world_from_a;
        let x_in_a = Point3::new(10.0, -3.0, 900.0);
        let through_world = world_from_b.inverse().point(&world_from_a.point(&x_in_a));
        assert!((b_from_a.point(&x_in_a) - through_world).norm() < 1e-8);
        let back = world_from_a.inverse().point(&world_from_a.point(&x_in_a));
        assert!((back - x_in_a).norm() < 1e-9);
    }

    #[test]
    fn quaternion_round_trips_and_has_positive_scalar() {
        let m: Rigid3<BodyFixed, Cam> = sample(2.9);
        let [w, x, y, z] = m.quaternion_wxyz();
        assert!(w >= 0.0);
        let again = Rigid3::<BodyFixed, Cam>::from_quaternion(w, x, y, z, m.origin());
        assert!((again.rotation() - m.rotation()).amax() < 1e-14);
    }

    #[test]
    fn half_turns_survive_the_projection() {
        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.3, -0.5, 0.81]] {
            let axis = nalgebra::UnitVector3::new_normalize(Vector3::from(axis));
            let turn = Rotation3::from_axis_angle(&axis, std::f64::consts::PI);
            let m = Rigid3::<BodyFixed, Cam>::from_matrix(turn.matrix(), Point3::origin()).unwrap();
            assert!((m.rotation() - turn.matrix()).amax() < 1e-12, "{axis:?}");
        }
    }

    #[test]
    fn mirrored_and_skewed_matrices_are_refused() {
        let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        assert!(Rigid3::<BodyFixed, Cam>::from_matrix(&mirrored, Point3::origin()).is_err());
        let skewed = Matrix3::new(1.0, 0.01, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        assert!(Rigid3::<BodyFixed, Cam>::from_matrix(&skewed, Point3::origin()).is_err());
    }
}
