//! Tables: classes of items in groups of rows, methods as rows, quantities as columns; anchors and published numbers beside.

mod render;
pub(crate) mod specs;

pub(crate) use render::marks;
pub use specs::{Column, Form, Spec};

use crate::bootstrap::Estimate;
use crate::pair_metrics::Better;
use crate::run::Line;
use crate::summary::classes::has_an_answer;
use crate::summary::{Breakdown, MethodLines, Quantity, estimate_of};
use serde::Serialize;

/// What a row is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RowKind {
    /// A method that is compared.
    Method,
    /// A method that looks at the truth, or the floors and ceilings of the definitions.
    Anchor,
    /// Numbers from elsewhere, on other pairs.
    Published,
}

/// A cell with a number, in the column's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cell {
    /// The number with its interval.
    pub estimate: Estimate,
    /// Whether it is the best of its class.
    pub is_best: bool,
    /// How much less than the first method's, percent.
    pub reduction_pct: Option<f64>,
}

/// A row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The class of its items.
    pub class: String,
    /// The method, or what else it is.
    pub name: String,
    /// What it is.
    pub kind: RowKind,
    /// Items of the class.
    pub num_items: usize,
    /// Geometries among them.
    pub num_geometries: usize,
    /// One per column.
    pub cells: Vec<Option<Cell>>,
}

/// A table with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// What it shows.
    pub spec: Spec,
    /// Its rows, class by class.
    pub rows: Vec<Row>,
}

/// Name of the row of floors and ceilings.
const ANCHOR_ROW: &str = "floor / ceiling";

impl Table {
    /// Computes a table: the classes of a breakdown, and all together if there are several. Items without an answer (no common
    /// ground, the same view twice) are left out.
    pub fn build(spec: Spec, breakdown: Breakdown, methods: &[MethodLines]) -> Self {
        let first = methods.first().map(|m| m.lines.as_slice()).unwrap_or_default();
        let classes: Vec<String> = breakdown
            .split(first.iter().filter(|line| has_an_answer(&line.item)))
            .into_iter()
            .map(|(name, _)| name)
            .collect();
        let mut rows = Vec::new();
        for class in &classes {
            rows.extend(class_rows(&spec, class, methods, |line| breakdown.class_of(&line.item).1 == *class));
        }
        if classes.len() > 1 {
            rows.extend(class_rows(&spec, "all", methods, |_| true));
        }
        Self { spec, rows }
    }

    /// The items whose right answer is "cannot say", by trajectory; `None` where there are none.
    pub fn of_hard_cases(methods: &[MethodLines]) -> Option<Self> {
        let hard: Vec<MethodLines> = methods
            .iter()
            .map(|m| MethodLines {
                method: m.method,
                settings: m.settings.clone(),
                lines: m.lines.iter().filter(|line| !has_an_answer(&line.item)).cloned().collect(),
            })
            .collect();
        let classes = Breakdown::Trajectory.split(&hard.first()?.lines);
        let spec = specs::hard_cases();
        let mut rows = Vec::new();
        for (class, _) in &classes {
            for m in &hard {
                let lines: Vec<&Line> =
                    m.lines.iter().filter(|l| Breakdown::Trajectory.class_of(&l.item).1 == *class).collect();
                let quantities = spec.columns.iter().map(|column| Some(&column.quantity));
                rows.push(row(class, m.method.as_str(), RowKind::Method, &lines, quantities, &spec));
            }
        }
        (!rows.is_empty()).then_some(Self { spec, rows })
    }

    /// Whether no cell of a method has a number.
    pub fn is_empty(&self) -> bool {
        self.rows
            .iter()
            .filter(|row| row.kind != RowKind::Published)
            .all(|row| row.cells.iter().all(Option::is_none))
    }
}

