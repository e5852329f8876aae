//! What the reports of `reconstruct` and `refine` share.

use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::shading::Compared;
use selenograph_report::figure::{ColorBar, Panel};
use selenograph_report::{Figure, Picture};
use std::path::Path;

/// Longest side of a map in a page, pixels: the files beside it have the full size.
const MAX_SIDE: usize = 1024;
/// Width of one of two figures in a row, CSS pixels.
pub const HALF: f64 = 400.0;
/// Every so many samples decide a scale of colours.
const SAMPLED: usize = 7;

/// The last part of a path.
pub fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Every so many pixels of a picture that is too large for a page.
pub fn shrunk<T: Copy>(raster: &Raster<T>) -> Raster<T> {
    let step = raster.width.max(raster.height).div_ceil(MAX_SIDE).max(1);
    Raster::from_fn(raster.width.div_ceil(step), raster.height.div_ceil(step), |x, y| {
        raster[(x * step, y * step)]
    })
}

/// Root of the mean square of the finite values; 0 without any.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let finite = values.into_iter().filter(|v| v.is_finite());
    let (count, sum) = finite.fold((0u64, 0.0), |(count, sum), v| (count + 1, sum + v * v));
    (sum / count.max(1) as f64).sqrt()
}

fn quantiles_of(values: &Raster<f32>, shares: [f64; 2]) -> Option<[f64; 2]> {
    statistics::quantiles(values.data.iter().step_by(SAMPLED).map(|v| f64::from(*v)), shares)
}

/// A picture and the model's, on one stretch.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn picture_and_model(compared: &Compared, width: f64) -> anyhow::Result<[Figure; 2]> {
    let [low, high] = quantiles_of(&compared.picture, [0.001, 0.999]).unwrap_or([0.0, 1.0]);
    let photo = |raster: &Raster<f32>, title: &str| -> anyhow::Result<Figure> {
        let picture = Picture::photo(&Colormap::Grey.paint(&shrunk(raster), low, high))?;
        let panel = Panel::new(picture, title).width(width);
        Ok(Figure::svg(panel.svg(), "On the cells of the surface, lit mean 1; one stretch for both."))
    };
    Ok([photo(&compared.picture, "The picture")?, photo(&compared.model, "The model's picture")?])
}

/// Values about zero, on a scale that holds nearly all of them; `dress` adds what the map has.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn signed(
    values: &Raster<f32>,
    title: &str,
    label: &str,
    dress: impl FnOnce(Panel) -> Panel,
) -> anyhow::Result<Panel> {
    let sampled = values.data.iter().step_by(SAMPLED).map(|v| f64::from(v.abs()));
    let [high] = statistics::quantiles(sampled, [0.995]).unwrap_or([1.0]);
    let high = high.max(1e-6);
    let bar = ColorBar { map: Colormap::Viridis, low: -high, high, label: label.into() };
    Ok(dress(Panel::of_values(&shrunk(values), title, bar)?))
}

/// A map of the albedo.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn albedo(values: &Raster<f32>, dress: impl FnOnce(Panel) -> Panel) -> anyhow::Result<Figure> {
    let [low, high] = quantiles_of(values, [0.002, 0.998]).unwrap_or([0.9, 1.1]);
    let bar = ColorBar { map: Colormap::Grey, low, high, label: "albedo against the mean".into() };
    let panel = dress(Panel::of_values(&shrunk(values), "Albedo", bar)?);
    Ok(Figure::svg(panel.svg(), "What brightness is left that shape does not explain."))
}
