//! TIFF: the readers of elevation models, without their georeference.

use super::found::{PictureFile, PictureFormat, checked_size, grey_of_bands, scaled_to_white, white_of};
use crate::Error;
use crate::tiff::bands;
use std::path::Path;

pub(super) fn read(path: &Path) -> Result<PictureFile, Error> {
    let mut tiff = bands::read(path, |width, height| checked_size(path, width, height))?;
    let mut notes = std::mem::take(&mut tiff.notes);
    let (mut grey, was_colour) = grey_of_bands(tiff.bands, tiff.num_bands, &mut notes);
    let white = white_of(tiff.sample_type, &grey, &mut notes);
    let unit = scaled_to_white(&mut grey, white);
    if tiff.inverted {
        let top = if white.is_some() { 1.0 } else { 0.0 };
        grey.data.iter_mut().for_each(|level| *level = top - *level);
        notes.push("stored with white as zero, inverted".to_owned());
    }
    Ok(PictureFile {
        path: path.to_owned(),
        data_path: path.to_owned(),
        format: PictureFormat::Tiff,
        grey,
        unit,
        bits: 8 * tiff.sample_type.size() as u32,
        was_colour,
        notes,
    })
}
