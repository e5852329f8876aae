//! Depth of pixels into points.

use crate::PredictedView;
use crate::stereo::{Dense, DenseView};
use rayon::prelude::*;
use selenograph_geometry::{CamA, CamB, Camera, Point2, Rigid3, Vector3, pixel};
use selenograph_raster::Raster;

/// Both views' depths as points in the frame of camera A.
pub(super) fn predicted(
    dense: &Dense,
    cameras: [&Camera; 2],
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
) -> [PredictedView; 2] {
    let back = cam_b_from_cam_a.inverse();
    let (turn, origin) = (back.rotation(), back.origin().coords);
    let [a, b] = &dense.views;
    [
        points_of(a, cameras[0], |x_in_cam| x_in_cam),
        points_of(b, cameras[1], |x_in_cam| turn * x_in_cam + origin),
    ]
}

fn points_of(
    view: &DenseView,
    camera: &Camera,
    carry: impl Fn(Vector3<f64>) -> Vector3<f64> + Sync,
) -> PredictedView {
    let (width, height) = (view.depth_z.width, view.depth_z.height);
    let rows: Vec<(Vec<[f32; 3]>, Vec<f32>)> = (0..height)
        .into_par_iter()
        .map(|y| {
            let (mut points, mut sigmas) = (Vec::with_capacity(width), Vec::with_capacity(width));
            for (x, depth_z) in view.depth_z.row(y).iter().enumerate() {
                let ray = camera
                    .ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y)))
                    .filter(|_| depth_z.is_finite());
                let Some(ray) = ray else {
                    points.push([f32::NAN; 3]);
                    sigmas.push(f32::NAN);
                    continue;
                };
                let point = carry(ray * f64::from(*depth_z));
                points.push([point.x as f32, point.y as f32, point.z as f32]);
                // Along the ray: depth_z is its z only.
                sigmas.push((f64::from(view.sigma_z[(x, y)]) * ray.norm()) as f32);
            }
            (points, sigmas)
        })
        .collect();
    let (points, sigmas): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    PredictedView {
        points: Raster { width, height, data: points.concat() },
        confidence: view.confidence.clone(),
        sigma: Some(Raster { width, height, data: sigmas.concat() }),
        fill: view.fill.clone(),
    }
}
