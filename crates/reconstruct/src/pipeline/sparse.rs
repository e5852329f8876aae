//! A point per match: what the method `sift` has of the ground.

use super::given::Start;
use crate::{Fill, PredictedView, View};
use selenograph_geometry::{Camera, Point2, Vector3, pixel};
use selenograph_pose::decompose::Motion;
use selenograph_pose::triangulate;
use selenograph_raster::Raster;

/// Matches that agree with the pose, triangulated; each stands at the pixel that holds it, in both views.
pub(super) fn views(a: &View, b: &View, start: &Start) -> [PredictedView; 2] {
    let motion = Motion {
        rotation: start.cam_b_from_cam_a.rotation(),
        translation: start.cam_b_from_cam_a.origin().coords,
    };
    let mut views = [a, b].map(|view| empty(&view.camera));
    for m in start.matches.iter().filter(|m| m.inlier) {
        let (Some(ray_a), Some(ray_b)) = (a.camera.ray_z1(&m.a), b.camera.ray_z1(&m.b)) else { continue };
        let Some(found) = triangulate::optimal(&motion, &ray_a, &ray_b) else { continue };
        let x_in_a = found.x_in_a.coords;
        let in_front = x_in_a.z > 0.0 && (motion.rotation * x_in_a + motion.translation).z > 0.0;
        if !in_front {
            continue;
        }
        // Along the ray an error across it grows by one over the parallax.
        let error_rad = m.sigma_px.unwrap_or(m.residual_px.abs()) / (a.camera.fx * a.camera.fy).sqrt();
        let sigma = x_in_a.norm() * error_rad / found.parallax_rad.sin();
        put(&mut views[0], &m.a, &x_in_a, sigma);
        put(&mut views[1], &m.b, &x_in_a, sigma);
    }
    views
}

fn empty(camera: &Camera) -> PredictedView {
    let (width, height) = (camera.width, camera.height);
    PredictedView {
        points: Raster::filled(width, height, [f32::NAN; 3]),
        confidence: Raster::filled(width, height, 0.0),
        sigma: Some(Raster::filled(width, height, f32::NAN)),
        fill: Raster::filled(width, height, Fill::Absent),
    }
}

fn put(view: &mut PredictedView, at: &Point2<f64>, point: &Vector3<f64>, sigma: f64) {
    let inside = |coordinate: f64, size: usize| {
        usize::try_from(pixel::index_of(coordinate)).ok().filter(|index| *index < size)
    };
    let (Some(x), Some(y)) = (inside(at.x, view.points.width), inside(at.y, view.points.height)) else {
        return;
    };
    view.points[(x, y)] = [point.x as f32, point.y as f32, point.z as f32];
    view.confidence[(x, y)] = 1.0;
    view.fill[(x, y)] = Fill::Measured;
    if let Some(sigmas) = &mut view.sigma {
        sigmas[(x, y)] = sigma as f32;
    }
}
