//! `camera.json`: one view.

use super::json::RECORD_VERSION;
use super::name::ViewName;
use crate::Error;
use selenograph_geometry::{
    Body, BodyFixed, Cam, Camera, Distortion, Geodetic, Matrix3, PixelConvention, Point3, Rigid3, Vector3,
};
use selenograph_raster::statistics;
use serde::{Deserialize, Serialize};

/// The sensor of a view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorRecord {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Width of the sensitive area, millimetres.
    pub width_mm: f64,
    /// Height of the sensitive area, millimetres.
    pub height_mm: f64,
    /// Focal length over the width, millimetres.
    pub focal_mm: f64,
}

/// A place on the body, in the units of files.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceRecord {
    /// Planetocentric latitude, degrees.
    pub latitude_deg: f64,
    /// East longitude, degrees in `[0, 360)`.
    pub longitude_deg: f64,
    /// Height above the reference sphere, metres.
    pub height_m: f64,
}

impl PlaceRecord {
    /// From the place that the code computes with.
    pub fn from_place(place: &Geodetic) -> Self {
        Self {
            latitude_deg: place.lat_rad.to_degrees(),
            longitude_deg: selenograph_geometry::units::wrap_360_deg(place.lon_rad.to_degrees()),
            height_m: place.height_m,
        }
    }

    /// The place that the code computes with.
    pub fn place(&self) -> Geodetic {
        Geodetic::from_deg(self.latitude_deg, self.longitude_deg, self.height_m)
    }
}

/// A unit quaternion, scalar part first and named.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuaternionRecord {
    /// Scalar part, ≥ 0.
    pub qw: f64,
    /// First vector component.
    pub qx: f64,
    /// Second vector component.
    pub qy: f64,
    /// Third vector component.
    pub qz: f64,
}

/// `a.camera.json`, `b.camera.json`: one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRecord {
    /// Always `selenograph.camera`.
    pub format: String,
    /// [`RECORD_VERSION`].
    pub version: u32,
    /// Which view.
    pub view: ViewName,
    /// Camera matrix, rows first, pixels.
    pub k: [[f64; 3]; 3],
    /// Where the first pixel's centre is: `corner` = (0.5, 0.5), `center` = (0, 0).
    pub k_pixel_convention: PixelConvention,
    /// Size in pixels and millimetres.
    pub sensor: SensorRecord,
    /// Brown's lens distortion.
    pub distortion: Distortion,
    /// Name of the world frame, for example `moon_me` (body-fixed, metres).
    pub world: String,
    /// `[R | t]`, rows first: `x_in_world = R x_in_cam + t`; camera axes X right, Y down, Z forward; metres.
    pub world_from_cam: [[f64; 4]; 3],
    /// The camera's position in the world, metres (the last column of `world_from_cam`).
    pub position_m: [f64; 3],
    /// The rotation of `world_from_cam`.
    pub world_from_cam_quaternion: QuaternionRecord,
    /// Sub-camera latitude, degrees.
    pub latitude_deg: f64,
    /// Sub-camera east longitude, degrees in `[0, 360)`.
    pub longitude_deg: f64,
    /// Height of the camera above the reference sphere, metres.
    pub altitude_above_sphere_m: f64,
    /// Height of the camera above the terrain straight below it; absent where the terrain is.
    pub altitude_over_terrain_m: Option<f64>,
    /// Angle between the optical axis and the local vertical (downwards) at the camera, degrees.
    pub tilt_deg: f64,
    /// Median over the valid pixels of `depth_z / f`, metres per pixel; absent where no pixel is valid.
    pub gsd_m: Option<f64>,
    /// Share of pixels with valid depth, `[0, 1]`.
    pub valid_share: f64,
}

/// The name in [`CameraRecord::format`].
pub const CAMERA_FORMAT: &str = "selenograph.camera";

