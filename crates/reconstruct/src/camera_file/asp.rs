//! Pinhole cameras of the Ames Stereo Pipeline (`.tsai`), versions 1 (which has no line that says so) to 4.
//!
//! Lengths are in units of `pitch` (usually millimetres) and the principal point is measured from the first pixel's centre. A
//! point is seen at `u·x / w·x` and `v·x / w·x` of its camera coordinates `x = Rᵀ (X − C)`, with the three directions of the
//! file; `C` is in metres. Before version 3 the pitch may be missing (it is 1) and the lens has no name (it is TSAI). The file
//! does not know the picture's size.
//!
//! # Source
//! Ames Stereo Pipeline's documentation, "Pinhole models", and what Vision Workbench's reader accepts.

use super::{CameraFile, CameraFormat, Source, WorldPose};
use crate::Error;
use selenograph_geometry::{
    BodyFixed, Cam, Camera, Distortion, Matrix3, PixelConvention, Point3, Rigid3, RowVector3,
};

/// The newest version that is known.
const NEWEST: u32 = 4;
/// The first one in which pitch and the lens's name must be there, and the first one that names the kind of camera.
const WITH_LENS_NAME: u32 = 3;
const WITH_KIND: u32 = 4;

/// Whether the text has one of the lines that every such file has.
pub(super) fn is_tsai(text: &str) -> bool {
    text.trim_start().starts_with("VERSION_") || value(text, "fu").is_some()
}

pub(super) fn parse(source: &Source, text: &str) -> Result<CameraFile, Error> {
    let version = version(source, text)?;
    let mut notes = vec!["a .tsai file does not say the picture's size: taken as the picture's".to_owned()];
    let number = |key: &str| -> Result<f64, Error> { numbers::<1>(source, text, key).map(|[value]| value) };
    let pitch = if version < WITH_LENS_NAME && value(text, "pitch").is_none() {
        notes.push("no pitch, as before version 3: lengths are in pixels".to_owned());
        1.0
    } else {
        number("pitch")?
    };
    if !(pitch.is_finite() && pitch > 0.0) {
        return Err(source.bad("a positive pitch", pitch));
    }
    let (fx, fy) = (number("fu")? / pitch, number("fv")? / pitch);
    let (cx, cy) = (number("cu")? / pitch, number("cv")? / pitch);
    let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    let camera = Camera::from_k(source.picture.width, source.picture.height, &k, PixelConvention::Center);
    let camera = source.with_lens(camera, lens(source, text, version)?)?;
    let r = numbers::<9>(source, text, "R")?;
    let world_from_file = Matrix3::from_row_slice(&r) * directions(source, text)?.transpose();
    let c = numbers::<3>(source, text, "C")?;
    let rows = [0, 1, 2].map(|i| {
        let row = world_from_file.row(i);
        [row[0], row[1], row[2], c[i]]
    });
    let pose = WorldPose {
        world: "body_fixed".to_owned(),
        world_from_cam: source.pose_of_rows(&rows)?,
        metric: true,
    };
    Ok(CameraFile { camera, pose: Some(pose), format: CameraFormat::Asp, notes })
}

/// The number behind `VERSION_`, 1 without one.
fn version(source: &Source, text: &str) -> Result<u32, Error> {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let Some(number) = lines.next().and_then(|line| line.strip_prefix("VERSION_")) else { return Ok(1) };
    let version = number.trim().parse::<u32>().ok().filter(|version| (1..=NEWEST).contains(version));
    let expected = format!("VERSION_1 to VERSION_{NEWEST}");
    let version = version.ok_or_else(|| source.bad(expected, format!("VERSION_{number}")))?;
    let kind = lines.next().unwrap_or_default();
    if version >= WITH_KIND && kind != "PINHOLE" {
        return Err(source.bad("a PINHOLE camera", format!("`{kind}`")));
    }
    Ok(version)
}

/// The rotation from the file's camera axes to X right, Y down, Z forward.
fn directions(source: &Source, text: &str) -> Result<Matrix3<f64>, Error> {
    let axis = |key: &str, usual: [f64; 3]| match value(text, key) {
        Some(_) => numbers::<3>(source, text, key).map(RowVector3::from),
        None => Ok(RowVector3::from(usual)),
    };
    let matrix = Matrix3::from_rows(&[
        axis("u_direction", [1.0, 0.0, 0.0])?,
        axis("v_direction", [0.0, 1.0, 0.0])?,
        axis("w_direction", [0.0, 0.0, 1.0])?,
    ]);
    let rotation = Rigid3::<BodyFixed, Cam>::from_matrix(&matrix, Point3::origin());
    let expected = "u_direction, v_direction, w_direction at right angles and right-handed";
    rotation.map(|rotation| rotation.rotation()).map_err(|e| source.bad(expected, e))
}

/// `TSAI` is OpenCV's form of Brown's lens; others go from the distorted place to the ideal one, or are no polynomials.
fn lens(source: &Source, text: &str, version: u32) -> Result<Distortion, Error> {
    let is_name = |line: &&str| {
        !line.is_empty() && !line.contains('=') && !line.starts_with("VERSION_") && *line != "PINHOLE"
    };
    let name = text.lines().map(str::trim).find(is_name);
    match name.map(str::to_uppercase).as_deref() {
        Some("NULL") => Ok(Distortion::default()),
        Some("TSAI") => tsai(source, text),
        None if version < WITH_LENS_NAME => tsai(source, text),
        None => Err(source.bad("the name of a lens (NULL or TSAI)", "none")),
        Some(_) => {
            let found = format!("`{}`, which cannot be computed here", name.unwrap_or_default());
            Err(source.bad("the lens NULL or TSAI", found))
        }
    }
}

fn tsai(source: &Source, text: &str) -> Result<Distortion, Error> {
    let number = |key: &str| numbers::<1>(source, text, key).map(|[value]| value);
    Ok(Distortion {
        k1: number("k1")?,
        k2: number("k2")?,
        p1: number("p1")?,
        p2: number("p2")?,
        k3: if value(text, "k3").is_some() { number("k3")? } else { 0.0 },
    })
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
