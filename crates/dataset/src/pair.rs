//! The records beside the pixels: `camera.json` of a view, `pair.json` of a pair, and where their files lie.

use crate::Error;
use crate::import::dataset::SourceRecord;
use nalgebra::{Matrix3, Point3, Vector3};
use selenograph_geometry::{Body, BodyFixed, Cam, Camera, Distortion, Geodetic, PixelConvention, Rigid3};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

/// Version of the two records; a reader refuses a newer one.
pub const RECORD_VERSION: u32 = 1;

/// Which view of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ViewName {
    /// The first.
    A,
    /// The second.
    B,
}

impl ViewName {
    /// Both, in order.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];

    /// `a` or `b`, as file names begin.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::A => "a",
            Self::B => "b",
        }
    }
}

/// How a pair was flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trajectory {
    /// Both cameras look down from one altitude.
    Nadir,
    /// Level horizon, tilted from the vertical.
    Oblique,
    /// Independent altitude, offset, tilt and roll of the two cameras.
    Dynamic,
    /// One above the other: the epipole lies inside the picture.
    Descent,
    /// Hard case: low light on flat ground.
    LowLight,
    /// Hard case: the two views share no ground.
    NoOverlap,
    /// Hard case: the two views are the same.
    Identical,
}

impl Trajectory {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Nadir,
        Self::Oblique,
        Self::Dynamic,
        Self::Descent,
        Self::LowLight,
        Self::NoOverlap,
        Self::Identical,
    ];

    /// The name in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Nadir => "nadir",
            Self::Oblique => "oblique",
            Self::Dynamic => "dynamic",
            Self::Descent => "descent",
            Self::LowLight => "low-light",
            Self::NoOverlap => "no-overlap",
            Self::Identical => "identical",
        }
    }

    /// From the name in files.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.as_str() == name)
    }
}

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
/// The name in [`PairRecord::format`].
pub const PAIR_FORMAT: &str = "selenograph.pair";

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

/// One Sun of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SunRecord {
    /// Clockwise from north at the pair's site, degrees in `[0, 360)`.
    pub azimuth_deg: f64,
    /// Above the site's horizon, degrees; below 0 the picture is dark.
    pub elevation_deg: f64,
    /// Unit vector towards the Sun, in the world frame.
    pub direction: [f64; 3],
    /// Angular radius of the disc, degrees (0: a point).
    pub angular_radius_deg: f64,
}

/// How radiance became grey levels, one per image: `full_scale × clip(gain × radiance_factor + offset, 0, 1)`, rounded to
/// the nearest level with 16 bits and down with 8 bits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureRecord {
    /// Which Sun (index into [`PairRecord::suns`]).
    pub light_idx: usize,
    /// Which view.
    pub view: ViewName,
    /// `pair-gain` (both views alike) or `min-max` (each image by itself).
    pub tone: String,
    /// Full scales per unit of radiance factor (I/F).
    pub gain: f64,
    /// Share of full scale at no radiance.
    pub offset: f64,
    /// Bits per grey level.
    pub bits: u8,
    /// Share of pixels above full scale.
    pub saturated_share: f64,
    /// Share of the valid pixels that the Sun's centre lights.
    pub lit_share: f64,
}

/// How much of one view the other one sees: shares of the view's pixels, `[0, 1]`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OverlapRecord {
    /// Pixels of A whose ground lies inside B's frame (occlusion left aside).
    pub a_in_b: f64,
    /// The same from B.
    pub b_in_a: f64,
    /// Pixels of A whose ground B really sees.
    pub a_seen_by_b: f64,
    /// The same from B.
    pub b_seen_by_a: f64,
}

/// `pair.json`: what two views have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PairRecord {
    /// Always `selenograph.pair`.
    pub format: String,
    /// [`RECORD_VERSION`].
    pub version: u32,
    /// Number in the plan.
    pub pair_id: u64,
    /// How it was flown; absent where the source of an imported pair does not tell.
    pub trajectory: Option<Trajectory>,
    /// The body; its `frame` names the world of every vector here.
    pub body: Body,
    /// The ground that the pair was aimed at; azimuths and elevations are told here.
    pub site: PlaceRecord,
    /// From A's centre of projection to B's, world axes, metres.
    pub baseline_vector_m: [f64; 3],
    /// Its length, metres.
    pub baseline_m: f64,
    /// Baseline over the mean of the two altitudes over the site's height.
    pub baseline_over_height: f64,
    /// Altitude of B over that of A, both over the site's height.
    pub altitude_ratio: f64,
    /// `[R | t]` of B's camera frame from A's, rows first, metres.
    pub cam_b_from_cam_a: [[f64; 4]; 3],
    /// Angle of that rotation, degrees.
    pub relative_rotation_deg: f64,
    /// Angle at the site between the directions to the two cameras, degrees.
    pub convergence_deg: f64,
    /// The lights, in file order; null where the source of an imported pair does not tell its Sun.
    pub suns: Vec<Option<SunRecord>>,
    /// One per image: lights in order, A before B. Empty for imported pairs.
    pub exposures: Vec<ExposureRecord>,
    /// Overlap both ways.
    pub overlap: OverlapRecord,
    /// Every file of the pair beside this one, with its BLAKE3 checksum (hex).
    pub files: std::collections::BTreeMap<String, String>,
    /// Where an imported pair comes from; absent for pairs that were rendered here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<SourceRecord>,
}

