//! What a trainer is fed: two views with their truth as plain arrays, and pixels that belong together.

pub use crate::view_truth::ViewTruth;

use crate::correspondence::Matches;
use crate::pair::ViewName;
use selenograph_geometry::{Cam, Camera, Point2, Rigid3, pixel};
use selenograph_raster::Raster;

/// One view of a training pair.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingView {
    /// The picture as a network is given it, before it is scaled to −1 … 1.
    pub rgb: Raster<[u8; 3]>,
    /// The camera of these pixels.
    pub camera: Camera,
    /// Depth and pose; depth is NaN throughout where only the pose is known.
    pub truth: ViewTruth,
}

/// Where a sample comes from: enough to make it again.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Provenance {
    /// Name of the source.
    pub source: String,
    /// Number of the pair in its source.
    pub pair_id: u64,
    /// Number of the sample since the start of training; with the seed it decides everything random.
    pub position: u64,
    /// Which light each view was taken under.
    pub lights: [usize; 2],
}

/// Two views of the same ground, ready to learn from.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingPair {
    /// A and B, of the same size.
    pub views: [TrainingView; 2],
    /// Pixels of A and of B that see the same ground, and some that do not; empty without truth.
    pub matches: Matches,
    /// Whether a network is asked for metres; otherwise its scale is free.
    pub is_metric: bool,
    /// Where the pair comes from.
    pub provenance: Provenance,
}

impl TrainingPair {
    /// A view.
    pub fn view(&self, name: ViewName) -> &TrainingView {
        &self.views[name as usize]
    }

    /// Whether depth and pose of both views are known.
    pub fn has_truth(&self) -> bool {
        self.views.iter().all(|view| view.truth.has_depth())
    }

    /// The ground that each pixel of `of` sees, in the camera frame of `in_frame`, metres; rows first. NaN where the
    /// depth is not known and where the pixel sees sky.
    ///
    /// The world drops out in f64 first, so that its large coordinates cost no digits.
    pub fn points(&self, of: ViewName, in_frame: ViewName) -> Vec<[f32; 3]> {
        let (view, frame) = (self.view(of), self.view(in_frame));
        let truth = &view.truth;
        let motion: Rigid3<Cam, Cam> = &frame.truth.world_from_cam.inverse() * &truth.world_from_cam;
        let width = view.camera.width;
        let point = |idx: usize| {
            let center = Point2::new(pixel::center_of(idx % width), pixel::center_of(idx / width));
            let depth_z = f64::from(truth.depth_z.data[idx]);
            let in_cam = view.camera.unproject(&center, depth_z).filter(|_| truth.is_valid(idx));
            in_cam.map_or([f32::NAN; 3], |p| {
                // A frame's own points are exact: no rotation that would only round.
                let p = if of == in_frame { p } else { motion.point(&p) };
                [p.x as f32, p.y as f32, p.z as f32]
            })
        };
        (0..truth.depth_z.data.len()).map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::oblique_pair;

    fn training_pair(side: usize) -> TrainingPair {
        let views = oblique_pair(side).map(|view| TrainingView {
            rgb: Raster::filled(side, side, [0; 3]),
            camera: view.camera,
            truth: ViewTruth { depth_z: view.depth_z, world_from_cam: view.world_from_cam },
        });
        TrainingPair {
            views,
            matches: Matches::default(),
            is_metric: true,
            provenance: Provenance::default(),
        }
    }

    #[test]
    fn points_of_either_view_lie_on_one_ground() {
        let mut pair = training_pair(48);
        let own = pair.points(ViewName::B, ViewName::B);
        let in_a = pair.points(ViewName::B, ViewName::A);
        let world = pair.view(ViewName::B).truth.world_from_cam;
        let into_a = pair.view(ViewName::A).truth.world_from_cam.inverse();
        for (own, in_a) in own.iter().zip(&in_a) {
            let expected = into_a.point(&world.point(&own.map(f64::from).into()));
            let error = (expected.coords - selenograph_geometry::Vector3::from(in_a.map(f64::from))).norm();
            // Single precision at 30 km.
            assert!(error < 0.01, "{error}");
        }
        let truth = &mut pair.views[0].truth;
        (truth.depth_z.data[5], truth.depth_z.data[6]) = (f32::INFINITY, f32::NAN);
        assert!(truth.is_sky(5) && !truth.is_valid(5) && !truth.is_valid(6) && truth.is_valid(7));
        let points = pair.points(ViewName::A, ViewName::B);
        assert!(points[5][0].is_nan() && points[6][2].is_nan() && points[7][1].is_finite());
        pair.views[1].truth.depth_z.data.fill(f32::NAN);
        assert!(!pair.has_truth());
        assert!(pair.points(ViewName::B, ViewName::A).iter().all(|point| point[0].is_nan()));
    }
}
