//! Tables as text, Markdown, LaTeX, CSV, and for a page.

use super::{Cell, Column, Form, Row, RowKind, Table};
use crate::Error;
use crate::pair_metrics::Better;
use selenograph_report::{Cell as PageCell, Column as PageColumn, Table as PageTable, number};

/// Numbers nearer to zero than this are shown as zero: no metric here has meaning below it.
const NOTHING: f64 = 1e-9;

impl Column {
    /// Heading with arrow and unit.
    pub fn title(&self) -> String {
        let arrow = match self.better {
            Better::Up => " ↑",
            Better::Down => " ↓",
            Better::None => "",
        };
        if self.unit.is_empty() {
            format!("{}{arrow}", self.head)
        } else {
            format!("{} ({}){arrow}", self.head, self.unit)
        }
    }

    fn write(&self, value: f64) -> String {
        // Rounding of exact answers is no result.
        let value = if value.abs() < NOTHING { 0.0 } else { value };
        match self.form {
            Form::Fixed(decimals) => number::fixed(value, decimals),
            Form::Significant(digits) => number::significant(value, digits),
        }
    }

    fn interval(&self, cell: &Cell) -> Option<String> {
        let [low, high] = cell.estimate.interval?;
        // Where every geometry says the same there is nothing to show.
        if high - low <= NOTHING {
            return None;
        }
        Some(format!("{}–{}", self.write(low), self.write(high)))
    }
}

pub(super) fn reduction(cell: &Cell) -> Option<String> {
    let pct = cell.reduction_pct?;
    // What is left is told to one digit at least: 99.64 % is not all.
    let left = 100.0 - pct;
    let decimals = if left > 0.0 && left < 0.5 { (-left.log10()).ceil().clamp(1.0, 6.0) as usize } else { 0 };
    Some(format!("{}{} %", if pct < 0.0 { "+" } else { "−" }, number::fixed(pct.abs(), decimals)))
}

/// The two columns before the numbers, and how many items a row is of.
fn labels(row: &Row) -> [String; 3] {
    let count = match row.kind {
        RowKind::Published => "–".into(),
        _ => format!("{}/{}", row.num_items, row.num_geometries),
    };
    [row.class.clone(), row.name.clone(), count]
}

const LABELS: [&str; 3] = ["items", "method", "items/geometries"];
const MARKS: &str = "↑ more is better, ↓ less is better; bold (or *): best of the methods that see pictures only; intervals: 95 % \
                     bootstrap over distinct geometries; −x %: reduction against the first method; –: no number.";

impl Table {
    /// For a terminal: intervals and reductions in a line of their own below each row.
    pub fn text(&self) -> String {
        let mut grid: Vec<Vec<String>> = vec![
            LABELS
                .iter()
                .map(ToString::to_string)
                .chain(self.spec.columns.iter().map(Column::title))
                .collect(),
        ];
        let mut last_class = None;
        for row in &self.rows {
            let [class, name, count] = labels(row);
            let shown = if last_class == Some(&row.class) { String::new() } else { class };
            last_class = Some(&row.class);
            let (mut numbers, mut below) = (vec![shown, name, count], vec![String::new(); 3]);
            for (cell, column) in row.cells.iter().zip(&self.spec.columns) {
                let Some(cell) = cell else {
                    numbers.push("–".into());
                    below.push(String::new());
                    continue;
                };
                let star = if cell.is_best { "*" } else { "" };
                numbers.push(format!("{star}{}", column.write(cell.estimate.value)));
                let parts = [column.interval(cell), reduction(cell)];
                below.push(parts.into_iter().flatten().collect::<Vec<_>>().join(" "));
            }
            grid.push(numbers);
            if below.iter().any(|text| !text.is_empty()) {
                grid.push(below);
            }
        }
        let widths: Vec<usize> = (0..grid[0].len())
            .map(|k| grid.iter().map(|row| row[k].chars().count()).max().unwrap_or(0))
            .collect();
        let mut out = format!("{}\n\n", self.spec.title);
        for row in &grid {
            let cells = row.iter().zip(&widths).enumerate().map(|(k, (text, width))| {
                if k < 2 { format!("{text:<width$}") } else { format!("{text:>width$}") }
            });
            out += cells.collect::<Vec<_>>().join("  ").trim_end();
            out += "\n";
        }
        out += &format!("\n{MARKS}\n");
        for note in &self.spec.notes {
            out += &format!("{note}\n");
        }
        for column in &self.spec.columns {
            out += &format!("  {}: {}\n", column.title(), column.definition);
        }
        out
    }

