//! Our own camera files: a few keys for people (TOML or JSON), and the `camera.json` of a dataset.

use super::{CameraFile, CameraFormat, Quaternion, Source, WorldPose};
use crate::Error;
use selenograph_geometry::{Camera, Distortion, Matrix3, PixelConvention};
use serde::Deserialize;

/// The name in the key `format`.
const FORMAT: &str = "selenograph.camera";

/// A newer version is refused.
const VERSION: u32 = 1;

/// Two forms of one pose may differ by rounding: of a matrix entry, and of a position in metres.
const SAME_ROTATION: f64 = 1e-6;
const SAME_POSITION_M: f64 = 1e-3;

/// The keys that people write.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    format: Option<String>,
    version: Option<u32>,
    #[serde(alias = "width")]
    width_px: Option<usize>,
    #[serde(alias = "height")]
    height_px: Option<usize>,
    #[serde(alias = "fx")]
    fx_px: Option<f64>,
    #[serde(alias = "fy")]
    fy_px: Option<f64>,
    #[serde(alias = "cx")]
    cx_px: Option<f64>,
    #[serde(alias = "cy")]
    cy_px: Option<f64>,
    fov_deg: Option<f64>,
    pixel_convention: Option<PixelConvention>,
    #[serde(default)]
    distortion: Distortion,
    world: Option<String>,
    world_from_cam: Option<[[f64; 4]; 3]>,
    position_m: Option<[f64; 3]>,
    world_from_cam_quaternion: Option<Quaternion>,
}

/// What matters here of a dataset's record of a view; its other keys describe the scene.
#[derive(Debug, Deserialize)]
struct Record {
    format: String,
    version: u32,
    k: [[f64; 3]; 3],
    k_pixel_convention: PixelConvention,
    sensor: Sensor,
    #[serde(default)]
    distortion: Distortion,
    world: Option<String>,
    world_from_cam: Option<[[f64; 4]; 3]>,
    position_m: Option<[f64; 3]>,
    world_from_cam_quaternion: Option<Quaternion>,
}

#[derive(Debug, Deserialize)]
struct Sensor {
    width_px: usize,
    height_px: usize,
}

pub(super) fn from_toml(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let keys: Keys = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
        source.bad("the keys of a camera", format!("line {line}: {}", e.message()))
    })?;
    keys.read(source, CameraFormat::Toml)
}

pub(super) fn from_json(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let bad = |e: serde_json::Error| source.bad("a camera as JSON", e);
    let value: serde_json::Value = serde_json::from_str(text).map_err(bad)?;
    if value.get("k").is_some() {
        serde_json::from_value::<Record>(value).map_err(bad)?.read(source)
    } else {
        serde_json::from_value::<Keys>(value).map_err(bad)?.read(source, CameraFormat::Json)
    }
}

fn check_header(source: &Source, format: &str, version: u32) -> Result<(), Error> {
    if format != FORMAT {
        return Err(source.bad(format!("format `{FORMAT}`"), format!("`{format}`")));
    }
    if version > VERSION {
        return Err(source.bad(format!("version {VERSION} or older"), format!("version {version}")));
    }
    Ok(())
}

impl Keys {
    fn read(self, source: &Source, format: CameraFormat) -> Result<CameraFile, Error> {
        check_header(source, self.format.as_deref().unwrap_or(FORMAT), self.version.unwrap_or(VERSION))?;
        let mut notes = Vec::new();
        let camera = self.camera(source, &mut notes)?;
        let camera = source.with_lens(camera, self.distortion)?;
        let pose = pose(
            source,
            self.world,
            self.world_from_cam.as_ref(),
            self.position_m,
            self.world_from_cam_quaternion,
        )?;
        Ok(CameraFile { camera, pose, format, notes })
    }

