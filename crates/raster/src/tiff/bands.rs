//! The bands of a TIFF as a picture: no georeference is needed.

use super::directory::TiffFile;
use super::image::TiffBand;
use super::layout::shape;
use super::presence::alpha_idx;
use super::tags::PHOTOMETRIC;
use crate::sample::{HeightLaw, SampleType};
use crate::{Error, Raster, bounds};
use std::path::Path;

/// A TIFF's photometric interpretations that are read here.
const WHITE_IS_ZERO: u64 = 0;
const BLACK_IS_ZERO: u64 = 1;
const RGB: u64 = 2;

/// The samples of a TIFF picture as stored, absent ones NaN.
#[derive(Debug)]
pub(crate) struct TiffBands {
    /// One band, or red, green and blue.
    pub(crate) bands: Vec<Raster<f32>>,
    pub(crate) sample_type: SampleType,
    /// Bands in the file, alpha not counted.
    pub(crate) num_bands: usize,
    /// Whether the smallest number is white.
    pub(crate) inverted: bool,
    /// How the file is stored and what had to be decided, for people.
    pub(crate) notes: Vec<String>,
}

/// Reads the first band, or the three of a colour picture.
///
/// `check_size` may refuse a size before memory is taken for it.
pub(crate) fn read(
    path: &Path,
    check_size: impl Fn(u64, u64) -> Result<(), Error>,
) -> Result<TiffBands, Error> {
    let mut tiff = TiffFile::open(path)?;
    let directory = tiff.directory(tiff.first_directory)?;
    let shape = shape(&mut tiff, &directory)?;
    check_size(shape.width as u64, shape.height as u64)?;
    let photometric = tiff.integer(&directory, PHOTOMETRIC)?.unwrap_or(BLACK_IS_ZERO);
    let colour = match photometric {
        WHITE_IS_ZERO | BLACK_IS_ZERO => false,
        RGB => shape.num_bands >= 3,
        other => {
            let found = match other {
                3 => "palette".to_owned(),
                4 => "a mask".to_owned(),
                5 => "CMYK".to_owned(),
                6 => "YCbCr".to_owned(),
                8 => "CIE L*a*b*".to_owned(),
                32803 => "colour filter array".to_owned(),
                _ => other.to_string(),
            };
            return Err(Error::Unsupported {
                path: path.to_owned(),
                what: "photometric interpretation",
                found,
                supported: "grey and RGB",
            });
        }
    };
    let bytes = bounds::product(&[shape.width as u64, shape.height as u64, size_of::<f32>() as u64]);
    bounds::check(path, "picture size", bytes, tiff.len)?;
    let alpha = alpha_idx(&mut tiff, &directory, &shape)?;
    let (mut bands, mut sample_type, mut notes) = (Vec::new(), SampleType::U8, Vec::new());
    for band_idx in 0..if colour { 3 } else { 1 } {
        // Each band has its own reader: a row of chunks is decoded once per band, and no more than that is held.
        let mut band = TiffBand::open(path, &directory, &shape, band_idx, None)?;
        if band_idx > 0 {
            // What is absent in one band is absent in their luma.
            band.presence.clear();
        }
        let law = HeightLaw::new(1.0, 0.0, 1.0, f64::INFINITY, &band.nodata);
        let mut data = vec![f32::NAN; shape.width * shape.height];
        band.read(0, &law, &mut data)?;
        bands.push(Raster { width: shape.width, height: shape.height, data });
        if band_idx == 0 {
            sample_type = band.sample_type;
            notes.push(band.storage);
            notes.append(&mut band.notes);
            let told = band.presence.iter().map(|p| (p.num_clear, p.name));
            notes.extend(told.map(|(clear, name)| format!("{clear} pixels are absent by {name}")));
        }
    }
    if alpha.is_some() {
        notes.push("alpha that is not 0 is left aside".to_owned());
    }
    let num_bands = shape.num_bands - usize::from(alpha.is_some());
    Ok(TiffBands { bands, sample_type, num_bands, inverted: photometric == WHITE_IS_ZERO, notes })
}