    /// Markdown, definitions below.
    pub fn markdown(&self) -> String {
        let heads = LABELS.iter().map(ToString::to_string).chain(self.spec.columns.iter().map(Column::title));
        let heads: Vec<String> = heads.collect();
        let mut out = format!("### {}\n\n| {} |\n", self.spec.title, heads.join(" | "));
        out += &format!("| --- | --- | --- |{}\n", " ---: |".repeat(self.spec.columns.len()));
        for row in &self.rows {
            let cells = row.cells.iter().zip(&self.spec.columns).map(|(cell, column)| {
                let Some(cell) = cell else { return "–".to_owned() };
                let value = column.write(cell.estimate.value);
                let value = if cell.is_best { format!("**{value}**") } else { value };
                let interval = column.interval(cell).map(|interval| format!("[{interval}]"));
                let less = reduction(cell).map(|less| format!("({less})"));
                [Some(value), interval, less].into_iter().flatten().collect::<Vec<_>>().join(" ")
            });
            let cells: Vec<String> = labels(row).into_iter().chain(cells).collect();
            out += &format!("| {} |\n", cells.join(" | "));
        }
        out += &format!("\n{MARKS}\n");
        for note in &self.spec.notes {
            out += &format!("{note}\n");
        }
        out += "\n";
        for column in &self.spec.columns {
            out += &format!("- **{}**: {}\n", column.title(), column.definition);
        }
        out
    }

    /// LaTeX with the package `booktabs`.
    pub fn latex(&self) -> String {
        let heads = LABELS.iter().map(ToString::to_string).chain(self.spec.columns.iter().map(Column::title));
        let heads: Vec<String> = heads.map(|head| latex(&head)).collect();
        let mut out = format!(
            "% needs \\usepackage{{booktabs}}\n\\begin{{table}}\n\\caption{{{}}}\n\\begin{{tabular}}{{ll{}}}\n\\toprule\n{} \\\\\n",
            latex(&self.spec.title),
            "r".repeat(self.spec.columns.len() + 1),
            heads.join(" & ")
        );
        let mut last_class = None;
        for row in &self.rows {
            let is_new = last_class != Some(&row.class);
            last_class = Some(&row.class);
            out += if is_new { "\\midrule\n" } else { "" };
            let cells = row.cells.iter().zip(&self.spec.columns).map(|(cell, column)| {
                let Some(cell) = cell else { return "--".to_owned() };
                let value = latex(&column.write(cell.estimate.value));
                let value = if cell.is_best { format!("\\textbf{{{value}}}") } else { value };
                let interval = column.interval(cell).map(|text| format!("{{\\tiny [{}]}}", latex(&text)));
                let less = reduction(cell).map(|text| format!("{{\\tiny ({})}}", latex(&text)));
                [Some(value), interval, less].into_iter().flatten().collect::<Vec<_>>().join(" ")
            });
            let [class, name, count] = labels(row).map(|text| latex(&text));
            let class = if is_new { class } else { String::new() };
            let cells: Vec<String> = [class, name, count].into_iter().chain(cells).collect();
            out += &format!("{} \\\\\n", cells.join(" & "));
        }
        out + "\\bottomrule\n\\end{tabular}\n\\end{table}\n"
    }

