//! Rasters of a grid as cloud-optimised GeoTIFF.

use super::Products;
use crate::Error;
use crate::cloud;
use crate::grid::{Dem, GridFrame};
use crate::hazard::Hazard;
use selenograph_raster::Raster;
use selenograph_raster::colormap::ABSENT;
use selenograph_raster::dem::cog::{self, ByteOverviews, CogClass, CogOptions, CogPlace, CogWriter};
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

/// The number of cells without a height in the hazard map.
const NO_HEIGHT: u8 = 0;

/// What the numbers of the hazard map mean.
fn meanings() -> Vec<CogClass> {
    let class = |number: u8, name: &str, color: [u8; 3]| CogClass { number, name: name.to_owned(), color };
    let told = Hazard::ALL.map(|hazard| class(hazard.code(), hazard.words(), hazard.color()));
    std::iter::once(class(NO_HEIGHT, "no height", ABSENT)).chain(told).collect()
}

/// The names of the classes, for the file beside the hazard map in which GIS programs look for them.
pub(super) fn class_names() -> String {
    cog::category_names(&meanings())
}

/// The classes of the hazard map; 0 where there is no height. In overviews the worst of four cells is kept.
pub(super) fn write_classes(path: &Path, dem: &Dem, classes: &Raster<Hazard>) -> Result<(), Error> {
    let options = CogOptions::classes("hazard", NO_HEIGHT, ByteOverviews::Largest, meanings());
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
