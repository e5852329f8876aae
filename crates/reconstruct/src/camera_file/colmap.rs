//! COLMAP's text model: `cameras.txt`, and `images.txt` beside it.
//!
//! Pixels are measured from the corner. Poses are stored as `cam_from_world`, quaternions scalar first.
//!
//! # Source
//! COLMAP's documentation, "Output format" and "Camera models".

use super::{CameraFile, CameraFormat, Source, WorldPose};
use crate::Error;
use nalgebra::Matrix3;
use selenograph_geometry::{Camera, Distortion, PixelConvention};
use std::path::Path;

const MODELS: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV";

/// Whether the first line that is no comment reads `1 PINHOLE 512 …`.
pub(super) fn is_camera_list(text: &str) -> bool {
    lines(text).next().is_some_and(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let upper = |word: &&str| word.chars().all(|c| c.is_ascii_uppercase() || c == '_');
        words.len() >= 5 && words[0].parse::<u64>().is_ok() && words[1..2].iter().all(upper)
    })
}

fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
}

pub(super) fn parse(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let image = match source.picture.name {
        Some(name) => image_of(&source.path.with_file_name("images.txt"), name)?,
        None => None,
    };
    let cameras: Vec<Vec<&str>> = lines(text).map(|line| line.split_whitespace().collect()).collect();
    let words = match &image {
        Some(image) => {
            cameras.iter().find(|words| words.first() == Some(&image.camera_id.as_str())).ok_or_else(
                || source.bad(format!("camera {} of images.txt", image.camera_id), "no such camera"),
            )?
        }
        None => match cameras.as_slice() {
            [one] => one,
            several => {
                let expected = "one camera, or images.txt beside it with the picture's name";
                return Err(source.bad(expected, format!("{} cameras", several.len())));
            }
        },
    };
    let camera = camera(source, words)?;
    let (pose, notes) = match image {
        None => (None, Vec::new()),
        Some(image) => {
            let cam_from_world = source.pose_of_quaternion(image.wxyz, image.translation)?;
            let inverse = cam_from_world.inverse();
            let [w, x, y, z] = inverse.quaternion_wxyz();
            let origin: [f64; 3] = inverse.origin().coords.into();
            let world_from_cam = source.pose_of_quaternion([w, x, y, z], origin)?;
            let note = "COLMAP's world has no unit of its own: the pose is not metric".to_owned();
            (Some(WorldPose { world: "colmap".to_owned(), world_from_cam, metric: false }), vec![note])
        }
    };
    Ok(CameraFile { camera, pose, format: CameraFormat::Colmap, notes })
}

fn camera(source: &Source, words: &[&str]) -> Result<Camera, Error> {
    let [_, model, width, height, parameters @ ..] = words else {
        return Err(source.bad("a line `id MODEL width height parameters`", words.join(" ")));
    };
    let size =
        |word: &str| word.parse::<usize>().map_err(|_| source.bad("a size in pixels", format!("`{word}`")));
    let parameters: Vec<f64> = parameters
        .iter()
        .map(|word| word.parse().map_err(|_| source.bad("a number", format!("`{word}`"))))
        .collect::<Result<_, _>>()?;
    let lens = |k1, k2, p1, p2, k3| Distortion { k1, k2, p1, p2, k3 };
    let (fx, fy, cx, cy, lens) = match (*model, parameters.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy, lens(0.0, 0.0, 0.0, 0.0, 0.0)),
        ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy, lens(0.0, 0.0, 0.0, 0.0, 0.0)),
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => (f, f, cx, cy, lens(k1, 0.0, 0.0, 0.0, 0.0)),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (f, f, cx, cy, lens(k1, k2, 0.0, 0.0, 0.0)),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => (fx, fy, cx, cy, lens(k1, k2, p1, p2, 0.0)),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) if [k4, k5, k6] == [0.0; 3] => {
            (fx, fy, cx, cy, lens(k1, k2, p1, p2, k3))
        }
        _ => {
            let found = format!("{model} with {} parameters", parameters.len());
            return Err(source.bad(format!("a model of {MODELS} (k4 to k6 zero)"), found));
        }
    };
    let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    source.with_lens(Camera::from_k(size(width)?, size(height)?, &k, PixelConvention::Corner), lens)
}

/// One picture of `images.txt`: its `cam_from_world` and camera.
struct Image {
    wxyz: [f64; 4],
    translation: [f64; 3],
    camera_id: String,
}

/// The picture of that name; `None` where there is no list.
fn image_of(path: &Path, name: &str) -> Result<Option<Image>, Error> {
    let text = match selenograph_raster::file::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::io("read", path)(e)),
    };
    let bad = |expected: &str, found: String| Error::Format {
        path: path.to_owned(),
        expected: expected.to_owned(),
        found,
    };
    // Two lines per picture; the second, its points, may be empty.
    let rows: Vec<&str> = text.lines().filter(|line| !line.trim_start().starts_with('#')).collect();
    for line in rows.iter().step_by(2) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [_, pose @ .., camera_id, file_name] = words.as_slice() else { continue };
        if *file_name != name && Path::new(file_name).file_name() != Some(std::ffi::OsStr::new(name)) {
            continue;
        }
        let numbers: Vec<f64> = pose.iter().filter_map(|word| word.parse().ok()).collect();
        let &[w, x, y, z, tx, ty, tz] = numbers.as_slice() else {
            return Err(bad("`id qw qx qy qz tx ty tz camera name`", (*line).to_owned()));
        };
        let camera_id = (*camera_id).to_owned();
        return Ok(Some(Image { wxyz: [w, x, y, z], translation: [tx, ty, tz], camera_id }));
    }
    Err(bad(&format!("a picture `{name}`"), format!("{} others", rows.len().div_ceil(2))))
}
