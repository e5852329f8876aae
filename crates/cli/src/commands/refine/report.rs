//! `report.html` of a sharpened elevation model.

use super::Answer;
use super::inputs::Pictures;
use crate::commands::figures::{self, HALF, name_of, shrunk};
use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, gradient};
use selenograph_reconstruct::refine::Refined;
use selenograph_report::figure::{ColorBar, Panel};
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Column, Figure, Page, Picture, Table};
use std::path::Path;

/// Slopes from here on have the brightest colour, degrees.
const STEEP_DEG: f64 = 40.0;
/// Light of the hillshades: from the upper left, as maps are shaded by custom, degrees.
const LIGHT_DEG: [f64; 2] = [315.0, 30.0];

/// Everything on one page.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn page(
    pictures: &Pictures,
    refined: &Refined,
    answer: &Answer,
    run_toml: &str,
) -> anyhow::Result<String> {
    let mut page = Page::new(format!("{}, sharpened", name_of(Path::new(&answer.dem))));
    page.lead(&answer.sentence());
    for note in &answer.notes {
        page.paragraph(note);
    }
    let [before, after] = [refined.given.heights(), &refined.heights].map(|heights| shaded(heights, refined));
    page.section("Before and after").figures(&[
        hillshade(&before, "Hillshade of the model as given", refined)?,
        hillshade(&after, "Hillshade, sharpened", refined)?,
        slope(&before, "Slope of the model as given", refined)?,
        slope(&after, "Slope, sharpened", refined)?,
    ]);
    page.section("What was changed").figures(&[
        signed(&refined.change, "Change", "change of the height (m)", refined)?,
        figures::albedo(&refined.albedo, |panel| as_map(panel, refined))?,
    ]);
    page.section("Pictures and model").table(&of_pictures(answer)?);
    for (k, (compared, path)) in refined.shaded.compared.iter().zip(&pictures.paths).enumerate() {
        let name = name_of(path);
        page.heading(&name);
        let [picture, model] = figures::picture_and_model(compared, HALF)?;
        page.figures(&[
            picture,
            model,
            signed(&refined.residuals[k], "Picture less model", "in the lit mean", refined)?,
        ]);
    }
    page.section("How this was made").listing("run.toml", run_toml);
    Ok(page.finish())
}

/// Slope in degrees and hillshade.
struct Shade {
    slope_deg: Raster<f32>,
    hillshade: Raster<f32>,
}

fn shaded(heights: &Raster<f32>, refined: &Refined) -> Shade {
    let cell = refined.given.cell_m();
    let gradient = gradient::horn(heights, [cell, cell]);
    let [azimuth, elevation] = LIGHT_DEG.map(f64::to_radians);
    Shade {
        slope_deg: gradient.slope_rad().map(|slope| slope.to_degrees()),
        hillshade: gradient.hillshade(azimuth, elevation),
    }
}

fn as_map(panel: Panel, refined: &Refined) -> Panel {
    panel.width(HALF).scale_bar(refined.given.cell_m() * refined.heights.width as f64, "m")
}

fn hillshade(shade: &Shade, title: &str, refined: &Refined) -> anyhow::Result<Figure> {
    let picture = Picture::exact(&shrunk(&Colormap::Grey.paint(&shade.hillshade, 0.0, 1.0)))?;
    Ok(Figure::svg(as_map(Panel::new(picture, title), refined).svg(), "Lit from the upper left."))
}

fn slope(shade: &Shade, title: &str, refined: &Refined) -> anyhow::Result<Figure> {
    let bar = ColorBar { map: Colormap::Inferno, low: 0.0, high: STEEP_DEG, label: "slope (°)".into() };
    let panel = as_map(Panel::of_values(&shrunk(&shade.slope_deg), title, bar)?, refined);
    Ok(Figure::svg(panel.svg(), "By Horn's 3×3 kernel on the grid."))
}

fn signed(values: &Raster<f32>, title: &str, label: &str, refined: &Refined) -> anyhow::Result<Figure> {
    let panel = figures::signed(values, title, label, |panel| as_map(panel, refined))?;
    Ok(Figure::svg(panel.svg(), "On the grid of the result."))
}

fn of_pictures(answer: &Answer) -> anyhow::Result<Table> {
    let mut table = Table::new(
        "",
        [
            Column::text("picture"),
            Column::number("correlation before")
                .defined("with a rendering of the model as given, in the octave that is likest"),
            Column::number("after").defined("with a rendering of the result, on its cells"),
            Column::number("residual")
                .defined("root mean square of picture less model, in the picture's lit mean"),
            Column::number("lit (%)"),
        ],
    );
    for picture in &answer.pictures {
        table.row([
            name_of(Path::new(&picture.picture)),
            fixed(picture.octaves.iter().map(|o| o.correlation).fold(0.0, f64::max), 3),
            fixed(picture.correlation, 3),
            significant(picture.residual_rms, 2),
            fixed(100.0 * picture.lit_share, 1),
        ])?;
    }
    Ok(table)
}
