//! COLMAP's models, text and binary: `cameras.txt` with `images.txt` beside it, or `cameras.bin` with `images.bin`.
//!
//! Pixels are measured from the corner. Poses are stored as `cam_from_world`, quaternions scalar first.
//!
//! # Source
//! COLMAP's documentation, "Output format" and "Camera models".

mod binary;
pub(crate) mod models;
mod names;
mod text;

use super::{CameraFile, CameraFormat, Source, WorldPose};
use crate::Error;
use models::{MODELS, Model};
use names::Candidates;
use selenograph_geometry::{Camera, Distortion, Matrix3, PixelConvention};
use std::path::{Path, PathBuf};

pub(super) use text::is_camera_list;

/// One line of the list of cameras.
struct CameraRow {
    id: u64,
    model: &'static Model,
    width: usize,
    height: usize,
    params: Vec<f64>,
}

/// One picture of the list of images: its `cam_from_world` and camera.
struct Image {
    wxyz: [f64; 4],
    translation: [f64; 3],
    camera_id: u64,
}

/// The list of cameras in a folder of a model; COLMAP itself takes the binary one where there are two.
pub(super) fn in_folder(folder: &Path) -> Option<PathBuf> {
    ["cameras.bin", "cameras.txt"].map(|name| folder.join(name)).into_iter().find(|path| path.is_file())
}

/// Whether these bytes are meant to be a list of cameras, by its name or by its length.
pub(super) fn is_binary(path: &Path, bytes: &[u8]) -> bool {
    path.extension().is_some_and(|extension| extension == "bin") || binary::cameras(bytes).is_ok()
}

pub(super) fn from_text(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let cameras = text::cameras(text).map_err(|(expected, found)| source.bad(expected, found))?;
    let images = source.path.with_file_name("images.txt");
    camera_of(source, &cameras, &images, text::images)
}

pub(super) fn from_binary(source: &Source, bytes: &[u8]) -> Result<CameraFile, Error> {
    let cameras = binary::cameras(bytes).map_err(|(expected, found)| source.bad(expected, found))?;
    let images = source.path.with_file_name("images.bin");
    camera_of(source, &cameras, &images, binary::images)
}

/// Tells of every picture of a list.
type Images = fn(&Path, &mut dyn FnMut(&str, Image)) -> Result<(), Error>;

fn camera_of(
    source: &Source,
    cameras: &[CameraRow],
    images: &Path,
    each: Images,
) -> Result<CameraFile, Error> {
    let found = match source.picture.path {
        Some(picture) if images.exists() => {
            let mut candidates = Candidates::new(picture);
            each(images, &mut |name, image| candidates.offer(name, image))?;
            Some(candidates.only(images)?)
        }
        _ => None,
    };
    let row = match (&found, cameras) {
        (Some(found), _) => {
            let id = found.what.camera_id;
            let expected = || format!("camera {id} of {}", images.display());
            cameras.iter().find(|row| row.id == id).ok_or_else(|| source.bad(expected(), "no such camera"))?
        }
        (None, [one]) => one,
        (None, several) => {
            let expected = "one camera, or the list of images beside it with the picture's name";
            return Err(source.bad(expected, format!("{} cameras", several.len())));
        }
    };
    let camera = camera(source, row)?;
    let mut notes = Vec::new();
    let pose = match found {
        None => None,
        Some(found) => {
            notes.extend(found.note);
            notes.push("COLMAP's world has no unit of its own: the pose is not metric".to_owned());
            let image = found.what;
            let list = Source { path: images, picture: source.picture };
            let cam_from_world = list.pose_of_quaternion(image.wxyz, image.translation)?;
            let world_from_cam = cam_from_world.inverse().relabel();
            Some(WorldPose { world: "colmap".to_owned(), world_from_cam, metric: false })
        }
    };
    Ok(CameraFile { camera, pose, format: CameraFormat::Colmap, notes })
}

fn camera(source: &Source, row: &CameraRow) -> Result<Camera, Error> {
    let lens = |k1, k2, p1, p2, k3| Distortion { k1, k2, p1, p2, k3 };
    let (fx, fy, cx, cy, lens) = match (row.model.name, row.params.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy, Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy, Distortion::default()),
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => (f, f, cx, cy, lens(k1, 0.0, 0.0, 0.0, 0.0)),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (f, f, cx, cy, lens(k1, k2, 0.0, 0.0, 0.0)),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => (fx, fy, cx, cy, lens(k1, k2, p1, p2, 0.0)),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            if [k4, k5, k6] != [0.0; 3] {
                let found = format!("FULL_OPENCV with k4, k5, k6 = {k4}, {k5}, {k6}");
                return Err(source.bad("a lens of k1 k2 p1 p2 k3 alone", found));
            }
            (fx, fy, cx, cy, lens(k1, k2, p1, p2, k3))
        }
        (name, _) => {
            let expected = "a pinhole with Brown's lens: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, \
                            FULL_OPENCV";
            return Err(source.bad(expected, format!("{name}, which cannot be computed here")));
        }
    };
    let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    source.with_lens(Camera::from_k(row.width, row.height, &k, PixelConvention::Corner), lens)
}

/// What was expected and what was found.
type Unexpected = (String, String);

/// The parameters of a model, as many as it has.
fn checked(model: &'static Model, params: Vec<f64>) -> Result<Vec<f64>, Unexpected> {
    if params.len() == model.num_params {
        return Ok(params);
    }
    Err((
        format!("{} with {} parameters", model.name, model.num_params),
        format!("{} parameters", params.len()),
    ))
}

fn model_named(name: &str) -> Result<&'static Model, Unexpected> {
    let found = MODELS.iter().find(|model| model.name == name);
    found.ok_or_else(|| ("a camera model of COLMAP".to_owned(), format!("`{name}`")))
}

#[cfg(test)]
mod tests;
