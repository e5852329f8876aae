//! Writes cloud-optimised GeoTIFFs of known content for `testdata/check_cog.py`: `write_cogs DIR`.

use selenograph_geometry::proj_string;
use selenograph_raster::dem::cog::{
    self, ByteOverviews, CogBand, CogClass, CogOptions, CogPlace, CogSamples, CogWriter,
};
use selenograph_raster::{Affine, Raster};
use std::path::PathBuf;

const WIDTH: usize = 1500;
const HEIGHT: usize = 1100;

/// Heights that the check computes again; every 97th sample is absent.
fn height(x: usize, y: usize) -> f32 {
    if (x + 31 * y).is_multiple_of(97) { f32::NAN } else { ((x * 7 + y * 13) % 5000) as f32 * 0.25 - 600.0 }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Some(dir) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err("usage: write_cogs DIR".into());
    };
    std::fs::create_dir_all(&dir)?;
    let raster = Raster::from_fn(WIDTH, HEIGHT, height);
    let map = |code: &str, x: f64, y: f64, step: f64| -> Result<CogPlace, selenograph_geometry::Error> {
        let map_from_pixel = Affine::north_up(x, y, step, step);
        Ok(CogPlace::Map { crs: proj_string::parse(code)?, map_from_pixel })
    };
    for (name, code, x, y, step) in [
        ("south", "IAU_2015:30135", 22_010.0, -12_010.0, 5.0),
        ("north", "IAU_2015:30130", -4000.0, 3000.0, 5.0),
        ("equirectangular", "IAU_2015:30110", 90_000.0, 790_000.0, 10.0),
        ("geographic", "IAU_2015:30100", 3.0, 27.0, 0.001),
        ("orthographic", "+proj=ortho +lat_0=23.7 +lon_0=-47.4 +R=1737400", -7500.0, 5500.0, 10.0),
    ] {
        let path = dir.join(format!("{name}.tif"));
        cog::write(&path, &raster, &map(code, x, y, step)?, CogOptions::float("height", "m"))?;
    }
    for (name, metric) in [("local", true), ("local_unscaled", false)] {
        let local_from_pixel = Affine::north_up(-750.0, 550.0, 1.0, 1.0);
        let place = CogPlace::Local { name: "Selenograph local grid".to_owned(), metric, local_from_pixel };
        cog::write(&dir.join(format!("{name}.tif")), &raster, &place, CogOptions::float("height", "m"))?;
    }
    let place = map("IAU_2015:30135", 22_010.0, -12_010.0, 5.0)?;
    let classes = raster.map(|h| if h.is_nan() { 255 } else { (h.abs() as u32 % 4) as u8 });
    let meanings: Vec<CogClass> =
        [("flat", [0, 158, 115]), ("steep", [213, 94, 0]), ("a & b", [240, 228, 66])]
            .into_iter()
            .zip(0u8..)
            .map(|((name, color), number)| CogClass { number, name: name.to_owned(), color })
            .collect();
    std::fs::write(dir.join("classes.tif.aux.xml"), cog::category_names(&meanings))?;
    let options = CogOptions::classes("hazard", 255, ByteOverviews::Mode, meanings);
    cog::write_classes(&dir.join("classes.tif"), &classes, &place, options)?;
    let bands = vec![CogBand::new("height", "m"), CogBand::new("sigma", "m")];
    let samples = CogSamples::Float32 { nodata: Some(-32_768.0) };
    let options = CogOptions { tile_side: 256, samples, bands, classes: vec![] };
    let mut writer = CogWriter::create(&dir.join("two_bands.tif"), WIDTH, HEIGHT, &place, options)?;
    for row in raster.rows() {
        writer.write_rows(&row.iter().flat_map(|h| [*h, h * 0.5]).collect::<Vec<f32>>())?;
    }
    writer.finish()?;
    Ok(())
}
