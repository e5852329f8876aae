//! PDS3 and PDS4: a label and an uncompressed image.

use super::found::{PictureFile, PictureFormat, checked_size, grey_of_bands, scaled_to_white, white_of};
use crate::dem::raw::{RawPicture, RawRows};
use crate::dem::{pds3, pds4};
use crate::sample::HeightLaw;
use crate::{Error, Raster};
use std::path::Path;

pub(super) fn read_pds3(path: &Path) -> Result<PictureFile, Error> {
    read(path, pds3::picture(path)?, PictureFormat::Pds3, read_band)
}

pub(super) fn read_pds4(path: &Path) -> Result<PictureFile, Error> {
    read(path, pds4::picture(path)?, PictureFormat::Pds4, read_band)
}

/// One band of an image that lies in lines.
pub(super) fn read_band(
    picture: &RawPicture,
    band_idx: usize,
    law: &HeightLaw,
) -> Result<Raster<f32>, Error> {
    let mut rows = RawRows::open(&picture.data_path, &picture.layout, band_idx)?;
    let mut band = Raster::filled(picture.layout.width, picture.layout.height, f32::NAN);
    rows.read(0, law, &mut band.data)?;
    Ok(band)
}

/// Reads what a label describes: three bands as colour (those of a cube are filters of any kind), else the first.
pub(super) fn read(
    path: &Path,
    mut picture: RawPicture,
    format: PictureFormat,
    read_band: impl Fn(&RawPicture, usize, &HeightLaw) -> Result<Raster<f32>, Error>,
) -> Result<PictureFile, Error> {
    let layout = &picture.layout;
    checked_size(&picture.data_path, layout.width as u64, layout.height as u64)?;
    let colour = layout.num_bands == 3 && format != PictureFormat::Isis;
    let bands = (0..if colour { 3 } else { 1 }).map(|band_idx| {
        let (scale, offset) = picture.law_of(band_idx);
        let law = HeightLaw::new(scale, offset, 1.0, f64::INFINITY, &picture.nodata);
        read_band(&picture, band_idx, &law)
    });
    let bands = bands.collect::<Result<Vec<_>, Error>>()?;
    let mut notes = std::mem::take(&mut picture.notes);
    let (mut grey, was_colour) = grey_of_bands(bands, picture.layout.num_bands, &mut notes);
    let sample_type = picture.layout.sample_type;
    let plain = picture.scale.iter().all(|scale| *scale == 1.0) && picture.offset.iter().all(|v| *v == 0.0);
    let white = match picture.white {
        _ if !plain => None,
        Some(white) => Some(white),
        None => white_of(sample_type, &grey, &mut notes),
    };
    let unit = scaled_to_white(&mut grey, white);
    let grey = picture.turn.apply(grey);
    notes.extend(picture.turn.note());
    Ok(PictureFile {
        path: path.to_owned(),
        data_path: picture.data_path,
        format,
        grey,
        unit,
        bits: 8 * sample_type.size() as u32,
        was_colour,
        notes,
    })
}
