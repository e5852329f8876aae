//! The lower anchor: true poses over a plane.

use super::truth::known_everywhere;
use crate::truth::TruthPair;
use crate::truth::plane::Plane;
use selenograph_geometry::{Cam, CamA, Point3, Rigid3, Vector3};
use selenograph_reconstruct::Prediction;

/// The plane fitted to the true points of both views, seen through both cameras.
pub fn prediction(truth: &TruthPair) -> Prediction {
    let cam_b_from_cam_a = truth.cam_b_from_cam_a();
    let poses: [Rigid3<CamA, Cam>; 2] = [Rigid3::identity(), cam_b_from_cam_a.inverse().relabel()];
    let clouds = [0, 1].map(|k| {
        let points = truth.views[k].points_in_cam();
        let carried = points.data.iter().filter(|p| p.coords.iter().all(|x| x.is_finite()));
        carried.map(|point| poses[k].point(point)).collect::<Vec<_>>()
    });
    let Some(plane) = Plane::fit(clouds.iter().flatten()) else {
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
