//! Similarities between named frames: what leads from a prediction's unit of length into metres.

use crate::{Error, Frame, Rigid3};
use nalgebra::{Matrix3, Point3, Vector3};
use std::ops::Mul;

/// A rotation, one positive scale and a translation: `x_in_to = scale · R x_in_from + t`.
pub struct Sim3<To, From> {
    scale: f64,
    rigid: Rigid3<To, From>,
}

impl<To, From> Clone for Sim3<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Sim3<To, From> {}

impl<To, From> PartialEq for Sim3<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.scale == other.scale && self.rigid == other.rigid
    }
}

impl<To: Frame, From: Frame> std::fmt::Debug for Sim3<To, From> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.9} × {:?}", self.scale, self.rigid)
    }
}

impl<To: Frame, From: Frame> Sim3<To, From> {
    /// From a scale (length of a unit of `From` in `To`) and a rigid motion that is applied after it.
    ///
    /// # Errors
    /// [`Error::Scale`] unless the scale is positive and finite.
    pub fn new(scale: f64, rigid: Rigid3<To, From>) -> Result<Self, Error> {
        if scale.is_finite() && scale > 0.0 { Ok(Self { scale, rigid }) } else { Err(Error::Scale { scale }) }
    }

    /// A rigid motion as a similarity of scale 1.
    pub fn from_rigid(rigid: Rigid3<To, From>) -> Self {
        Self { scale: 1.0, rigid }
    }

    /// Length of a unit of `From`, in units of `To`.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The rotation, as a matrix.
    pub fn rotation(&self) -> Matrix3<f64> {
        self.rigid.rotation()
    }

    /// Where the origin of `From` lies in `To`.
    pub fn origin(&self) -> Point3<f64> {
        self.rigid.origin()
    }

    /// The rotation and translation, without the scale.
    pub fn rigid(&self) -> &Rigid3<To, From> {
        &self.rigid
    }

    /// Carries a point.
    pub fn point(&self, point_in_from: &Point3<f64>) -> Point3<f64> {
        self.rigid.point(&(point_in_from * self.scale))
    }

    /// Carries a displacement (scaled and turned, not translated).
    pub fn vector(&self, vector_in_from: &Vector3<f64>) -> Vector3<f64> {
        self.rigid.vector(&(vector_in_from * self.scale))
    }

    /// The opposite similarity.
    pub fn inverse(&self) -> Sim3<From, To> {
        let inverse = self.rigid.inverse();
        let origin = Point3::from(inverse.origin().coords / self.scale);
        let [w, x, y, z] = inverse.quaternion_wxyz();
        Sim3 { scale: 1.0 / self.scale, rigid: Rigid3::from_quaternion(w, x, y, z, origin) }
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<&Sim3<B, C>> for &Sim3<A, B> {
    type Output = Sim3<A, C>;
    fn mul(self, rhs: &Sim3<B, C>) -> Sim3<A, C> {
        let origin = self.point(&rhs.origin());
        let turned = &self.rigid * &rhs.rigid;
        let [w, x, y, z] = turned.quaternion_wxyz();
        Sim3 { scale: self.scale * rhs.scale, rigid: Rigid3::from_quaternion(w, x, y, z, origin) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BodyFixed, CamA, PredA, Rotation3};

    fn sample<T: Frame, F: Frame>(scale: f64, seed: f64) -> Sim3<T, F> {
        let rotation = Rotation3::from_euler_angles(seed, 0.7 * seed - 1.0, 2.0 - seed);
        Sim3::new(scale, Rigid3::new(rotation, Point3::new(50.0 * seed, -20.0, 4.0 + seed))).unwrap()
    }

    #[test]
    fn inverse_undoes_and_products_chain() {
        let a: Sim3<BodyFixed, CamA> = sample(3.0, 0.4);
        let b: Sim3<CamA, PredA> = sample(0.2, 1.7);
        let x = Point3::new(1.0, -2.0, 30.0);
        assert!((a.inverse().point(&a.point(&x)) - x).norm() < 1e-12);
        assert!(((&a * &b).point(&x) - a.point(&b.point(&x))).norm() < 1e-12);
        let y = Point3::new(-4.0, 0.5, 2.0);
        assert!((a.vector(&(x - y)) - (a.point(&x) - a.point(&y))).norm() < 1e-12);
    }

    #[test]
    fn a_scale_that_is_none_is_refused() {
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Sim3::<BodyFixed, PredA>::new(scale, Rigid3::identity()).is_err());
        }
    }
}
