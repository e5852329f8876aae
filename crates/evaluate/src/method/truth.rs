//! The truth as an answer.

use crate::truth::{TruthPair, TruthView};
use selenograph_geometry::{Cam, CamA, Point3, Rigid3};
use selenograph_raster::Raster;
use selenograph_reconstruct::{Fill, PredictedView, Prediction};

/// What a perfect method would say, in metres.
pub fn prediction(truth: &TruthPair) -> Prediction {
    let cam_b_from_cam_a = truth.cam_b_from_cam_a();
    let poses = [Rigid3::identity(), cam_b_from_cam_a.inverse().relabel()];
    let views = [0, 1].map(|k| {
        let view: &TruthView = &truth.views[k];
        known_everywhere(&view.points_in_cam(), &poses[k])
    });
    Prediction { cam_b_from_cam_a: Ok(cam_b_from_cam_a), views: Some(views) }
}

/// Points of a view, all measured and certain, carried into camera A.
pub fn known_everywhere(
    points_in_cam: &Raster<Point3<f64>>,
    cam_a_from_cam: &Rigid3<CamA, Cam>,
) -> PredictedView {
    let points = points_in_cam.map(|point| {
        let point = cam_a_from_cam.point(point);
        [point.x as f32, point.y as f32, point.z as f32]
    });
    let present = |point: &[f32; 3]| point.iter().all(|x| x.is_finite());
    PredictedView {
        confidence: points.map(|point| f32::from(u8::from(present(point)))),
        fill: points.map(|point| if present(point) { Fill::Measured } else { Fill::Absent }),
        sigma: None,
        points,
    }
}
