//! Poses that are not what they should be: no rotation, the inverse, other axes.

use super::reprojection::{DepthView, depth_z_from_range, symmetric};
use crate::stored::{RawView, nearest_rotation};
use selenograph_geometry::{
    Body, BodyFixed, Cam, Camera, Matrix3, Point3, Rigid3, Rotation3, Vector3, pixel,
};
use selenograph_raster::{Raster, statistics};

/// Another reading of a stored pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// Camera to world, X right, Y down, Z forward: as it should be.
    AsTold,
    /// Camera to world, X right, Y up, Z backward.
    OpenGl,
    /// Camera to world, turned by half about the optical axis.
    UpsideDown,
    /// Camera to world, looking backward.
    Backward,
    /// World to camera.
    Inverse,
    /// World to camera with Y up, Z backward.
    InverseOpenGl,
}

impl Reading {
    /// All of them, the right one first.
    pub const ALL: [Self; 6] =
        [Self::AsTold, Self::OpenGl, Self::UpsideDown, Self::Backward, Self::Inverse, Self::InverseOpenGl];

    /// What it means, for messages.
    pub fn text(self) -> &'static str {
        match self {
            Self::AsTold => "camera to world with X right, Y down, Z forward",
            Self::OpenGl => "camera to world with OpenGL axes (Y up, Z backward)",
            Self::UpsideDown => "camera to world with X and Y turned round",
            Self::Backward => "camera to world with X and Z turned round",
            Self::Inverse => "world to camera",
            Self::InverseOpenGl => "world to camera with OpenGL axes (Y up, Z backward)",
        }
    }

    /// The pose that is meant if the stored one is read this way.
    pub fn pose(self, stored: &Rigid3<BodyFixed, Cam>) -> Rigid3<BodyFixed, Cam> {
        let turn = |x: f64, y: f64, z: f64| {
            let axes = Matrix3::from_diagonal(&Vector3::new(x, y, z));
            Rigid3::<Cam, Cam>::new(Rotation3::from_matrix_unchecked(axes), Point3::origin())
        };
        let inverse = || stored.inverse().relabel();
        match self {
            Self::AsTold => *stored,
            Self::OpenGl => stored * &turn(1.0, -1.0, -1.0),
            Self::UpsideDown => stored * &turn(-1.0, -1.0, 1.0),
            Self::Backward => stored * &turn(-1.0, 1.0, -1.0),
            Self::Inverse => inverse(),
            Self::InverseOpenGl => &inverse() * &turn(1.0, -1.0, -1.0),
        }
    }
}

/// What is wrong with a 4×4 matrix as a rigid motion, if anything; float32 noise is none.
pub fn fault(raw: &RawView) -> Option<String> {
    let m = &raw.world_from_cam;
    if m.iter().any(|entry| !entry.is_finite()) {
        return Some("it has entries that are not finite".to_owned());
    }
    if (m.row(3) - selenograph_geometry::RowVector4::new(0.0, 0.0, 0.0, 1.0)).amax() > 1e-9 {
        return Some(format!("its last row is {:?}, expected 0 0 0 1", m.row(3).iter().collect::<Vec<_>>()));
    }
    raw.world_from_cam().err().map(|error| error.to_string())
}

/// The rotation nearest to a stored one that is not quite one; `None` if it is far off or mirrored.
pub fn nearest(raw: &RawView) -> Option<Rigid3<BodyFixed, Cam>> {
    let stored = raw.world_from_cam.fixed_view::<3, 3>(0, 0).into_owned();
    let rotation = nearest_rotation(&stored)?;
    let origin = Point3::from(raw.world_from_cam.fixed_view::<3, 1>(0, 3).into_owned());
    let near = (rotation.matrix() - stored).amax() < 0.2 && origin.iter().all(|c| c.is_finite());
    near.then(|| Rigid3::new(rotation, origin))
}

/// How depth may have been stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthReading {
    /// Along the optical axis.
    DepthZ,
    /// Along the ray.
    Range,
}

/// The reading under which two views agree best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BestReading {
    /// Of A's and B's pose.
    pub poses: [Reading; 2],
    /// Of both depths.
    pub depth_reading: DepthReading,
    /// Median relative depth difference with it.
    pub median_relative_error: f64,
    /// The same with everything as told; `None` where the views then share nothing.
    pub as_told: Option<f64>,
}

/// Ground farther than this share of the radius from the sphere is none: relief of the Moon is 0.6 %.
const MAX_RELIEF: f64 = 0.012;

/// Another reading must be this many times better than the one told.
const CLEARLY_BETTER: f64 = 4.0;

/// Pixels across and down that are tried; enough for a median.
const GRID: usize = 24;

/// A camera, its stored pose, and its stored depth.
#[derive(Debug, Clone, Copy)]
pub struct Stored<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The pose as stored.
    pub pose: &'a Rigid3<BodyFixed, Cam>,
    /// The depth as stored.
    pub depth_values: &'a Raster<f32>,
}

