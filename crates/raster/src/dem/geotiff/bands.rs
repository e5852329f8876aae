//! The bands of a TIFF as a picture: no georeference is needed.

use super::rows::TiffRows;
use super::{PHOTOMETRIC, layout, nodata, num_overviews, shape};
use crate::dem::geotiff::directory::TiffFile;
use crate::dem::sample::{HeightLaw, SampleType};
use crate::{Error, Raster};
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
    /// Bands in the file.
    pub(crate) num_bands: usize,
    /// Whether the smallest number is white.
    pub(crate) inverted: bool,
    /// How the file is stored, for people.
    pub(crate) storage: String,
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
                5 => "CMYK".to_owned(),
                6 => "YCbCr".to_owned(),
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
    num_overviews(&mut tiff, &directory, &shape)?;
    let nodata = nodata(&mut tiff, &directory)?;
    let law = HeightLaw::new(1.0, 0.0, 1.0, f64::INFINITY, &nodata);
    let mut bands = Vec::new();
    let mut described = None;
    for band_idx in 0..if colour { 3 } else { 1 } {
        // Each band has its own reader: a row of chunks is decoded once per band, and no more than that is held.
        let mut tiff = TiffFile::open(path)?;
        let layout = layout(&mut tiff, &directory, &shape, band_idx)?;
        described.get_or_insert_with(|| (layout.sample_type, super::storage_text(&layout, &shape)));
        let mut data = vec![f32::NAN; shape.width * shape.height];
        TiffRows::new(tiff, layout.with_thin_strips()).read(0, &law, &mut data)?;
        bands.push(Raster { width: shape.width, height: shape.height, data });
    }
    let (sample_type, storage) = described.unwrap_or((SampleType::U8, String::new()));
    let inverted = photometric == WHITE_IS_ZERO;
    Ok(TiffBands { bands, sample_type, num_bands: shape.num_bands, inverted, storage })
}
