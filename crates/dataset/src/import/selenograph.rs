//! Our own pair folders, read back.

use super::{RawView, StereoPair, StereoView, absent_as_nan, unexpected};
use crate::Error;
use crate::pair::{
    CameraRecord, PAIR_NAME, PairRecord, ViewName, camera_name, image_name, lit_name, read_json, truth_name,
};
use nalgebra::{Matrix3, Matrix4};
use selenograph_raster::Raster;
use selenograph_raster::codec::exr::ExrImage;
use selenograph_raster::codec::{Picture, exr, png};
use std::path::Path;

/// The channel of z-depth in a truth file.
pub const DEPTH_CHANNEL: &str = "depth_z";
/// The channel of slope in a truth file.
pub const SLOPE_CHANNEL: &str = "slope";

/// The geometry of one view.
///
/// # Errors
/// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for files that are missing, broken or of another size.
pub fn read_raw_view(folder: &Path, view: ViewName) -> Result<(RawView, CameraRecord), Error> {
    let (raw, record, _) = read_truth(folder, view)?;
    Ok((raw, record))
}

fn read_truth(folder: &Path, view: ViewName) -> Result<(RawView, CameraRecord, ExrImage), Error> {
    let record: CameraRecord = read_json(&folder.join(camera_name(view)))?;
    let path = folder.join(truth_name(view));
    let truth = exr::read(&path)?;
    let expected = (record.sensor.width_px, record.sensor.height_px);
    if (truth.width, truth.height) != expected {
        return Err(unexpected(
            &path,
            format!("{}×{} pixels, as the camera says", expected.0, expected.1),
            format!("{}×{}", truth.width, truth.height),
        ));
    }
    let channel = truth
        .channel(DEPTH_CHANNEL)
        .ok_or_else(|| unexpected(&path, format!("a channel `{DEPTH_CHANNEL}`"), channel_names(&truth)))?;
    let rows = record.world_from_cam;
    let raw = RawView {
        k: Matrix3::from_fn(|i, j| record.k[i][j]),
        k_convention: record.k_pixel_convention,
        distortion: record.distortion,
        world_from_cam: Matrix4::from_fn(|i, j| match rows.get(i) {
            Some(row) => row[j],
            None => f64::from(u8::from(j == 3)),
        }),
        depth_z: Raster { width: truth.width, height: truth.height, data: channel.samples.clone() },
        depth_stored: channel.stored,
        path,
    };
    Ok((raw, record, truth))
}

fn channel_names(image: &ExrImage) -> String {
    image.channels.iter().map(|channel| channel.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Both views with all pictures.
///
/// # Errors
/// Those of [`read_raw_view`], for every file of the pair.
pub fn read_pair(folder: &Path) -> Result<(StereoPair, PairRecord), Error> {
    let record: PairRecord = read_json(&folder.join(PAIR_NAME))?;
    let [a, b] = ViewName::BOTH.map(|view| read_view(folder, view, &record));
    Ok((StereoPair { pair_id: record.pair_id, views: [a?, b?] }, record))
}

fn read_view(folder: &Path, view: ViewName, pair: &PairRecord) -> Result<StereoView, Error> {
    let (raw, _, truth) = read_truth(folder, view)?;
    let lights = 0..pair.suns.len();
    let images = lights
        .clone()
        .map(|light_idx| read_grey8(&folder.join(image_name(view, light_idx))))
        .collect::<Result<_, _>>()?;
    let masks = lights.map(|light_idx| folder.join(lit_name(view, light_idx))).filter(|path| path.is_file());
    let lit = masks.map(|path| read_grey8(&path)).collect::<Result<_, _>>()?;
    let slope_rad = truth.channel(SLOPE_CHANNEL).map(|slope| Raster {
        width: truth.width,
        height: truth.height,
        data: slope.samples.clone(),
    });
    Ok(StereoView {
        name: format!("{:06} {}", pair.pair_id, view.as_str()),
        camera: raw.camera()?,
        world_from_cam: raw.world_from_cam()?,
        depth_z: absent_as_nan(&raw.depth_z),
        images,
        slope_rad,
        lit,
    })
}

/// A picture as 8-bit grey; 16 bits are scaled down and rounded.
fn read_grey8(path: &Path) -> Result<Raster<u8>, Error> {
    Ok(match png::read(path)? {
        Picture::Grey8(grey) => grey,
        Picture::Grey16(grey) => grey.map(|&level| ((u32::from(level) * 255 + 32_767) / 65_535) as u8),
        Picture::Rgb8(_) => return Err(unexpected(path, "a grey picture", "a colour picture")),
    })
}