/// Whether the ground of a view lies near the body's sphere.
fn sees_the_body(camera: &Camera, pose: &Rigid3<BodyFixed, Cam>, depth_z: &Raster<f32>, body: &Body) -> bool {
    let step = (camera.width / GRID).max(1);
    let view = DepthView { camera, world_from_cam: pose, depth_z };
    let rows = (step / 2..camera.height).step_by(step);
    let heights = rows.flat_map(|y| (step / 2..camera.width).step_by(step).map(move |x| (x, y))).filter_map(
        |(x, y)| {
            let center = [pixel::center_of(x), pixel::center_of(y)].into();
            let point = camera.unproject(&center, view.depth_at(x, y)?)?;
            Some(body.height_m(&pose.point(&point)).abs())
        },
    );
    statistics::median(heights).is_some_and(|height| height < MAX_RELIEF * body.radius_m)
}

/// Tries every reading of both poses and of depth. `None` if the views agree under none of them.
pub fn best_reading(a: &Stored, b: &Stored, body: &Body) -> Option<BestReading> {
    let step = (a.camera.width.min(b.camera.width) / GRID).max(1);
    let mut best: Option<BestReading> = None;
    let mut as_told = None;
    for depth_reading in [DepthReading::DepthZ, DepthReading::Range] {
        let depths = [a, b].map(|view| match depth_reading {
            DepthReading::DepthZ => view.depth_values.clone(),
            DepthReading::Range => depth_z_from_range(view.camera, view.depth_values),
        });
        let candidates = [(a, &depths[0]), (b, &depths[1])].map(|(view, depth_z)| {
            let poses = Reading::ALL.map(|reading| (reading, reading.pose(view.pose)));
            poses
                .into_iter()
                .filter(|(_, pose)| sees_the_body(view.camera, pose, depth_z, body))
                .collect::<Vec<_>>()
        });
        for (reading_a, pose_a) in &candidates[0] {
            for (reading_b, pose_b) in &candidates[1] {
                let view_a = DepthView { camera: a.camera, world_from_cam: pose_a, depth_z: &depths[0] };
                let view_b = DepthView { camera: b.camera, world_from_cam: pose_b, depth_z: &depths[1] };
                let Some(statistics) = symmetric(&view_a, &view_b, step) else { continue };
                // A handful of pixels that happen to meet prove nothing.
                if statistics.num_compared < GRID {
                    continue;
                }
                let error = statistics.median_relative_error;
                let told =
                    depth_reading == DepthReading::DepthZ && [*reading_a, *reading_b] == [Reading::AsTold; 2];
                if told {
                    as_told = Some(error);
                }
                if best.is_none_or(|best| error < best.median_relative_error) {
                    let poses = [*reading_a, *reading_b];
                    best = Some(BestReading {
                        poses,
                        depth_reading,
                        median_relative_error: error,
                        as_told: None,
                    });
                }
            }
        }
    }
    best.map(|best| BestReading { as_told, ..best })
}

impl BestReading {
    /// Whether another reading than the one told is clearly the right one.
    pub fn is_another(&self) -> bool {
        let told = self.depth_reading == DepthReading::DepthZ && self.poses == [Reading::AsTold; 2];
        // Without a shared reading as told, the other one has to be good by itself.
        !told
            && self.as_told.map_or(self.median_relative_error < 1e-3, |as_told| {
                as_told > CLEARLY_BETTER * self.median_relative_error
            })
    }
}

/// The reading of a single view's pose under which it sees the body, if it does not as told.
pub fn lonely_reading(view: &Stored, body: &Body) -> Option<Reading> {
    let sees =
        |reading: Reading| sees_the_body(view.camera, &reading.pose(view.pose), view.depth_values, body);
    if sees(Reading::AsTold) { None } else { Reading::ALL.into_iter().find(|reading| sees(*reading)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::oblique_pair;

    #[test]
    fn each_wrong_reading_is_recognised() {
        let [a, b] = oblique_pair(96);
        let body = Body::moon();
        for stored_as in [Reading::OpenGl, Reading::UpsideDown, Reading::Backward, Reading::Inverse] {
            // Each of these undoes itself, so storing with it and reading with it meet.
            let wrong = stored_as.pose(&b.world_from_cam);
            let stored_a = Stored { camera: &a.camera, pose: &a.world_from_cam, depth_values: &a.depth_z };
            let stored_b = Stored { camera: &b.camera, pose: &wrong, depth_values: &b.depth_z };
            let best = best_reading(&stored_a, &stored_b, &body).unwrap();
            assert!(best.is_another(), "{best:?}");
            assert_eq!(best.poses, [Reading::AsTold, stored_as]);
            assert_eq!(best.depth_reading, DepthReading::DepthZ);
        }
    }

    #[test]
    fn range_is_recognised_and_truth_left_alone() {
        let [a, b] = oblique_pair(96);
        let ranges = [a.range(), b.range()];
        let stored = |depths: [&Raster<f32>; 2]| {
            best_reading(
                &Stored { camera: &a.camera, pose: &a.world_from_cam, depth_values: depths[0] },
                &Stored { camera: &b.camera, pose: &b.world_from_cam, depth_values: depths[1] },
                &Body::moon(),
            )
            .unwrap()
        };
        let best = stored([&ranges[0], &ranges[1]]);
        assert!(best.is_another() && best.depth_reading == DepthReading::Range, "{best:?}");
        assert!(!stored([&a.depth_z, &b.depth_z]).is_another());
    }
}
