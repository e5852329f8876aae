//! The lower anchor: true poses over a plane.

use super::truth::known_everywhere;
use crate::truth::TruthPair;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use selenograph_geometry::{Cam, CamA, Rigid3};
use selenograph_reconstruct::Prediction;

/// `normal · x = offset`, in camera A, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Plane {
    normal: Vector3<f64>,
    offset: f64,
}

/// The plane fitted to the true points of both views, seen through both cameras.
pub fn prediction(truth: &TruthPair) -> Prediction {
    let cam_b_from_cam_a = truth.cam_b_from_cam_a();
    let poses: [Rigid3<CamA, Cam>; 2] = [Rigid3::identity(), cam_b_from_cam_a.inverse().relabel()];
    let clouds = [0, 1].map(|k| {
        let points = truth.views[k].points_in_cam();
        let carried = points.data.iter().filter(|p| p.coords.iter().all(|x| x.is_finite()));
        carried.map(|point| poses[k].point(point)).collect::<Vec<_>>()
    });
    let Some(plane) = fit(clouds.iter().flatten()) else {
        return Prediction { cam_b_from_cam_a: Ok(cam_b_from_cam_a), views: None };
    };
    let views = [0, 1].map(|k| {
        let (view, pose) = (&truth.views[k], &poses[k]);
        let origin = pose.origin();
        let on_plane = view.rays_z1().map(|ray| {
            let ray_in_a = pose.vector(ray);
            let z = (plane.offset - plane.normal.dot(&origin.coords)) / plane.normal.dot(&ray_in_a);
            // A plane behind the camera is no answer.
            if z > 0.0 && z.is_finite() {
                Point3::from(ray * z)
            } else {
                Point3::from(Vector3::repeat(f64::NAN))
            }
        });
        known_everywhere(&on_plane, pose)
    });
    Prediction { cam_b_from_cam_a: Ok(cam_b_from_cam_a), views: Some(views) }
}

/// Least squares of the distances to the plane; `None` below three points.
fn fit<'a>(points: impl Iterator<Item = &'a Point3<f64>> + Clone) -> Option<Plane> {
    let count = points.clone().count();
    if count < 3 {
        return None;
    }
    let centre = points.clone().map(|point| point.coords).sum::<Vector3<f64>>() / count as f64;
    let spread: Matrix3<f64> = points
        .map(|point| {
            let off = point.coords - centre;
            off * off.transpose()
        })
        .sum();
    let eigen = SymmetricEigen::new(spread);
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    Some(Plane { normal, offset: normal.dot(&centre) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_plane_are_met() {
        let normal = Vector3::new(0.2, -0.1, 1.0).normalize();
        let points: Vec<Point3<f64>> = (0..50)
            .map(|k| {
                let (x, y) = (f64::from(k % 7), f64::from(k / 7));
                Point3::new(x, y, (40.0 - normal.x * x - normal.y * y) / normal.z)
            })
            .collect();
        let plane = fit(points.iter()).unwrap();
        let sign = plane.normal.dot(&normal).signum();
        assert!((plane.normal * sign - normal).norm() < 1e-12 && (plane.offset * sign - 40.0).abs() < 1e-12);
        assert!(fit(points[..2].iter()).is_none());
    }
}
