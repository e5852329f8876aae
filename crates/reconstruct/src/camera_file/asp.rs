//! Pinhole cameras of the Ames Stereo Pipeline (`.tsai`).
//!
//! Lengths are in units of `pitch` (usually millimetres), the principal point is measured from the image's corner, `R` leads
//! from the camera to the world and `C` is the centre of projection, in metres. The file does not know the picture's size.
//!
//! # Source
//! Ames Stereo Pipeline's documentation, "Pinhole models".

use super::{CameraFile, CameraFormat, Source, WorldPose};
use crate::Error;
use nalgebra::Matrix3;
use selenograph_geometry::{Camera, Distortion, PixelConvention};

pub(super) fn parse(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let number = |key: &str| -> Result<f64, Error> { numbers::<1>(source, text, key).map(|[value]| value) };
    for (key, axis) in
        [("u_direction", [1.0, 0.0, 0.0]), ("v_direction", [0.0, 1.0, 0.0]), ("w_direction", [0.0, 0.0, 1.0])]
    {
        if value(text, key).is_some() && numbers::<3>(source, text, key)? != axis {
            return Err(
                source.bad(format!("{key} = {axis:?}"), format!("{:?}", numbers::<3>(source, text, key)?))
            );
        }
    }
    let pitch = number("pitch")?;
    if !(pitch.is_finite() && pitch > 0.0) {
        return Err(source.bad("a positive pitch", pitch));
    }
    let (fx, fy) = (number("fu")? / pitch, number("fv")? / pitch);
    let (cx, cy) = (number("cu")? / pitch, number("cv")? / pitch);
    let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    let camera = Camera::from_k(source.picture.width, source.picture.height, &k, PixelConvention::Corner);
    let camera = source.with_lens(camera, lens(source, text)?)?;
    let r = numbers::<9>(source, text, "R")?;
    let c = numbers::<3>(source, text, "C")?;
    let rows = [0, 1, 2].map(|i| [r[3 * i], r[3 * i + 1], r[3 * i + 2], c[i]]);
    let pose = WorldPose {
        world: "body_fixed".to_owned(),
        world_from_cam: source.pose_of_rows(&rows)?,
        metric: true,
    };
    let notes = vec!["a .tsai file does not say the picture's size: taken as the picture's".to_owned()];
    Ok(CameraFile { camera, pose: Some(pose), format: CameraFormat::Asp, notes })
}

/// `TSAI` is OpenCV's form of Brown's lens; others are refused.
fn lens(source: &Source, text: &str) -> Result<Distortion, Error> {
    let mut names = text.lines().map(str::trim).filter(|line| {
        !line.is_empty() && !line.contains('=') && !line.starts_with("VERSION_") && *line != "PINHOLE"
    });
    match names.next() {
        None | Some("NULL") => Ok(Distortion::default()),
        Some("TSAI") => {
            let [k1, k2, p1, p2] =
                [0, 1, 2, 3].map(|i| numbers::<1>(source, text, ["k1", "k2", "p1", "p2"][i]).map(|[v]| v));
            let k3 = if value(text, "k3").is_some() { numbers::<1>(source, text, "k3")?[0] } else { 0.0 };
            Ok(Distortion { k1: k1?, k2: k2?, p1: p1?, p2: p2?, k3 })
        }
        Some(other) => Err(source.bad("distortion NULL or TSAI", other)),
    }
}

fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().find_map(|line| line.trim().strip_prefix(key)?.trim_start().strip_prefix('='))
}

fn numbers<const N: usize>(source: &Source, text: &str, key: &str) -> Result<[f64; N], Error> {
    let value = value(text, key).ok_or_else(|| source.bad(format!("a key {key}"), "none"))?;
    let found: Option<Vec<f64>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
    found
        .and_then(|found| found.try_into().ok())
        .ok_or_else(|| source.bad(format!("{N} number(s) after {key}"), value.trim()))
}
