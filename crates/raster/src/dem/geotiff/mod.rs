//! GeoTIFF, BigTIFF and cloud-optimised GeoTIFF: TIFF with a place on a map.

pub mod cog;
mod geokeys;
mod metadata;
mod write;
mod write_keys;

pub use crate::tiff::chunk::{Compression, Predictor};
pub use write::{GeoTiffLayout, GeoTiffWriter, WriteOptions};

use super::info::{DemFormat, DemInfo, OpenOptions, PixelIs, turned_to_raster};
use super::opened::{Opened, RowSource};
use crate::Error;
use crate::sample::HeightLaw;
use crate::tiff::directory::{Directory, TiffFile};
use crate::tiff::image::TiffBand;
use crate::tiff::layout::shape;
use crate::tiff::sidecar::Sidecar;
use crate::tiff::tags::*;
use geokeys::{GeoKeys, affine_of_tags};
use metadata::GdalMetadata;
use std::path::Path;

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Opened, Error> {
    let mut tiff = TiffFile::open(path)?;
    let directory = tiff.directory(tiff.first_directory)?;
    let shape = shape(&mut tiff, &directory)?;
    let band_idx = options.band_idx(path, shape.num_bands)?;
    let mut band = TiffBand::open(path, &directory, &shape, band_idx, options.nodata)?;

    let keys = GeoKeys::parse(
        &tiff.integers(&directory, GEO_KEY_DIRECTORY)?.unwrap_or_default(),
        &tiff.doubles(&directory, GEO_DOUBLE_PARAMS)?.unwrap_or_default(),
        &tiff.text(&directory, GEO_ASCII_PARAMS)?.unwrap_or_default(),
    );
    let mut map_from_pixel = map_from_pixel(&mut tiff, &directory, &keys, band.sidecar.as_ref())?;
    let crs = match options.given_crs(path)? {
        Some(crs) => crs,
        None => {
            // Longitudes of a geographic map count from its own meridian; a projection has it in its centre.
            map_from_pixel.coefficients[0] += keys.first_longitude_deg(path)?;
            keys.crs(path)?
        }
    };
    let crs = turned_to_raster(crs, &map_from_pixel, shape.width, shape.height);

    let metadata = GdalMetadata::parse(&tiff.text(&directory, GDAL_METADATA)?.unwrap_or_default(), band_idx);
    let metadata = metadata.overridden(band.sidecar.as_ref());
    let unit = match (options.height_unit, &metadata.unit) {
        (Some(unit), _) => unit,
        (None, Some(text)) => metadata::height_unit(path, text)?,
        (None, None) => keys.vertical_unit(path)?,
    };
    let law = HeightLaw::new(metadata.scale, metadata.offset, unit.metres(), crs.body.radius_m, &band.nodata);
    let mut notes = std::mem::take(&mut band.notes);
    notes.extend(band.presence.iter().map(|presence| format!("samples are absent by {}", presence.name)));
    let info = DemInfo {
        path: path.to_owned(),
        data_path: path.to_owned(),
        format: if tiff.big { DemFormat::BigTiff } else { DemFormat::GeoTiff },
        storage: band.storage.clone(),
        sample_type: band.sample_type,
        byte_order: tiff.order,
        width: shape.width,
        height: shape.height,
        num_bands: shape.num_bands,
        band: band_idx + 1,
        band_name: metadata.band_name,
        nodata: band.nodata.clone(),
        scale: metadata.scale,
        offset: metadata.offset,
        unit_m: unit.metres(),
        crs,
        crs_name: keys.citation().map(str::to_owned),
        map_from_pixel,
        pixel_is: if keys.is_point() { PixelIs::Point } else { PixelIs::Area },
        num_overviews: band.num_overviews,
        notes,
    };
    Ok(Opened { info, law, rows: RowSource::Tiff(Box::new(band)) })
}

fn map_from_pixel(
    tiff: &mut TiffFile,
    directory: &Directory,
    keys: &GeoKeys,
    sidecar: Option<&Sidecar>,
) -> Result<crate::Affine, Error> {
    let matrix = tiff.doubles(directory, MODEL_TRANSFORMATION)?;
    let scale = tiff.doubles(directory, MODEL_PIXEL_SCALE)?;
    let tie = tiff.doubles(directory, MODEL_TIEPOINT)?;
    let path = tiff.path.clone();
    let missing = |what: &str| Error::NoGeoreference { path: path.clone(), what: what.to_owned() };
    if let (None, None, Some(Sidecar { transform: Some(coefficients), .. })) = (&matrix, &scale, sidecar) {
        return Ok(crate::Affine::new(*coefficients));
    }
    let affine = affine_of_tags(matrix.as_deref(), scale.as_deref(), tie.as_deref()).ok_or_else(|| {
        missing(if tie.is_some() {
            "it has control points but no transform"
        } else {
            "it has no transform (neither pixel scale with tiepoint nor a matrix)"
        })
    })?;
    let unit = keys.map_unit(&path)?;
    let affine = crate::Affine::new(affine.coefficients.map(|a| a * unit));
    affine.inverse().map_err(|e| missing(&e.to_string()))?;
    Ok(if keys.is_point() { affine.pixel_from_grid() } else { affine })
}
