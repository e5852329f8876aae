//! The rasters of a sharpened elevation model.

use selenograph_raster::Raster;
use selenograph_raster::dem::cog::{CogOptions, CogPlace, CogWriter};
use selenograph_reconstruct::refine::Refined;
use std::path::Path;

/// Writes them into a folder as cloud-optimised GeoTIFF.
///
/// # Errors
/// Files that cannot be written.
pub fn write(folder: &Path, refined: &Refined, absent: Option<f32>) -> anyhow::Result<()> {
    let place =
        CogPlace::Map { crs: refined.given.crs().clone(), map_from_pixel: *refined.given.map_from_pixel() };
    let write = |file: &str, raster: &Raster<f32>, name: &str, unit: &str| -> anyhow::Result<()> {
        let options = CogOptions::float(name, unit).with_nodata(absent);
        let mut cog = CogWriter::create(&folder.join(file), raster.width, raster.height, &place, options)?;
        cog.write_rows(&raster.data)?;
        Ok(cog.finish()?)
    };
    write("dem.tif", &refined.heights, "height", "m")?;
    write("change.tif", &refined.change, "height less the height given", "m")?;
    write("albedo.tif", &refined.albedo, "albedo against the mean", "")?;
    for (k, residual) in refined.residuals.iter().enumerate() {
        write(&format!("residual_{}.tif", k + 1), residual, "picture less model, in the lit mean", "")?;
    }
    Ok(())
}
