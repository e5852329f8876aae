//! Cameras, poses and points as other programs take them: COLMAP's model and nerfstudio's `transforms.json`.

pub mod colmap;
pub mod nerfstudio;

use crate::View;
use crate::relative_pose::JudgedMatch;
use selenograph_geometry::{BodyFixed, CamA, CamB, Camera, Point2, Point3, PredA, Rigid3, Sim3};
use selenograph_pose::decompose::Motion;
use selenograph_pose::triangulate::optimal;

/// A picture with its camera and place.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneView {
    /// Its file, below the folder of the pictures; parts are separated by `/`.
    pub name: String,
    /// The camera, measured from the corner.
    pub camera: Camera,
    /// Where it was, in the scene's own world.
    pub world_from_cam: Rigid3<BodyFixed, selenograph_geometry::Cam>,
}

/// A point that several pictures show.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePoint {
    /// In the scene's own world.
    pub place: Point3<f64>,
    /// Its grey level.
    pub grey: u8,
    /// Mean distance of its images from where they were seen, pixels.
    pub error_px: f64,
    /// The views that show it, by their position in the scene, and where in them.
    pub track: Vec<(usize, Point2<f64>)>,
}

/// Pictures and points in one world.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// The pictures.
    pub views: Vec<SceneView>,
    /// The points.
    pub points: Vec<ScenePoint>,
}

impl Scene {
    /// Two views and their matches that agree with the pose, triangulated. The world is that of `pointmaps.npz`: the axes of camera
    /// A, in the unit of the scale.
    pub fn of_pair(
        names: [String; 2],
        views: [&View; 2],
        cam_b_from_cam_a: &Rigid3<CamB, CamA>,
        scale: &Sim3<CamA, PredA>,
        matches: &[JudgedMatch],
    ) -> Self {
        let scale = scale.scale();
        let [w, x, y, z] = cam_b_from_cam_a.quaternion_wxyz();
        let b_from_a: Rigid3<CamB, CamA> =
            Rigid3::from_quaternion(w, x, y, z, cam_b_from_cam_a.origin() * scale);
        let poses = [Rigid3::identity(), b_from_a.inverse().relabel()];
        let cameras = [&views[0].camera, &views[1].camera];
        let inliers = matches.iter().filter(|m| m.inlier);
        let points = inliers.filter_map(|m| point(m, cameras, &b_from_a, &views[0].image)).collect();
        let views = names.into_iter().zip(cameras).zip(poses);
        let views = views.map(|((name, camera), world_from_cam)| SceneView {
            name,
            camera: camera.clone(),
            world_from_cam,
        });
        Self { views: views.collect(), points }
    }
}

/// Where a match's rays meet; `None` if they do not, in front of both cameras.
fn point(
    m: &JudgedMatch,
    cameras: [&Camera; 2],
    b_from_a: &Rigid3<CamB, CamA>,
    image: &selenograph_raster::Raster<f32>,
) -> Option<ScenePoint> {
    let motion = Motion { rotation: b_from_a.rotation(), translation: b_from_a.origin().coords };
    let place = optimal(&motion, &cameras[0].ray_z1(&m.a)?, &cameras[1].ray_z1(&m.b)?)?.x_in_a;
    let seen = [cameras[0].project(&place)?, cameras[1].project(&b_from_a.point(&place))?];
    let error_px = 0.5 * ((seen[0] - m.a).norm() + (seen[1] - m.b).norm());
    let index = |v: f64, size: usize| (v.max(0.0) as usize).min(size - 1);
    let level = image[(index(m.a.x, image.width), index(m.a.y, image.height))];
    let level = if level.is_nan() { 0.5 } else { level.clamp(0.0, 1.0) };
    let grey = (level * 255.0).round() as u8;
    Some(ScenePoint { place, grey, error_px, track: vec![(0, m.a), (1, m.b)] })
}

#[cfg(test)]
mod tests;