/// The rows of one class.
fn class_rows(spec: &Spec, class: &str, methods: &[MethodLines], is_in: impl Fn(&Line) -> bool) -> Vec<Row> {
    let chosen: Vec<(&MethodLines, Vec<&Line>)> = methods
        .iter()
        .map(|m| (m, m.lines.iter().filter(|line| has_an_answer(&line.item) && is_in(line)).collect()))
        .collect();
    let mut rows: Vec<Row> = chosen
        .iter()
        .map(|(method, lines)| {
            let kind = if method.method.looks_at_pictures() { RowKind::Method } else { RowKind::Anchor };
            let quantities = spec.columns.iter().map(|column| Some(&column.quantity));
            row(class, method.method.as_str(), kind, lines, quantities, spec)
        })
        .collect();
    mark_best(spec, &mut rows);
    tell_reductions(spec, &mut rows);
    // Floors and ceilings belong to the truth: every method's lines hold the same ones, if they hold any.
    let num_anchored = |lines: &[&Line]| {
        let has = |line: &&&Line| spec.columns.iter().any(|c| c.anchor.is_some_and(|a| a.of(line).is_some()));
        lines.iter().filter(has).count()
    };
    let anchored = chosen.iter().map(|(_, lines)| lines).max_by_key(|lines| num_anchored(lines));
    if let Some(lines) = anchored.filter(|lines| num_anchored(lines) > 0) {
        let anchors = spec.columns.iter().map(|column| column.anchor.as_ref());
        rows.push(row(class, ANCHOR_ROW, RowKind::Anchor, lines, anchors, spec));
    }
    rows.extend(published_rows(spec, class));
    rows
}

fn row<'a>(
    class: &str,
    name: &str,
    kind: RowKind,
    lines: &[&Line],
    quantities: impl Iterator<Item = Option<&'a Quantity>>,
    spec: &Spec,
) -> Row {
    let geometries: std::collections::BTreeSet<&str> =
        lines.iter().map(|line| line.item.pair.as_str()).collect();
    let cells = quantities.zip(&spec.columns).map(|(quantity, column)| {
        let mut estimate = estimate_of(lines.iter().copied(), quantity?)?;
        estimate.value *= column.factor;
        estimate.interval = estimate.interval.map(|ends| ends.map(|end| end * column.factor));
        Some(Cell { estimate, is_best: false, reduction_pct: None })
    });
    Row {
        class: class.to_owned(),
        name: name.to_owned(),
        kind,
        num_items: lines.len(),
        num_geometries: geometries.len(),
        cells: cells.collect(),
    }
}

/// Marks the best of the compared methods in each column (all of them, where several are equal); a method alone is not best.
fn mark_best(spec: &Spec, rows: &mut [Row]) {
    if rows.iter().filter(|row| row.kind == RowKind::Method).count() < 2 {
        return;
    }
    for (k, column) in spec.columns.iter().enumerate() {
        let values = rows
            .iter()
            .filter(|row| row.kind == RowKind::Method)
            .filter_map(|row| Some(row.cells[k]?.estimate.value));
        let best = match column.better {
            Better::Up => values.fold(f64::NEG_INFINITY, f64::max),
            Better::Down => values.fold(f64::INFINITY, f64::min),
            Better::None => continue,
        };
        for row in rows.iter_mut().filter(|row| row.kind == RowKind::Method) {
            if let Some(cell) = &mut row.cells[k] {
                cell.is_best = cell.estimate.value == best;
            }
        }
    }
}

/// How much less than the first compared method's.
fn tell_reductions(spec: &Spec, rows: &mut [Row]) {
    let mut methods = rows.iter_mut().filter(|row| row.kind == RowKind::Method);
    let Some(first) = methods.next().map(|row| row.cells.clone()) else { return };
    for row in methods {
        for ((cell, first), column) in row.cells.iter_mut().zip(&first).zip(&spec.columns) {
            let (Some(cell), Some(first), true) = (cell, first, column.has_reduction) else { continue };
            if first.estimate.value > 0.0 {
                cell.reduction_pct = Some(100.0 * (1.0 - cell.estimate.value / first.estimate.value));
            }
        }
    }
}

/// The published rows of a class of a table.
fn published_rows(spec: &Spec, class: &str) -> Vec<Row> {
    let of_class = spec.published.iter().filter(|row| row.class == class);
    of_class
        .map(|row| {
            let cells = spec.columns.iter().map(|column| {
                let (_, value) = row.values.iter().find(|(head, _)| *head == column.head)?;
                let estimate = Estimate { value: *value, interval: None, num_items: 0, num_geometries: 0 };
                Some(Cell { estimate, is_best: false, reduction_pct: None })
            });
            Row {
                class: class.to_owned(),
                name: row.name.to_owned(),
                kind: RowKind::Published,
                num_items: 0,
                num_geometries: 0,
                cells: cells.collect(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests;
