//! A camera somewhere in the world.

use crate::Error;
use selenograph_geometry::{BodyFixed, Cam, Camera, Point2, Point3, Rigid3, Vector3, pixel};
use selenograph_terrain::Terrain;

/// A camera and where it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Viewpoint {
    /// Intrinsics.
    pub camera: Camera,
    /// Pose.
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
}

impl Viewpoint {
    /// Centre of projection in the body-fixed frame, metres.
    pub fn origin(&self) -> Point3<f64> {
        self.world_from_cam.origin()
    }

    /// Direction through the centre of pixel `(x, y)`, scaled so that its length along the optical axis is 1: a point on it
    /// is `origin + depth_z · direction`. `None` outside the lens model.
    pub fn direction(&self, x: usize, y: usize) -> Option<Vector3<f64>> {
        let centre = Point2::new(pixel::center_of(x), pixel::center_of(y));
        Some(self.world_from_cam.vector(&self.camera.ray_z1(&centre)?))
    }

    /// Body-fixed point → pixel; `None` behind the camera.
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.camera.project(&self.world_from_cam.inverse().point(point))
    }

    /// Refuses a camera inside the ground.
    ///
    /// # Errors
    /// [`Error::CameraBelowGround`].
    pub(crate) fn check_above_ground(&self, terrain: &Terrain) -> Result<(), Error> {
        let origin = self.origin();
        let place = terrain.body.place(&origin);
        // Outside every layer only the sphere's lowest height is known.
        let ground_m = terrain.sample(&origin).map_or(terrain.height_range().0, |s| s.height_m);
        if place.height_m > ground_m {
            return Ok(());
        }
        Err(Error::CameraBelowGround {
            below_m: ground_m - place.height_m,
            lat_deg: place.lat_rad.to_degrees(),
            lon_deg: place.lon_rad.to_degrees(),
        })
    }
}
