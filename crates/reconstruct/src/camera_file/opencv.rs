//! OpenCV's file storage and ROS's `CameraInfo`, both YAML with the same keys.
//!
//! Pixels are measured from the first pixel's centre; distortion is `k1 k2 p1 p2 k3`, then a rational part that is refused.
//! Only these few keys are looked for: a whole YAML parser is not worth its weight.

use super::{CameraFile, CameraFormat, Source};
use crate::Error;
use nalgebra::Matrix3;
use selenograph_geometry::{Camera, Distortion, PixelConvention};

pub(super) fn parse(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let matrix = matrix(text, &["camera_matrix", "cameraMatrix", "K"])
        .ok_or_else(|| source.bad("a key camera_matrix with data: [ … ]", "none"))?;
    let matrix: [f64; 9] = numbers(source, matrix, "camera_matrix")?
        .try_into()
        .map_err(|found: Vec<f64>| source.bad("9 numbers of camera_matrix", found.len()))?;
    let mut notes = Vec::new();
    let size = |key: &str| scalar(text, key).and_then(|text| text.parse::<usize>().ok());
    let (width, height) = match (size("image_width"), size("image_height")) {
        (Some(width), Some(height)) => (width, height),
        _ => {
            notes.push("the file has no image_width and image_height: taken as the picture's".to_owned());
            (source.picture.width, source.picture.height)
        }
    };
    if let Some(model) = scalar(text, "distortion_model")
        && !matches!(model.trim_matches(['"', '\'']), "plumb_bob" | "rational_polynomial" | "")
    {
        return Err(source.bad("distortion_model plumb_bob", model));
    }
    let names = ["distortion_coefficients", "dist_coeffs", "distCoeffs", "D"];
    let lens = match self::matrix(text, &names) {
        Some(data) => numbers(source, data, "distortion_coefficients")?,
        None => {
            notes.push("no distortion_coefficients: an ideal lens".to_owned());
            Vec::new()
        }
    };
    if lens.iter().skip(5).any(|v| *v != 0.0) {
        return Err(source.bad("distortion k1 k2 p1 p2 k3", format!("{} coefficients", lens.len())));
    }
    let at = |idx: usize| lens.get(idx).copied().unwrap_or(0.0);
    let lens = Distortion { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4) };
    let k = Matrix3::from_row_slice(&matrix);
    let camera = source.with_lens(Camera::from_k(width, height, &k, PixelConvention::Center), lens)?;
    Ok(CameraFile { camera, pose: None, format: CameraFormat::OpenCv, notes })
}

/// The value behind `key:` on a line of its own.
fn scalar<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let value =
        text.lines().find_map(|line| line.trim().strip_prefix(key)?.trim_start().strip_prefix(':'))?;
    Some(value.trim())
}

/// What stands between the brackets after one of these keys.
fn matrix<'a>(text: &'a str, keys: &[&str]) -> Option<&'a str> {
    let start = keys.iter().find_map(|key| {
        let is_key = |line: &str| {
            line.trim_start().strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with(':'))
        };
        let mut at = 0;
        text.split_inclusive('\n').find_map(|line| {
            let found = is_key(line).then_some(at);
            at += line.len();
            found
        })
    })?;
    let (_, rest) = text[start..].split_once('[')?;
    rest.split_once(']').map(|(data, _)| data)
}

fn numbers(source: &Source, data: &str, key: &str) -> Result<Vec<f64>, Error> {
    data.split([',', '\n', ' ', '\t', '\r'])
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| match word {
            ".nan" | ".Nan" | ".NaN" => Ok(f64::NAN),
            _ => word.parse().map_err(|_| source.bad(format!("numbers in {key}"), format!("`{word}`"))),
        })
        .collect()
}