/// What a [`CameraRecord`] holds beyond camera and pose, measured from the truth maps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ViewMeasures {
    /// See [`CameraRecord::altitude_over_terrain_m`].
    pub altitude_over_terrain_m: Option<f64>,
    /// See [`CameraRecord::gsd_m`].
    pub gsd_m: Option<f64>,
    /// See [`CameraRecord::valid_share`].
    pub valid_share: f64,
}

impl ViewMeasures {
    /// What the depth of a view's pixels tells: metres, NaN where absent.
    pub fn of_depth(depths: impl Iterator<Item = f64>, camera: &Camera) -> Self {
        let valid: Vec<f64> = depths.filter(|depth_z| depth_z.is_finite()).collect();
        Self {
            altitude_over_terrain_m: None,
            valid_share: valid.len() as f64 / (camera.width * camera.height).max(1) as f64,
            gsd_m: statistics::median(valid).map(|depth_z| camera.gsd_m(depth_z)),
        }
    }
}

impl CameraRecord {
    /// The record of a view. `pixel_pitch_mm` turns pixels into millimetres on the sensor.
    pub fn new(
        view: ViewName,
        body: &Body,
        camera: &Camera,
        world_from_cam: &Rigid3<BodyFixed, Cam>,
        pixel_pitch_mm: f64,
        measures: ViewMeasures,
    ) -> Self {
        let position = world_from_cam.origin();
        let place = body.place(&position);
        let [qw, qx, qy, qz] = world_from_cam.quaternion_wxyz();
        let k = camera.k(PixelConvention::Corner);
        let place_record = PlaceRecord::from_place(&place);
        Self {
            format: CAMERA_FORMAT.into(),
            version: RECORD_VERSION,
            view,
            k: std::array::from_fn(|i| std::array::from_fn(|j| k[(i, j)])),
            k_pixel_convention: PixelConvention::Corner,
            sensor: SensorRecord {
                width_px: camera.width,
                height_px: camera.height,
                width_mm: camera.width as f64 * pixel_pitch_mm,
                height_mm: camera.height as f64 * pixel_pitch_mm,
                focal_mm: camera.fx * pixel_pitch_mm,
            },
            distortion: camera.distortion,
            world: body.frame.clone(),
            world_from_cam: world_from_cam.rows_3x4(),
            position_m: position.coords.into(),
            world_from_cam_quaternion: QuaternionRecord { qw, qx, qy, qz },
            latitude_deg: place_record.latitude_deg,
            longitude_deg: place_record.longitude_deg,
            altitude_above_sphere_m: place.height_m,
            altitude_over_terrain_m: measures.altitude_over_terrain_m,
            tilt_deg: tilt_rad(world_from_cam).to_degrees(),
            gsd_m: measures.gsd_m,
            valid_share: measures.valid_share,
        }
    }

    /// The camera, measured from the corner whatever the record's convention.
    ///
    /// # Errors
    /// [`Error::Geometry`] for a matrix that no camera has.
    pub fn camera(&self) -> Result<Camera, Error> {
        let k = Matrix3::from_fn(|i, j| self.k[i][j]);
        let camera =
            Camera::from_k(self.sensor.width_px, self.sensor.height_px, &k, self.k_pixel_convention)?;
        Ok(camera.with_distortion(self.distortion))
    }

    /// The pose, from the quaternion and the position.
    pub fn world_from_cam(&self) -> Rigid3<BodyFixed, Cam> {
        let QuaternionRecord { qw, qx, qy, qz } = self.world_from_cam_quaternion;
        Rigid3::from_quaternion(qw, qx, qy, qz, Point3::from(self.position_m))
    }
}

/// Angle between the optical axis and straight down at the camera, radians.
pub fn tilt_rad(world_from_cam: &Rigid3<BodyFixed, Cam>) -> f64 {
    let down = -world_from_cam.origin().coords;
    world_from_cam.vector(&Vector3::z()).angle(&down)
}
