//! Our own pair folders: listed, and their views read.

use super::place::{Files, folders};
use super::view::{RawView, check_size, grey8};
use crate::Error;
use crate::pair::{CameraRecord, SensorRecord, ViewName, camera_name, image_name, lit_name, truth_name};
use selenograph_geometry::{Matrix3, Matrix4};
use selenograph_raster::Raster;
use selenograph_raster::codec::{Picture, exr, png};
use std::path::{Path, PathBuf};

/// The channel of z-depth in a truth file.
const DEPTH_CHANNEL: &str = "depth_z";
/// The channel of slope in a truth file.
const SLOPE_CHANNEL: &str = "slope";

/// Numbers and folders of the complete pairs of a dataset, in order; none where there is no folder `pairs`.
pub(super) fn list(root: &Path) -> Result<Vec<(u64, PathBuf)>, Error> {
    let top = root.join("pairs");
    let mut found = Vec::new();
    for group in if top.is_dir() { folders(&top)? } else { Vec::new() } {
        found.extend(folders(&group)?.into_iter().filter_map(|folder| {
            // Temporary folders have names that are no numbers.
            let id = folder.file_name()?.to_str()?.parse().ok()?;
            Some((id, folder))
        }));
    }
    found.sort();
    Ok(found)
}

/// The geometry of one view, and its slopes where they are stored.
pub(super) fn read_truth(files: &Files<'_>, view: ViewName) -> Result<(RawView, Option<Raster<f32>>), Error> {
    let record: CameraRecord = files.json(&camera_name(view))?;
    let file = truth_name(view);
    let path = files.place.path(&file);
    let mut truth = exr::decode(&files.read(&file)?, &path)?;
    let (width, height) = (truth.width, truth.height);
    if (width, height) != (record.sensor.width_px, record.sensor.height_px) {
        let SensorRecord { width_px, height_px, .. } = record.sensor;
        let expected = format!("{width_px}×{height_px} pixels, as the camera says");
        return Err(Error::unexpected(&path, expected, format!("{width}×{height}")));
    }
    let mut take = |name: &str| {
        let idx = truth.channels.iter().position(|channel| channel.name == name)?;
        Some(truth.channels.swap_remove(idx))
    };
    let (depth_z, slope) = (take(DEPTH_CHANNEL), take(SLOPE_CHANNEL));
    let Some(depth_z) = depth_z else {
        let names: Vec<_> = truth.channels.iter().map(|channel| channel.name.as_str()).collect();
        return Err(Error::unexpected(&path, format!("a channel `{DEPTH_CHANNEL}`"), names.join(", ")));
    };
    let raw = RawView {
        path,
        k: Matrix3::from_fn(|i, j| record.k[i][j]),
        k_convention: record.k_pixel_convention,
        distortion: record.distortion,
        world_from_cam: world_from_cam(&record),
        depth_z: Raster { width, height, data: depth_z.samples },
        depth_stored: depth_z.stored,
    };
    Ok((raw, slope.map(|channel| Raster { width, height, data: channel.samples })))
}

/// The pose as the record's matrix has it.
pub(super) fn world_from_cam(record: &CameraRecord) -> Matrix4<f64> {
    Matrix4::from_fn(|i, j| match record.world_from_cam.get(i) {
        Some(row) => row[j],
        None => f64::from(u8::from(j == 3)),
    })
}

/// The picture of a view under a light.
pub(super) fn read_picture(
    files: &Files<'_>,
    view: ViewName,
    light: u64,
    size: (usize, usize),
) -> Result<Picture, Error> {
    let file = image_name(view, light as usize);
    let path = files.place.path(&file);
    let picture = png::decode(&files.read(&file)?, &path)?;
    if matches!(picture, Picture::Rgb8(_)) {
        return Err(Error::unexpected(&path, "a grey picture", "a colour picture"));
    }
    check_size(&picture, size, &path)?;
    Ok(picture)
}

/// The masks of lit pixels that are there, light after light.
pub(super) fn read_lit(files: &Files<'_>, view: ViewName, lights: &[u64]) -> Result<Vec<Raster<u8>>, Error> {
    let names = lights.iter().map(|light| lit_name(view, *light as usize));
    let masks = names.filter(|name| files.place.has(name)).map(|name| {
        let path = files.place.path(&name);
        Ok(grey8(&png::decode(&files.read(&name)?, &path)?))
    });
    masks.collect()
}
