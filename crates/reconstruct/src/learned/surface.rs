//! Pointmaps as predicted views, and how sure dense matches are.

use super::arrays::Pointmap;
use crate::relative_pose::JudgedMatch;
use crate::{Fill, PredictedView};
use selenograph_geometry::{CamA, CamB, Camera, Point3, Rigid3};
use selenograph_raster::Raster;

/// Pointmaps times `scale`. Points that the other view does not see were not measured from both pictures: they count as
/// completed. Without a pose nothing tells which those are.
pub(super) fn views(
    maps: &[Pointmap; 2],
    scale: f64,
    cam_b_from_cam_a: Option<&Rigid3<CamB, CamA>>,
    cameras: [&Camera; 2],
) -> [PredictedView; 2] {
    [0, 1].map(|k| {
        let points = maps[k].points.map(|point| point.map(|x| (f64::from(x) * scale) as f32));
        let other = cameras[1 - k];
        let fill = points.map(|point| {
            let x_in_a = Point3::from(point.map(f64::from));
            let x_in_other = match cam_b_from_cam_a {
                Some(pose) if k == 0 => pose.point(&x_in_a),
                _ => x_in_a,
            };
            if !x_in_a.iter().all(|x| x.is_finite()) {
                Fill::Absent
            } else if cam_b_from_cam_a.is_none() || is_seen(other, &x_in_other) {
                Fill::Measured
            } else {
                Fill::Completed
            }
        });
        let present = fill.data.iter().zip(&maps[k].confidence.data);
        let confidence =
            present.map(|(fill, c)| if *fill == Fill::Absent { 0.0 } else { c.clamp(0.0, 1.0) }).collect();
        let confidence = Raster { width: points.width, height: points.height, data: confidence };
        PredictedView { points, confidence, sigma: None, fill }
    })
}

fn is_seen(camera: &Camera, x_in_cam: &Point3<f64>) -> bool {
    camera.project(x_in_cam).is_some_and(|at| {
        (0.0..camera.width as f64).contains(&at.x) && (0.0..camera.height as f64).contains(&at.y)
    })
}

/// Standard deviation of a match along its epipolar line, pixels: as large as across it, where the pose says what is off, and
/// not below what whole pixels can tell.
pub(super) fn sigma_px(matches: &[JudgedMatch], match_px: f64) -> f64 {
    let (sum, count) = matches
        .iter()
        .filter(|m| m.inlier)
        .fold((0.0, 0.0), |(sum, count), m| (sum + m.residual_px * m.residual_px, count + 1.0));
    // A Sampson distance shares the noise of a shift between both pictures.
    let shift_px = (2.0 * sum / f64::max(count, 1.0)).sqrt();
    // A uniform distribution over one pixel.
    shift_px.max(match_px / 12f64.sqrt())
}
