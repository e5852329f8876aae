//! Rasters of a grid as cloud-optimised GeoTIFF.

use super::Products;
use crate::Error;
use crate::cloud;
use crate::grid::{Dem, GridFrame};
use crate::hazard::Hazard;
use selenograph_raster::Raster;
use selenograph_raster::dem::cog::{ByteOverviews, CogOptions, CogPlace, CogWriter};
use std::path::Path;

/// A raster of floats of a stated name and unit.
pub(super) fn write(
    path: &Path,
    products: &Products,
    raster: &Raster<f32>,
    name: &str,
    unit: &str,
) -> Result<(), Error> {
    let options = CogOptions::float(name, unit).with_nodata(products.nodata);
    let mut cog = CogWriter::create(path, raster.width, raster.height, &place(&products.dem), options)?;
    cog.write_rows(&raster.data)?;
    Ok(cog.finish()?)
}

/// The classes of the hazard map; 0 where there is no height. In overviews the worst of four cells is kept.
pub(super) fn write_classes(path: &Path, dem: &Dem, classes: &Raster<Hazard>) -> Result<(), Error> {
    let options = CogOptions::classes("hazard", 0, ByteOverviews::Largest);
    let mut cog = CogWriter::create(path, classes.width, classes.height, &place(dem), options)?;
    let codes = classes.data.iter().zip(&dem.heights.data);
    let codes: Vec<f32> =
        codes.map(|(class, h)| if h.is_nan() { f32::NAN } else { f32::from(class.code()) }).collect();
    cog.write_rows(&codes)?;
    Ok(cog.finish()?)
}

fn place(dem: &Dem) -> CogPlace {
    match &dem.frame {
        GridFrame::Map { crs, .. } => CogPlace::Map { crs: crs.clone(), map_from_pixel: dem.map_from_pixel },
        GridFrame::Local { metric, .. } => CogPlace::Local {
            name: cloud::describe(&dem.frame),
            metric: *metric,
            local_from_pixel: dem.map_from_pixel,
        },
    }
}

/// The unit of lengths, as files name it.
pub(super) fn length_unit(dem: &Dem) -> &'static str {
    if dem.frame.is_metric() { "m" } else { "baseline" }
}
