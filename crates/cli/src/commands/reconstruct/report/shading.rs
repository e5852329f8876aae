//! Shading: pictures beside the model's, what is left of them, and what it changed.

use super::super::shading::PictureRecord;
use super::maps::as_map;
use crate::commands::figures::{self, HALF, shrunk};
use selenograph_raster::colormap::{ABSENT, Colormap};
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::Prediction;
use selenograph_reconstruct::grid::{self, GridOptions, lift};
use selenograph_reconstruct::pipeline::{Reconstruction, ShadedSurface};
use selenograph_reconstruct::products::{self, ALBEDO_NAME, OF_PICTURES, ProductOptions, Products};
use selenograph_report::chart::Chart;
use selenograph_report::color::series;
use selenograph_report::figure::Panel;
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Axis, Column, Figure, Page, Picture, Table};

/// Width of one of three figures in a row, CSS pixels.
const THIRD: f64 = 290.0;
/// Classes of slope in the plot of residuals, degrees.
const CLASS_DEG: f64 = 4.0;
/// Cells below which a class says nothing.
const MIN_CELLS: usize = 50;

/// What the section shows.
pub struct Section<'a> {
    pub used: &'a ShadedSurface,
    pub records: [&'a PictureRecord; 2],
    pub names: &'a [String; 2],
    pub found: &'a Reconstruction,
    pub made: &'a Products,
    pub options: &'a ProductOptions,
    pub unit: &'a str,
}

impl Section<'_> {
    /// Adds it to the page.
    ///
    /// # Errors
    /// Pictures that cannot be encoded.
    pub fn add_to(&self, page: &mut Page) -> anyhow::Result<()> {
        page.section("Shading").paragraph(
            "One surface whose renderings equal both pictures. What it does not explain is in the residuals: structure there is ground, light or a law that \
             the model does not have.",
        );
        page.table(&self.table()?);
        for (k, name) in self.names.iter().enumerate() {
            let compared = &self.used.shaded.compared[k];
            page.heading(name);
            let [picture, model] = figures::picture_and_model(compared, THIRD)?;
            let residual =
                figures::signed(&compared.residual(), "Picture less model", "in the lit mean", |panel| {
                    panel.width(THIRD).key(ABSENT, "not shown, dark or saturated")
                })?;
            page.figures(&[picture, model, Figure::svg(residual.svg(), "On the same cells.")]);
        }
        page.figure(&self.by_slope());
        let mut maps = vec![self.hillshade(&self.made.hillshade, "Hillshade with shading")?];
        if let Some(before) = self.before()? {
            maps.insert(0, self.hillshade(&before, "Hillshade of stereo alone")?);
        }
        if let Some(albedo) = self.layer(ALBEDO_NAME) {
            maps.push(figures::albedo(albedo, |panel| self.as_map(panel))?);
        }
        page.figures(&maps);
        Ok(())
    }

    fn table(&self) -> anyhow::Result<Table> {
        let columns = [
            Column::text("picture"),
            Column::number("correlation")
                .defined("of the picture with the model's, where both pictures show the ground"),
            Column::number("residual").defined("root mean square of picture less model, in the lit mean"),
            Column::number("gain").defined("grey level of ground of radiance factor 1"),
            Column::number("lit (%)"),
            Column::number("Sun (°)")
                .defined("above the horizon of the ground that the first camera looks at"),
            Column::number("turned (°)").defined("from the Sun that was given"),
        ];
        let mut table = Table::new("", columns);
        for (name, record) in self.names.iter().zip(self.records) {
            table.row([
                name.clone(),
                fixed(record.correlation, 4),
                significant(record.residual_rms, 2),
                significant(record.gain, 3),
                fixed(100.0 * record.lit_share, 1),
                record.sun_elevation_deg.map_or_else(|| "not known".to_owned(), |e| fixed(e, 2)),
                fixed(record.sun_turned_deg, 2),
            ])?;
        }
        Ok(table)
    }

    fn layer(&self, file: &str) -> Option<&Raster<f32>> {
        self.made.layers.iter().find(|layer| layer.file == file).map(|layer| &layer.values)
    }

    fn as_map(&self, panel: Panel) -> Panel {
        as_map(panel, self.made, self.unit)
    }

    fn hillshade(&self, values: &Raster<f32>, title: &str) -> anyhow::Result<Figure> {
        let picture = Picture::exact(&shrunk(&Colormap::Grey.paint(values, 0.0, 1.0)))?;
        let panel = self.as_map(Panel::new(picture, title)).width(HALF);
        Ok(Figure::svg(panel.svg(), "Lit from the upper left."))
    }

    /// The hillshade of what stereo said, on cells of the same size; `None` under two Suns.
    fn before(&self) -> anyhow::Result<Option<Raster<f32>>> {
        let Some(views) = &self.used.before else { return Ok(None) };
        let pose = self.found.prediction.cam_b_from_cam_a.clone();
        let prediction = Prediction { cam_b_from_cam_a: pose, views: Some(views.clone()) };
        let frame = &self.made.dem.frame;
        let lifted = lift::lift(&prediction, frame)?;
        let options = GridOptions { cell: Some(self.made.dem.cell), ..self.options.grid.clone() };
        let dem = grid::grid_lifted(frame.clone(), &lifted, &options)?;
        Ok(Some(products::shade(&dem, self.options).1))
    }

    /// Median and 90th percentile of what is left of each picture, over the slope of the ground.
    fn by_slope(&self) -> Figure {
        let slope = &self.made.slope_rad.data;
        let steepest = slope.iter().copied().filter(|s| s.is_finite()).fold(0.0f32, f32::max);
        let num_classes = (f64::from(steepest).to_degrees() / CLASS_DEG).ceil().max(1.0) as usize;
        let mut lines: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
        for (picture, [_, file]) in ["A", "B"].into_iter().zip(OF_PICTURES) {
            let Some(residual) = self.layer(file) else { continue };
            let mut classes = vec![Vec::new(); num_classes];
            for (residual, slope) in residual.data.iter().zip(slope) {
                if residual.is_finite() && slope.is_finite() {
                    let class = (f64::from(*slope).to_degrees() / CLASS_DEG) as usize;
                    classes[class.min(num_classes - 1)].push(f64::from(residual.abs()));
                }
            }
            let mut spread = [Vec::new(), Vec::new()];
            for (class, found) in classes.into_iter().enumerate() {
                let enough = found.len() >= MIN_CELLS;
                if let Some(values) = statistics::quantiles(found, [0.5, 0.9]).filter(|_| enough) {
                    let middle = (class as f64 + 0.5) * CLASS_DEG;
                    spread.iter_mut().zip(values).for_each(|(line, value)| line.push([middle, value]));
                }
            }
            let [median, p90] = spread;
            lines.push((format!("{picture}, median"), median));
            lines.push((format!("{picture}, 90th percentile"), p90));
        }
        let highest = lines.iter().flat_map(|(_, line)| line).map(|[_, y]| *y).fold(1e-6, f64::max);
        let x = Axis::new("slope (°)").between(0.0, num_classes as f64 * CLASS_DEG);
        let y = Axis::new("|picture less model| (lit mean)").between(0.0, 1.1 * highest);
        let mut chart = Chart::new("Residual against slope", x, y).size(1000.0, 320.0);
        for (k, (name, line)) in lines.into_iter().enumerate() {
            chart = chart.line(name, series(k), line.clone()).dots("", series(k), line);
        }
        Figure::svg(chart.svg(), "Where steep ground is left worse, its law or its shape is not right.")
    }
}
