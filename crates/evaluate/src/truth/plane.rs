//! The plane nearest to a view's true points: the lower anchor, and what a pixel without answer counts as.

use selenograph_geometry::{Matrix3, Point3, SymmetricEigen, Vector3};

/// A plane `normal · x = offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: Vector3<f64>,
    /// Distance from the origin along it.
    pub offset: f64,
}

impl Plane {
    /// The plane with the least squared distances to the finite points; `None` below three of them.
    pub fn fit<'a>(points: impl Iterator<Item = &'a Point3<f64>> + Clone) -> Option<Self> {
        let finite = points.filter(|p| p.coords.iter().all(|c| c.is_finite()));
        let (count, sum) =
            finite.clone().fold((0usize, Vector3::zeros()), |(count, sum), p| (count + 1, sum + p.coords));
        if count < 3 {
            return None;
        }
        let mean = sum / count as f64;
        let scatter = finite.fold(Matrix3::zeros(), |scatter, p| {
            let off = p.coords - mean;
            scatter + off * off.transpose()
        });
        let eigen = SymmetricEigen::new(scatter);
        let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).normalize();
        Some(Self { normal, offset: normal.dot(&mean) })
    }

    /// Where a ray from the origin meets the plane; `None` behind it or along it.
    pub fn along(&self, ray: &Vector3<f64>) -> Option<Point3<f64>> {
        let reach = self.offset / self.normal.dot(ray);
        (reach.is_finite() && reach > 0.0).then(|| Point3::from(ray * reach))
    }

    /// How far the plane's answer for a pixel is from the true point on the pixel's ray; for a ray that never meets the
    /// plane, the point's distance from it.
    pub fn error_of(&self, point: &Point3<f64>) -> f64 {
        match self.along(&point.coords) {
            Some(answer) => (answer - point).norm(),
            None => (self.normal.dot(&point.coords) - self.offset).abs(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_found_and_met() {
        let normal = Vector3::new(0.2, -0.4, -1.0).normalize();
        let points: Vec<Point3<f64>> = (0..50)
            .map(|i| {
                let ray = Vector3::new(f64::from(i % 7) * 0.05 - 0.1, f64::from(i / 7) * 0.04 - 0.1, 1.0);
                Point3::from(ray * (-30_000.0 / normal.dot(&ray)))
            })
            .collect();
        let plane = Plane::fit(points.iter()).unwrap();
        assert!((plane.normal.dot(&normal).abs() - 1.0).abs() < 1e-12);
        assert!(points.iter().all(|p| plane.error_of(p) < 1e-6));
        assert!((plane.error_of(&(points[3] * 1.01)) - 0.01 * points[3].coords.norm()).abs() < 1e-6);
        assert_eq!(plane.along(&-points[3].coords), None);
        assert!(Plane::fit(points[..2].iter()).is_none());
    }
}