/// Baseline, rotation and angles of two poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeGeometry {
    /// From A to B, world axes, metres.
    pub baseline_vector_m: Vector3<f64>,
    /// Baseline over mean altitude over the site.
    pub baseline_over_height: f64,
    /// Altitude of B over that of A.
    pub altitude_ratio: f64,
    /// B's camera frame from A's.
    pub cam_b_from_cam_a: Rigid3<selenograph_geometry::CamB, selenograph_geometry::CamA>,
    /// Angle of the rotation, radians.
    pub relative_rotation_rad: f64,
    /// Angle at the site, radians.
    pub convergence_rad: f64,
}

impl RelativeGeometry {
    /// Of two poses over a site.
    pub fn new(
        body: &Body,
        site: &Geodetic,
        world_from_a: &Rigid3<BodyFixed, Cam>,
        world_from_b: &Rigid3<BodyFixed, Cam>,
    ) -> Self {
        let (a, b) = (world_from_a.origin(), world_from_b.origin());
        let ground = body.point(site);
        let altitude = |p: &Point3<f64>| body.height_m(p) - site.height_m;
        let baseline_vector_m = b - a;
        let cam_b_from_cam_a = (&world_from_b.inverse() * world_from_a).relabel();
        Self {
            baseline_vector_m,
            baseline_over_height: baseline_vector_m.norm() / (0.5 * (altitude(&a) + altitude(&b))),
            altitude_ratio: altitude(&b) / altitude(&a),
            cam_b_from_cam_a,
            relative_rotation_rad: cam_b_from_cam_a.rotation_angle_rad(),
            convergence_rad: (a - ground).angle(&(b - ground)),
        }
    }
}

/// Folder of a pair under a dataset's root: `pairs/<id / 1000>/<id>`.
pub fn pair_folder(root: &Path, pair_id: u64) -> PathBuf {
    root.join("pairs").join(format!("{:03}", pair_id / 1000)).join(format!("{pair_id:06}"))
}

/// `a.depth_z.exr`.
pub fn truth_name(view: ViewName) -> String {
    format!("{}.depth_z.exr", view.as_str())
}

/// `a.l0.png`.
pub fn image_name(view: ViewName, light_idx: usize) -> String {
    format!("{}.l{light_idx}.png", view.as_str())
}

/// `a.l0.lit.png`.
pub fn lit_name(view: ViewName, light_idx: usize) -> String {
    format!("{}.l{light_idx}.lit.png", view.as_str())
}

/// `a.in_b.exr`.
pub fn correspondence_name(view: ViewName) -> String {
    match view {
        ViewName::A => "a.in_b.exr".into(),
        ViewName::B => "b.in_a.exr".into(),
    }
}

/// `a.l0.angles.exr`.
pub fn angles_name(view: ViewName, light_idx: usize) -> String {
    format!("{}.l{light_idx}.angles.exr", view.as_str())
}

/// `a.camera.json`.
pub fn camera_name(view: ViewName) -> String {
    format!("{}.camera.json", view.as_str())
}

/// `pair.json`.
pub const PAIR_NAME: &str = "pair.json";

