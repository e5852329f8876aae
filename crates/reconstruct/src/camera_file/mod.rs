//! Cameras from files: our TOML and JSON, COLMAP (text and binary), OpenCV and ROS, Ames Stereo Pipeline.
//!
//! The format is recognised by content. Each one is a small module; nothing else knows its conventions. What comes out is
//! always ours: measured from the image's corner, `world_from_cam`, camera axes X right, Y down, Z forward.

mod asp;
pub(crate) mod colmap;
mod opencv;
mod ours;

use crate::{Error, input_file};
use selenograph_files::regular;
use selenograph_geometry::{BodyFixed, Cam, Camera, Point3, Rigid3, pixel};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Quaternions of files are rounded; one farther from unit length than this is no rotation.
const UNIT_TOLERANCE: f64 = 1e-3;

/// The kinds of camera files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraFormat {
    /// Ours, as TOML.
    Toml,
    /// Ours, as JSON: the `camera.json` of a dataset, or the keys of the TOML.
    Json,
    /// COLMAP's `cameras.txt` or `cameras.bin`, with the list of images beside it.
    Colmap,
    /// OpenCV's file storage as YAML, XML or JSON, or a ROS `CameraInfo`.
    OpenCv,
    /// Ames Stereo Pipeline's pinhole camera, `.tsai`.
    Asp,
}

/// A pose and the world it is in.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldPose {
    /// The world's name in the file, for example `moon_me`; a name of the format where the file has none.
    pub world: String,
    /// The camera in that world (body-fixed only where its name says so).
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
    /// Whether the world's unit is a metre.
    pub metric: bool,
}

/// What a camera file says of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFile {
    /// The camera, of the picture's size.
    pub camera: Camera,
    /// Where it was, if the file says so.
    pub pose: Option<WorldPose>,
    /// Which kind of file it was.
    pub format: CameraFormat,
    /// What had to be decided while reading, in sentences.
    pub notes: Vec<String>,
}

/// The picture that a camera is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureSize<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Its file, by whose name and folders COLMAP's lists are searched.
    pub path: Option<&'a Path>,
    /// Whether a camera of another size may be resized, sides in proportion, because the picture was.
    pub was_resized: bool,
}

impl<'a> PictureSize<'a> {
    /// A picture as it left the camera.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, path: None, was_resized: false }
    }

    /// With its file.
    pub fn at(self, path: &'a Path) -> Self {
        Self { path: Some(path), ..self }
    }
}

/// Reads the camera of a picture, from a file or from the folder of a COLMAP model.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for what is no regular file, too large or no text, a file of no known kind, missing keys, numbers that no camera has, and rotations
/// that are mirrored or not orthonormal; [`Error::CameraSize`] if the camera belongs to a picture of another size.
pub fn read(path: &Path, picture: &PictureSize) -> Result<CameraFile, Error> {
    let in_folder = if path.is_dir() { colmap::in_folder(path) } else { None };
    let path = in_folder.as_deref().unwrap_or(path);
    let bytes = regular::read(path, regular::MAX_TEXT_BYTES).map_err(Error::io("read", path))?;
    let source = Source { path, picture };
    let mut file = if colmap::is_binary(path, &bytes) {
        colmap::from_binary(&source, &bytes)?
    } else {
        from_text(&source, &input_file::text_of(path, &bytes)?)?
    };
    let (width, height) = (file.camera.width, file.camera.height);
    if (width, height) == (picture.width, picture.height) {
        return Ok(file);
    }
    let in_proportion = width as u128 * picture.height as u128 == height as u128 * picture.width as u128;
    if !picture.was_resized || !in_proportion {
        return Err(Error::CameraSize {
            path: path.to_owned(),
            camera: [width, height],
            picture: [picture.width, picture.height],
            in_proportion,
        });
    }
    file.camera =
        pixel::resize(&file.camera, picture.width, picture.height).map_err(|e| source.bad("a camera", e))?;
    file.notes.push(format!("camera of {width}×{height} resized to {}×{}", picture.width, picture.height));
    Ok(file)
}

