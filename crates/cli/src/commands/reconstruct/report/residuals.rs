//! The residuals against an elevation model: by slope, and whether their sigma is honest.

use super::super::reference::Record;
use selenograph_reconstruct::reference::{GAUSSIAN, Spread};
use selenograph_report::chart::Chart;
use selenograph_report::color::series;
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Axis, Column, Figure, Table};

/// What was compared with what, and what the numbers can tell.
pub fn sentence(reference: &Record) -> String {
    let residuals = &reference.residuals;
    let witness = match reference.placed_by_it {
        true => {
            "The answer was laid onto this model, so it is no independent witness of place and size: offset and tilt are small by construction."
        }
        false => "The model took no part in the answer.",
    };
    format!(
        "{} measured cells against `{}` (cells of {} m). {witness} The heights lie {} m {} it in the median; the plane through the residuals is tilted by {}°. Relief finer than the model's cells counts as error here.",
        residuals.num_cells,
        reference.file,
        significant(residuals.reference_cell_m, 3),
        significant(residuals.offset_m.abs(), 2),
        if residuals.offset_m < 0.0 { "under" } else { "over" },
        significant(residuals.tilt_deg, 2)
    )
}

/// Median and 90th percentile of the absolute residual over the slope.
pub fn by_slope(reference: &Record) -> Figure {
    let classes = &reference.residuals.by_slope;
    let middle = |from: f64, to: f64| 0.5 * (from + to);
    let line = |of: fn(&selenograph_reconstruct::reference::SlopeClass) -> f64| {
        classes.iter().map(|class| [middle(class.from_deg, class.to_deg), of(class)]).collect::<Vec<_>>()
    };
    let (median, p90) = (line(|class| class.median_m), line(|class| class.p90_m));
    let steepest = classes.last().map_or(1.0, |class| class.to_deg);
    let highest = p90.iter().map(|[_, p90]| *p90).fold(0.0, f64::max);
    let x = Axis::new("slope of the reference (°)").between(0.0, steepest);
    let y = Axis::new("|height residual| (m)").between(0.0, 1.1 * highest.max(f64::MIN_POSITIVE));
    let chart = Chart::new("Residual against slope", x, y)
        .size(1000.0, 320.0)
        .line("median", series(0), median.clone())
        .dots("", series(0), median)
        .line("90th percentile", series(1), p90.clone())
        .dots("", series(1), p90);
    let witness =
        if reference.placed_by_it { " The model also placed the answer: not independent." } else { "" };
    Figure::svg(
        chart.svg(),
        &format!("Classes of 5°, a plane through the residuals taken off: what is left is shape.{witness}"),
    )
}

/// The shares within one, two and three sigma, beside those of a normal distribution.
pub fn shares(reference: &Record) -> anyhow::Result<Table> {
    let columns = ["residual", "median (m)", "90 % (m)", "within 1 sigma", "2 sigma", "3 sigma"];
    let [first, rest @ ..] = columns;
    let columns = [Column::text(first)].into_iter().chain(rest.map(Column::number));
    let mut table = Table::new(
        "Sigma is what the matching itself can tell: an error of pose and size is not in it, and shows as a plane.",
        columns,
    );
    let percent = |share: f64| format!("{} %", fixed(100.0 * share, 1));
    let row = |name: &str, spread: &Spread| {
        let shares =
            spread.within_sigma.map_or_else(|| [(); 3].map(|()| "no sigma".to_owned()), |s| s.map(percent));
        let sizes = [spread.median_m, spread.p90_m].map(|size| significant(size, 3));
        [name.to_owned()].into_iter().chain(sizes).chain(shares).collect::<Vec<_>>()
    };
    table.row(row("as placed", &reference.residuals.as_placed))?;
    table.row(row("a plane taken off", &reference.residuals.levelled))?;
    let expected = [0.6745, 1.6449].map(|sigmas| format!("{} sigma", fixed(sigmas, 2)));
    let gaussian =
        ["normal distribution".to_owned()].into_iter().chain(expected).chain(GAUSSIAN.map(percent));
    table.row(gaussian.collect::<Vec<_>>())?;
    Ok(table)
}
