//! OpenCV's file storage (YAML, XML, JSON) and ROS's `CameraInfo` (its YAML files, and what `rostopic echo` and `ros2 topic echo`
//! print): trees with the same few keys.
//!
//! Pixels are measured from the first pixel's centre; distortion is `k1 k2 p1 p2 k3`, and whatever goes beyond is refused by name.

mod tree;

use super::{CameraFile, CameraFormat, Source};
use crate::Error;
use selenograph_geometry::{Camera, Distortion, Matrix3, PixelConvention};
use tree::{Keys, Node};

/// Names of one key, without case and underscores.
const MATRIX: &[&str] = &["cameramatrix", "k"];
const LENS: &[&str] = &["distortioncoefficients", "distcoeffs", "d"];
const WIDTH: &[&str] = &["imagewidth", "width"];
const HEIGHT: &[&str] = &["imageheight", "height"];
const MODEL: &[&str] = &["distortionmodel"];

/// Whether the text is XML, or YAML or JSON with one of the keys on a line of its own.
pub(super) fn is_storage(text: &str) -> bool {
    let start = text.trim_start();
    let is_key = |line: &str| {
        let key = line.trim_start_matches(['{', '"', ' ', '\t']).split([':', '"']).next().unwrap_or_default();
        let key = tree::plain(key.trim_end());
        line.contains(':') && (MATRIX.contains(&key.as_str()) || MODEL.contains(&key.as_str()))
    };
    // Our own JSON has a key `k` too.
    let is_ours = start.starts_with('{') && !text.contains("amera_matrix") && !text.contains("ameraMatrix");
    start.starts_with("%YAML") || start.starts_with('<') || (!is_ours && text.lines().any(is_key))
}

pub(super) fn parse(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let documents =
        tree::documents(text).map_err(|found| source.bad("OpenCV's or ROS's YAML, XML or JSON", found))?;
    let mut cameras = documents.iter().map(|document| camera(source, document));
    let first =
        cameras.next().unwrap_or_else(|| Err(source.bad("a key camera_matrix or K", "an empty file")))?;
    // A topic repeats its message.
    for other in cameras {
        if other?.camera != first.camera {
            return Err(source.bad("one camera", format!("{} messages that differ", documents.len())));
        }
    }
    Ok(first)
}

fn camera(source: &Source, keys: &Keys) -> Result<CameraFile, Error> {
    let node = keys.get(MATRIX).ok_or_else(|| source.bad("a key camera_matrix or K", "none"))?;
    let matrix: [f64; 9] = numbers(source, node, "camera_matrix")?
        .try_into()
        .map_err(|found: Vec<f64>| source.bad("9 numbers of camera_matrix", found.len()))?;
    let mut notes = Vec::new();
    let (width, height) = match (size(source, keys, WIDTH)?, size(source, keys, HEIGHT)?) {
        (Some(width), Some(height)) => (width, height),
        _ => {
            notes.push("the file has no image_width and image_height: taken as the picture's".to_owned());
            (source.picture.width, source.picture.height)
        }
    };
    if matrix == [0.0; 9] {
        return Err(source.bad("a calibrated camera", "a camera matrix of zeros"));
    }
    let lens = lens(source, keys, &mut notes)?;
    let k = Matrix3::from_row_slice(&matrix);
    let camera = source.with_lens(Camera::from_k(width, height, &k, PixelConvention::Center), lens)?;
    Ok(CameraFile { camera, pose: None, format: CameraFormat::OpenCv, notes })
}

fn size(source: &Source, keys: &Keys, names: &[&str]) -> Result<Option<usize>, Error> {
    let Some(node) = keys.get(names) else { return Ok(None) };
    let whole = node.number().filter(|size| *size >= 1.0 && size.fract() == 0.0 && *size < 1e9);
    let size = whole.ok_or_else(|| source.bad(format!("{} as pixels", names[0]), node.shown()))?;
    Ok(Some(size as usize))
}

/// The distortion, or which model cannot be computed.
fn lens(source: &Source, keys: &Keys, notes: &mut Vec<String>) -> Result<Distortion, Error> {
    let refuse = |model: String| Err(source.bad("the distortion model plumb_bob (k1 k2 p1 p2 k3)", model));
    let is_set = |node: &Node| !matches!(node.shown().trim_matches('"'), "0" | "0.0" | "false");
    for (names, model) in [(&["fisheyemodel"], "fisheye_model"), (&["xi"], "xi, an omnidirectional camera")] {
        if keys.get(names).is_some_and(is_set) {
            return refuse(model.to_owned());
        }
    }
    let model = keys.get(MODEL).and_then(Node::text).unwrap_or_default();
    if !matches!(model, "" | "plumb_bob" | "rational_polynomial") {
        return refuse(format!("`{model}`, which cannot be computed here"));
    }
    let lens = match keys.get(LENS) {
        Some(node) => numbers(source, node, "distortion_coefficients")?,
        None => {
            notes.push("no distortion_coefficients: an ideal lens".to_owned());
            Vec::new()
        }
    };
    if !matches!(lens.len(), 0 | 4 | 5 | 8 | 12 | 14) {
        let expected = "4, 5, 8, 12 or 14 distortion coefficients, as OpenCV has them";
        return Err(source.bad(expected, format!("{} coefficients", lens.len())));
    }
    let at = |idx: usize| lens.get(idx).copied().unwrap_or(0.0);
    let beyond = [
        (5..8, "rational_polynomial with k4, k5, k6 that are not 0"),
        (8..12, "a thin prism (s1 to s4 that are not 0)"),
        (12..14, "a tilted sensor (tau_x, tau_y that are not 0)"),
    ];
    for (mut range, model) in beyond {
        if range.any(|idx| at(idx) != 0.0) {
            return refuse(model.to_owned());
        }
    }
    Ok(Distortion { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4) })
}

/// The numbers of a list, or of the key `data` of a matrix.
fn numbers(source: &Source, node: &Node, key: &str) -> Result<Vec<f64>, Error> {
    let data = node.keys().and_then(|keys| keys.get(&["data"]).cloned());
    data.as_ref().unwrap_or(node).numbers().map_err(|found| source.bad(format!("numbers in {key}"), found))
}

#[cfg(test)]
mod tests;