fn from_text(source: &Source, text: &str) -> Result<CameraFile, Error> {
    match format_of(text) {
        Some(CameraFormat::Json) => ours::from_json(source, text),
        Some(CameraFormat::Toml) => ours::from_toml(source, text),
        Some(CameraFormat::Colmap) => colmap::from_text(source, text),
        Some(CameraFormat::OpenCv) => opencv::parse(source, text),
        Some(CameraFormat::Asp) => asp::parse(source, text),
        None => Err(source.bad(
            "a camera as TOML or JSON, COLMAP's cameras.txt or cameras.bin, OpenCV's or ROS's YAML or XML, or an ASP .tsai",
            first_line(text),
        )),
    }
}

fn format_of(text: &str) -> Option<CameraFormat> {
    if opencv::is_storage(text) {
        return Some(CameraFormat::OpenCv);
    }
    if text.trim_start().starts_with('{') {
        return Some(CameraFormat::Json);
    }
    if asp::is_tsai(text) {
        return Some(CameraFormat::Asp);
    }
    if colmap::is_camera_list(text) {
        return Some(CameraFormat::Colmap);
    }
    let is_key = |line: &str| !line.trim_start().starts_with('#') && line.contains('=');
    text.lines().any(is_key).then_some(CameraFormat::Toml)
}

fn first_line(text: &str) -> String {
    let line: String =
        text.lines().find(|line| !line.trim().is_empty()).unwrap_or("").chars().take(40).collect();
    if line.is_empty() { "an empty file".to_owned() } else { format!("`{}`", line.trim().escape_debug()) }
}

/// The file being read, for messages, and the picture it is for.
struct Source<'a> {
    path: &'a Path,
    picture: &'a PictureSize<'a>,
}

impl Source<'_> {
    /// Expected this, found that.
    fn bad(&self, expected: impl Into<String>, found: impl ToString) -> Error {
        let found = found.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        Error::Format { path: self.path.to_owned(), expected: expected.into(), found }
    }

    /// A pose from a quaternion of about unit length and the camera's position.
    fn pose_of_quaternion(
        &self,
        wxyz: [f64; 4],
        position: [f64; 3],
    ) -> Result<Rigid3<BodyFixed, Cam>, Error> {
        let norm = wxyz.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !norm.is_finite() || (norm - 1.0).abs() > UNIT_TOLERANCE {
            return Err(self.bad("a quaternion of length 1", format!("length {norm}")));
        }
        let [w, x, y, z] = wxyz;
        Ok(Rigid3::from_quaternion(w, x, y, z, self.position(position)?))
    }

    /// A pose from the rows of `[R | t]`.
    fn pose_of_rows(&self, rows: &[[f64; 4]; 3]) -> Result<Rigid3<BodyFixed, Cam>, Error> {
        let rotation = selenograph_geometry::Matrix3::from_fn(|i, j| rows[i][j]);
        let position = self.position([rows[0][3], rows[1][3], rows[2][3]])?;
        Rigid3::from_matrix(&rotation, position)
            .map_err(|e| self.bad("world_from_cam with a rotation (orthonormal, determinant +1)", e))
    }

    fn position(&self, position: [f64; 3]) -> Result<Point3<f64>, Error> {
        if position.iter().all(|v| v.is_finite()) {
            Ok(Point3::from(position))
        } else {
            Err(self.bad("a position of finite numbers", format!("{position:?}")))
        }
    }

    /// A lens of finite numbers on a camera.
    fn with_lens(
        &self,
        camera: Result<Camera, selenograph_geometry::Error>,
        lens: selenograph_geometry::Distortion,
    ) -> Result<Camera, Error> {
        let camera = camera.map_err(|e| self.bad("a camera matrix that a real camera has", e))?;
        let all = [lens.k1, lens.k2, lens.p1, lens.p2, lens.k3];
        if all.iter().all(|v| v.is_finite()) {
            Ok(camera.with_distortion(lens))
        } else {
            Err(self.bad("distortion of finite numbers", format!("{all:?}")))
        }
    }
}

/// A unit quaternion as files of ours hold it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Quaternion {
    qw: f64,
    qx: f64,
    qy: f64,
    qz: f64,
}

#[cfg(test)]
mod tests;
