//! `dem hillshade`: a shaded picture of an elevation model.

use super::reading::open;
use crate::args::dem::Hillshade;
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_files::FileKind;
use selenograph_raster::codec::png;
use selenograph_raster::dem::DemReader;
use selenograph_raster::{Raster, gradient, resample};
use serde::Serialize;

/// What was made.
#[derive(Serialize)]
struct Summary {
    width: usize,
    height: usize,
    /// Ground lengths of a pixel across and down, metres.
    cell_m: [f64; 2],
    /// Samples of the file along each side of a pixel.
    reduced_by: usize,
}

/// Shades and writes a PNG.
///
/// # Errors
/// A file that cannot be read, a target that cannot be written.
pub fn run(args: &Hillshade, ui: &Ui) -> anyhow::Result<Outcome> {
    if args.max_side < 3 {
        return Err(refuse("--max-side must be at least 3", "2048 is the default"));
    }
    let target = args.target.file(&FileKind::png("dem hillshade"))?;
    let mut reader = open(&args.file, &args.reading)?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let [x, y] = info.map_from_pixel.apply(width as f64 / 2.0, height as f64 / 2.0);
    let ground = info.crs.projection.ground_m_per_unit(x, y, info.crs.body.radius_m).ok_or_else(|| {
        refuse(
            format!("the middle of `{}` lies outside its map projection", args.file.display()),
            "check --crs",
        )
    })?;
    let [step_x, step_y] = info.map_from_pixel.steps();
    let factor = width.max(height).div_ceil(args.max_side);
    let heights = read_reduced(&mut reader, factor, ui)?;
    let cell_m = [step_x * ground[0] * factor as f64, step_y * ground[1] * factor as f64];
    let shade = gradient::horn(&heights, cell_m)
        .hillshade(args.azimuth_deg.to_radians(), args.elevation_deg.to_radians());
    // NaN becomes 0: absent ground is black.
    let picture = shade.map(|cosine| (255.0 * cosine.clamp(0.0, 1.0)).round() as u8);
    selenograph_files::write(target.path(), png::encode_grey8(&picture)?)?;
    if ui.json {
        let (width, height) = (picture.width, picture.height);
        ui.data_json(&Summary { width, height, cell_m, reduced_by: factor })?;
    }
    ui.note(&format!(
        "{} × {} pixels, {:.1} m each: {}",
        picture.width,
        picture.height,
        cell_m[0],
        args.target.out.display()
    ));
    Ok(Outcome::Done)
}

/// Block means of `factor × factor` samples, read in bands.
fn read_reduced(reader: &mut DemReader, factor: usize, ui: &Ui) -> anyhow::Result<Raster<f32>> {
    let (width, height) = (reader.info().width, reader.info().height);
    // Whole blocks, at least as many rows as a common tile has.
    let band_rows = factor * 256usize.div_ceil(factor);
    let bar = ui.bar(height as u64, "rows");
    let mut reduced = Raster::new(width.div_ceil(factor), 0, Vec::new())?;
    let mut band = Vec::new();
    for first in (0..height).step_by(band_rows) {
        let count = band_rows.min(height - first);
        reader.read_rows(first, count, &mut band)?;
        let block = resample::block_mean(&Raster::new(width, count, std::mem::take(&mut band))?, factor);
        reduced.height += block.height;
        reduced.data.extend(block.data);
        bar.inc(count as u64);
    }
    bar.finish_and_clear();
    Ok(reduced)
}