    /// CSV with plain numbers: for each column the value, the ends of its interval, and the items it is of.
    pub fn csv(&self) -> String {
        let mut heads =
            vec!["class".to_owned(), "method".into(), "kind".into(), "items".into(), "geometries".into()];
        for column in &self.spec.columns {
            let name = if column.unit.is_empty() {
                column.head.clone()
            } else {
                format!("{} ({})", column.head, column.unit)
            };
            heads.extend(["", " low", " high", " items"].map(|part| format!("{name}{part}")));
        }
        let quoted = |text: &String| format!("\"{}\"", text.replace('"', "\"\""));
        let mut out = heads.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            let kind = match row.kind {
                RowKind::Method => "method",
                RowKind::Anchor => "anchor",
                RowKind::Published => "published",
            };
            let mut cells = vec![quoted(&row.class), quoted(&row.name), kind.into()];
            cells.extend([row.num_items.to_string(), row.num_geometries.to_string()]);
            for cell in &row.cells {
                match cell {
                    None => cells.extend(std::iter::repeat_n(String::new(), 4)),
                    Some(cell) => {
                        let ends = cell.estimate.interval.map(|ends| ends.map(|end| end.to_string()));
                        let [low, high] = ends.unwrap_or_default();
                        let items = cell.estimate.num_items.to_string();
                        cells.extend([cell.estimate.value.to_string(), low, high, items]);
                    }
                }
            }
            out += &(cells.join(",") + "\n");
        }
        out
    }

    /// For a page, which has the definitions of all its tables in one list.
    ///
    /// # Errors
    /// [`Error::Report`] if a row has another number of cells than there are columns, which no table made here has.
    pub fn page(&self) -> Result<PageTable, Error> {
        let labels_of = LABELS[1..].iter().map(|label| PageColumn::text(*label));
        // A column or row in which nothing is known says nothing.
        let is_known = |k: &usize| self.rows.iter().any(|row| row.cells[*k].is_some());
        let known: Vec<usize> = (0..self.spec.columns.len()).filter(is_known).collect();
        let columns = known.iter().map(|k| &self.spec.columns[*k]);
        let heads =
            columns.map(|column| PageColumn::number(column.title()).defined(column.definition.clone()));
        let mut table = PageTable::new(self.spec.title.clone(), labels_of.chain(heads)).defined_elsewhere();
        let mut last_class = None;
        for row in self.rows.iter().filter(|row| row.cells.iter().any(Option::is_some)) {
            if last_class != Some(&row.class) {
                table.group(&row.class);
                last_class = Some(&row.class);
            }
            let numbers = known.iter().map(|k| {
                let (Some(cell), column) = (&row.cells[*k], &self.spec.columns[*k]) else {
                    return PageCell::from("–");
                };
                let page_cell = PageCell::from(column.write(cell.estimate.value)).best_if(cell.is_best);
                let parts = [column.interval(cell), reduction(cell)];
                let small = parts.into_iter().flatten().collect::<Vec<_>>().join(" ");
                if small.is_empty() { page_cell } else { page_cell.with_small(small) }
            });
            let [_, name, count] = labels(row).map(PageCell::from);
            table.row([name, count].into_iter().chain(numbers))?;
        }
        Ok(table)
    }
}

/// What a reader of the tables has to know.
pub fn marks() -> &'static str {
    MARKS
}

/// Text for LaTeX.
fn latex(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '%' | '_' | '&' | '#' | '$' | '{' | '}' => out.extend(['\\', c]),
            '↑' => out += "$\\uparrow$",
            '↓' => out += "$\\downarrow$",
            '°' => out += "$^\\circ$",
            'δ' => out += "$\\delta$",
            '<' => out += "$<$",
            '−' => out += "$-$",
            '–' => out += "--",
            '∞' => out += "$\\infty$",
            c => out.push(c),
        }
    }
    out
}