    fn camera(
        &self,
        source: &Source,
        notes: &mut Vec<String>,
    ) -> Result<Result<Camera, selenograph_geometry::Error>, Error> {
        let (width, height) = match (self.width_px, self.height_px) {
            (Some(width), Some(height)) => (width, height),
            (None, None) => {
                notes.push("the file has no width_px and height_px: taken as the picture's".to_owned());
                (source.picture.width, source.picture.height)
            }
            _ => return Err(source.bad("both width_px and height_px, or neither", "one of them")),
        };
        let (fx, fov_deg) = match (self.fx_px, self.fov_deg) {
            (Some(fx), None) => (fx, None),
            (None, Some(fov_deg)) => (f64::NAN, Some(fov_deg)),
            (Some(_), Some(_)) => return Err(source.bad("either fx_px or fov_deg", "both")),
            (None, None) => return Err(source.bad("a key fx_px or fov_deg", "neither")),
        };
        if let Some(fov_deg) = fov_deg {
            if self.fy_px.is_some() || self.cx_px.is_some() || self.cy_px.is_some() {
                return Err(source.bad("fov_deg alone, or fx_px, fy_px, cx_px, cy_px", "a mixture"));
            }
            return Ok(Camera::from_fov(width, height, fov_deg.to_radians()));
        }
        let fy = self.fy_px.unwrap_or_else(|| {
            notes.push("no fy_px: pixels are square".to_owned());
            fx
        });
        let (centre, convention) = match (self.cx_px, self.cy_px, self.pixel_convention) {
            (Some(cx), Some(cy), Some(convention)) => ((cx, cy), convention),
            (Some(_), Some(_), None) => {
                let expected = "pixel_convention: `corner` (first pixel's centre at 0.5) or `center` (at 0)";
                return Err(source.bad(expected, "cx_px and cy_px without it"));
            }
            (None, None, _) => {
                notes.push("no cx_px and cy_px: the middle of the picture".to_owned());
                ((width as f64 / 2.0, height as f64 / 2.0), PixelConvention::Corner)
            }
            _ => return Err(source.bad("both cx_px and cy_px, or neither", "one of them")),
        };
        let k = Matrix3::new(fx, 0.0, centre.0, 0.0, fy, centre.1, 0.0, 0.0, 1.0);
        Ok(Camera::from_k(width, height, &k, convention))
    }
}

impl Record {
    fn read(self, source: &Source) -> Result<CameraFile, Error> {
        check_header(source, &self.format, self.version)?;
        let k = Matrix3::from_fn(|i, j| self.k[i][j]);
        let camera = Camera::from_k(self.sensor.width_px, self.sensor.height_px, &k, self.k_pixel_convention);
        let camera = source.with_lens(camera, self.distortion)?;
        let pose = pose(
            source,
            self.world,
            self.world_from_cam.as_ref(),
            self.position_m,
            self.world_from_cam_quaternion,
        )?;
        Ok(CameraFile { camera, pose, format: CameraFormat::Json, notes: Vec::new() })
    }
}

/// The pose by matrix, or by position and quaternion; if both are there they must agree.
fn pose(
    source: &Source,
    world: Option<String>,
    rows: Option<&[[f64; 4]; 3]>,
    position_m: Option<[f64; 3]>,
    quaternion: Option<Quaternion>,
) -> Result<Option<WorldPose>, Error> {
    let by_rows = rows.map(|rows| source.pose_of_rows(rows)).transpose()?;
    let by_quaternion = match (position_m, quaternion) {
        (Some(position), Some(Quaternion { qw, qx, qy, qz })) => {
            Some(source.pose_of_quaternion([qw, qx, qy, qz], position)?)
        }
        (None, None) => None,
        _ if rows.is_some() => None,
        _ => return Err(source.bad("both position_m and world_from_cam_quaternion", "one of them")),
    };
    let world_from_cam = match (by_rows, by_quaternion) {
        (Some(a), Some(b)) => {
            let turned = (a.rotation() - b.rotation()).amax();
            let moved = (a.origin() - b.origin()).norm();
            if turned > SAME_ROTATION || moved > SAME_POSITION_M {
                let found = format!("rotations {turned:.1e} and positions {moved:.1e} m apart");
                return Err(source.bad("world_from_cam and its quaternion and position to agree", found));
            }
            a
        }
        (Some(pose), None) | (None, Some(pose)) => pose,
        (None, None) => return Ok(None),
    };
    let world = world.ok_or_else(|| {
        source.bad("a key world (`moon_me`, `enu`, `local` …) with the pose", "a pose in an unnamed world")
    })?;
    Ok(Some(WorldPose { world, world_from_cam, metric: true }))
}
