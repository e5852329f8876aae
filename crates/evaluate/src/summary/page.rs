//! `report.html` of an evaluation: one page that holds everything.

use super::overview::{overview, overview_table};
use super::{MethodLines, Results};
use crate::Error;
use crate::dataset_source::Source;
use crate::figures::ItemFigures;
use crate::plots::Plot;
use crate::run::Completed;
use crate::table::marks;
use crate::worst::{failures, item_name, worst};
use selenograph_report::{Cell, Column, Figure, Page, Table, number};

/// More failures than this are counted, not listed.
const MAX_LISTED: usize = 200;
/// Plots before the fold: the pose errors in both forms, and the point errors.
const NUM_PLOTS_OPEN: usize = 3;
/// Columns of the worst items that tell of points.
const OF_POINTS: std::ops::Range<usize> = 4..6;
/// Worst items whose figures are before the fold.
const NUM_WORST_OPEN: usize = 1;

/// What the page is made of.
pub struct Contents<'a> {
    /// What was evaluated.
    pub source: &'a Source,
    /// What was done.
    pub completed: &'a Completed,
    /// The lines.
    pub methods: &'a [MethodLines],
    /// The tables.
    pub results: &'a Results,
    /// The plots.
    pub plots: &'a [Plot],
    /// Figures of the worst items.
    pub worst: &'a [ItemFigures],
    /// Figures of other items.
    pub figures: &'a [ItemFigures],
}

/// The page as HTML.
///
/// # Errors
/// [`Error::Report`] if a table cannot be put together.
pub fn page(contents: &Contents<'_>) -> Result<String, Error> {
    let Contents { source, completed, methods, results, plots, .. } = contents;
    let name = source.root.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut page = Page::new(format!("Evaluation of {name}"));
    page.lead(&format!(
        "{} pairs, {} items of {} methods; {} left out.",
        source.entries.len(),
        completed.num_items,
        methods.len(),
        completed.skipped.len()
    ));
    page.section("Summary");
    let (table, sentences) = overview_table(&overview(methods, contents.completed))?;
    page.table(&table).list(sentences);
    if let Some(told) = &source.pixels.told {
        page.warning(told);
    }
    add_worst(&mut page, contents)?;
    page.section("Plots");
    let drawn: Vec<Figure> = plots.iter().map(|plot| Figure::svg(plot.chart.svg(), &plot.caption)).collect();
    let (first, rest) = drawn.split_at(drawn.len().min(NUM_PLOTS_OPEN));
    page.figures(first);
    if !rest.is_empty() {
        page.folded(&format!("{} more plots", rest.len()), |page| {
            page.figures(rest);
        });
    }
    page.section("Tables").paragraph(marks());
    add_tables(&mut page, results)?;
    if !contents.figures.is_empty() {
        page.section("Figures");
        for item in contents.figures {
            page.folded(&item.name, |page| {
                page.figures(&item.page());
            });
        }
    }
    page.section("Failures and what was left out");
    add_failures(&mut page, contents);
    let settings = methods.iter().map(|method| (method.method.as_str(), method.settings.as_str()));
    page.section("Methods").definitions("How each works, with which settings", settings);
    Ok(page.finish())
}

/// Each table behind its title, then what all their columns are.
fn add_tables(page: &mut Page, results: &Results) -> Result<(), Error> {
    for table in results.all() {
        let shown = table.page()?;
        page.folded(&table.spec.title, |page| {
            page.table(&shown);
            for note in &table.spec.notes {
                page.paragraph(note);
            }
        });
    }
    let mut defined: Vec<(String, &str)> = Vec::new();
    for column in results.all().flat_map(|table| &table.spec.columns) {
        let one = (column.title(), column.definition.as_str());
        if !defined.contains(&one) {
            defined.push(one);
        }
    }
    page.definitions("What the columns are", defined.iter().map(|(head, text)| (head.as_str(), *text)));
    Ok(())
}

fn add_worst(page: &mut Page, contents: &Contents<'_>) -> Result<(), Error> {
    page.section("Worst pairs");
    for method in contents.methods.iter().filter(|m| m.method.looks_at_pictures()) {
        let worst = worst(method);
        // A method that gives a pose only has dashes in the columns of points.
        let has_points = worst.iter().any(|worst| worst.is_of_points);
        let is_shown = |column: &usize| has_points || !OF_POINTS.contains(column);
        let columns = ["item", "trajectory"].map(Column::text).into_iter();
        let numbers = ["RRA (°)", "RTA (°)", "point error", "coverage (%)", "overlap (%)", "altitude (km)"];
        let columns = columns.chain(numbers.map(Column::number)).enumerate();
        let title = format!("Worst of {}, one light of each pair", method.method.as_str());
        let mut table = Table::new("", columns.filter(|(k, _)| is_shown(k)).map(|(_, column)| column));
        for worst in worst {
            let (line, shown) = (worst.line, |value: Option<f64>, digits| {
                value.map_or("–".into(), |value| number::significant(value, digits))
            });
            let metrics = &line.metrics;
            let region = &metrics.overlap.numbers;
            let cells: [String; 8] = [
                item_name(line),
                line.item.trajectory.map_or("unknown", |t| t.as_str()).into(),
                shown(metrics.numbers.rra_deg, 3),
                shown(metrics.numbers.rta_deg, 3),
                shown(region.point_error_rel, 3),
                shown(region.coverage.map(|share| 100.0 * share), 3),
                shown(Some(100.0 * line.item.overlap_share), 3),
                shown(Some(line.item.altitude_m / 1e3), 3),
            ];
            let cells = cells.into_iter().enumerate().filter(|(k, _)| is_shown(k));
            table.row(cells.map(|(_, cell)| Cell::from(cell)))?;
        }
        page.folded(&title, |page| {
            page.table(&table);
        });
    }
    for (k, item) in contents.worst.iter().enumerate() {
        let figures = item.page();
        if k < NUM_WORST_OPEN {
            page.figures(&figures);
        } else {
            page.folded(&item.name, |page| {
                page.figures(&figures);
            });
        }
    }
    Ok(())
}

fn add_failures(page: &mut Page, contents: &Contents<'_>) {
    let list = |page: &mut Page, items: &[String]| {
        page.list(&items[..items.len().min(MAX_LISTED)]);
        if items.len() > MAX_LISTED {
            page.paragraph(&format!("and {} more", items.len() - MAX_LISTED));
        }
    };
    for method in contents.methods {
        let failed = failures(method);
        if failed.is_empty() {
            continue;
        }
        page.heading(&format!(
            "{}: {} of {} items without a pose",
            method.method.as_str(),
            failed.len(),
            method.lines.len()
        ));
        page.folded("which, and why", |page| list(page, &failed));
    }
    page.heading(&format!("{} left out", contents.completed.skipped.len()));
    list(page, &contents.completed.skipped);
}
