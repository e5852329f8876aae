//! What a trainer is fed: two views with their truth as plain arrays, and pixels that belong together.

use crate::correspondence::Matches;
use crate::pair::ViewName;
use nalgebra::Point2;
use selenograph_geometry::{BodyFixed, Cam, Camera, Rigid3, pixel};
use selenograph_raster::Raster;

/// Neighbouring pixels whose depths differ by more than this many pixels' ground are not of one surface.
const JUMP_GSDS: f64 = 20.0;

/// What is true of a view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewTruth {
    /// Distance along the optical axis, metres: NaN where it is not known, +∞ where the pixel sees sky.
    pub depth_z: Raster<f32>,
    /// The pose, metres.
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
}

impl ViewTruth {
    /// Whether any pixel sees ground at a known distance.
    pub fn has_depth(&self) -> bool {
        (0..self.depth_z.data.len()).any(|idx| self.is_valid(idx))
    }

    /// Whether a pixel sees ground at a known distance.
    pub fn is_valid(&self, idx: usize) -> bool {
        let depth_z = self.depth_z.data[idx];
        depth_z > 0.0 && depth_z.is_finite()
    }

    /// Whether a pixel sees sky.
    pub fn is_sky(&self, idx: usize) -> bool {
        self.depth_z.data[idx] == f32::INFINITY
    }

    /// Depth at a place of the picture, metres: within one surface inverse depths are interpolated (they are linear across a
    /// plane), at its rim the pixel's own is taken. `None` outside the picture and where that pixel has none.
    pub fn depth_z_at(&self, camera: &Camera, at: &Point2<f64>) -> Option<f64> {
        let column = usize::try_from(pixel::index_of(at.x)).ok()?;
        let row = usize::try_from(pixel::index_of(at.y)).ok()?;
        let own =
            self.depth_z.get(column, row).map(|z| f64::from(*z)).filter(|z| *z > 0.0 && z.is_finite())?;
        Some(self.between(camera, at).unwrap_or(own))
    }

    /// Depth between the four pixels round a place; `None` beside absent pixels and jumps.
    fn between(&self, camera: &Camera, at: &Point2<f64>) -> Option<f64> {
        let split = |value: f64, side: usize| {
            // The outer half of a border pixel goes on as its inner half began.
            let position = pixel::sample_position(value);
            let first = (position.max(0.0) as usize).min(side.saturating_sub(2));
            (first, position - first as f64)
        };
        let ((x, tx), (y, ty)) = (split(at.x, self.depth_z.width), split(at.y, self.depth_z.height));
        let z = |dx: usize, dy: usize| self.depth_z.get(x + dx, y + dy).map(|z| f64::from(*z));
        let corners = [z(0, 0)?, z(1, 0)?, z(0, 1)?, z(1, 1)?];
        if corners.iter().any(|z| !(*z > 0.0 && z.is_finite())) {
            return None;
        }
        let (near, far) = corners.iter().fold((f64::INFINITY, 0.0f64), |(a, b), z| (a.min(*z), b.max(*z)));
        if far - near > JUMP_GSDS * camera.gsd_m(near) {
            return None;
        }
        let weights = [(1.0 - tx) * (1.0 - ty), tx * (1.0 - ty), (1.0 - tx) * ty, tx * ty];
        Some(1.0 / corners.iter().zip(weights).map(|(z, weight)| weight / z).sum::<f64>())
    }
}

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
            let error = (expected.coords - nalgebra::Vector3::from(in_a.map(f64::from))).norm();
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