/// Numbers and folders of the complete pairs of a dataset, in order.
///
/// # Errors
/// [`Error::Io`] if a folder cannot be read. A dataset without a `pairs` folder has none.
pub fn list_pairs(root: &Path) -> Result<Vec<(u64, PathBuf)>, Error> {
    let top = root.join("pairs");
    let mut found = Vec::new();
    if !top.is_dir() {
        return Ok(found);
    }
    for group in std::fs::read_dir(&top).map_err(Error::io("read", &top))? {
        let group = group.map_err(Error::io("read", &top))?.path();
        if !group.is_dir() {
            continue;
        }
        for folder in std::fs::read_dir(&group).map_err(Error::io("read", &group))? {
            let folder = folder.map_err(Error::io("read", &group))?.path();
            // Temporary folders have names that are no numbers.
            let id = folder.file_name().and_then(|n| n.to_str()).and_then(|n| n.parse().ok());
            if let (Some(id), true) = (id, folder.is_dir()) {
                found.push((id, folder));
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Reads a JSON record.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if it is not the record asked for.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let text = std::fs::read_to_string(path).map_err(Error::io("read", path))?;
    serde_json::from_str(&text).map_err(|error| Error::Format {
        path: path.to_path_buf(),
        expected: "a JSON record of this version".into(),
        found: error.to_string(),
    })
}

/// Text of a JSON record, as it is written.
///
/// # Errors
/// [`Error::Format`] for a number that JSON cannot hold (NaN, infinity).
pub fn json_text<T: Serialize>(record: &T, path: &Path) -> Result<String, Error> {
    let text = serde_json::to_string_pretty(record).map_err(|error| Error::Format {
        path: path.to_path_buf(),
        expected: "finite numbers".into(),
        found: error.to_string(),
    })?;
    Ok(text + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::lookat;

    fn pose(lat: f64, lon: f64, altitude: f64) -> Rigid3<BodyFixed, Cam> {
        let moon = Body::moon();
        let place = Geodetic::from_deg(lat, lon, altitude);
        let up = moon.up(&place);
        lookat::from_forward_and_right(moon.point(&place), &-up, &Vector3::new(0.1, 0.9, 0.2)).unwrap()
    }

    #[test]
    fn camera_record_keeps_every_bit_of_the_pose() {
        let moon = Body::moon();
        let camera = Camera::from_fov(512, 512, 45f64.to_radians()).unwrap();
        let world_from_cam = pose(-88.3, 123.4, 9_500.0);
        let record =
            CameraRecord::new(ViewName::A, &moon, &camera, &world_from_cam, 0.01, ViewMeasures::default());
        let folder = std::env::temp_dir().join(format!("selenograph-camera-{}.json", std::process::id()));
        std::fs::write(&folder, json_text(&record, &folder).unwrap()).unwrap();
        let back: CameraRecord = read_json(&folder).unwrap();
        std::fs::remove_file(&folder).unwrap();
        assert_eq!(back, record);
        assert_eq!(back.camera().unwrap(), camera);
        let again = back.world_from_cam();
        assert_eq!(again.origin(), world_from_cam.origin());
        assert!((again.rotation() - world_from_cam.rotation()).amax() < 1e-15);
        assert!((record.altitude_above_sphere_m - 9_500.0).abs() < 1e-6);
        assert!(record.tilt_deg < 1e-6);
        assert_eq!(record.world, "moon_me");
        assert!((record.sensor.width_mm - 5.12).abs() < 1e-12);
    }

    #[test]
    fn relative_geometry_of_two_nadir_views() {
        let moon = Body::moon();
        let a = pose(-88.0, 10.0, 10_000.0);
        let b = pose(-88.0, 11.0, 10_000.0);
        let site = Geodetic::from_deg(-88.0, 10.0, 0.0);
        let relative = RelativeGeometry::new(&moon, &site, &a, &b);
        let length = (b.origin() - a.origin()).norm();
        assert!((relative.baseline_over_height - length / 10_000.0).abs() < 1e-9);
        assert!((relative.altitude_ratio - 1.0).abs() < 1e-9);
        // Seen from the ground, the baseline spans atan(B/H) less the curvature.
        assert!((relative.convergence_rad.tan() - length / 10_000.0).abs() < 1e-3);
        let x_in_a = Point3::new(3.0, 4.0, 100.0);
        let x_in_b = b.inverse().point(&a.point(&x_in_a));
        assert!((relative.cam_b_from_cam_a.point(&x_in_a) - x_in_b).norm() < 1e-8);
    }

    #[test]
    fn names_and_folders() {
        assert_eq!(pair_folder(Path::new("d"), 12_034), Path::new("d/pairs/012/012034"));
        assert_eq!(image_name(ViewName::B, 2), "b.l2.png");
        for trajectory in Trajectory::ALL {
            assert_eq!(Trajectory::from_name(trajectory.as_str()), Some(trajectory));
            let json = serde_json::to_string(&trajectory).unwrap();
            assert_eq!(json, format!("\"{}\"", trajectory.as_str()));
        }
    }
}
