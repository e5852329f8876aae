//! Tables whose columns say what they hold.

use crate::Error;
use crate::escape::escape;

/// A column.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Column {
    /// Heading, with the unit where there is one.
    pub name: String,
    /// What the numbers are; folded below the table.
    pub definition: Option<String>,
    /// Numbers stand on the right.
    pub numeric: bool,
}

impl Column {
    /// A column of words.
    pub fn text(name: impl Into<String>) -> Self {
        Self { name: name.into(), definition: None, numeric: false }
    }

    /// A column of numbers.
    pub fn number(name: impl Into<String>) -> Self {
        Self { name: name.into(), definition: None, numeric: true }
    }

    /// With its definition.
    pub fn defined(mut self, definition: impl Into<String>) -> Self {
        self.definition = Some(definition.into());
        self
    }
}

/// A cell.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cell {
    /// What it says.
    pub text: String,
    /// The best of its group: printed bold.
    pub best: bool,
    /// A second, smaller line, for example an interval.
    pub small: Option<String>,
}

impl Cell {
    /// Printed bold if it is the best.
    pub fn best_if(mut self, best: bool) -> Self {
        self.best = best;
        self
    }

    /// With a second, smaller line.
    pub fn with_small(mut self, small: impl Into<String>) -> Self {
        self.small = Some(small.into());
        self
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: text.into(), best: false, small: None }
    }
}

/// A table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    caption: String,
    columns: Vec<Column>,
    rows: Vec<Row>,
    is_defined_elsewhere: bool,
}

#[derive(Debug, Clone, PartialEq)]
enum Row {
    /// What the rows below have in common.
    Group(String),
    Cells(Vec<Cell>),
}

impl Table {
    /// An empty one.
    pub fn new(caption: impl Into<String>, columns: impl IntoIterator<Item = Column>) -> Self {
        Self {
            caption: caption.into(),
            columns: columns.into_iter().collect(),
            rows: Vec::new(),
            is_defined_elsewhere: false,
        }
    }

    /// Two columns without headings: names and values.
    pub fn of_facts<N: Into<String>, V: Into<Cell>>(
        caption: impl Into<String>,
        facts: impl IntoIterator<Item = (N, V)>,
    ) -> Self {
        let rows =
            facts.into_iter().map(|(name, value)| Row::Cells(vec![Cell::from(name.into()), value.into()]));
        Self {
            caption: caption.into(),
            columns: vec![Column::default(), Column::default()],
            rows: rows.collect(),
            is_defined_elsewhere: false,
        }
    }

    /// Adds a row.
    ///
    /// # Errors
    /// [`Error::RowLength`] unless there is one cell per column.
    pub fn row<C: Into<Cell>>(&mut self, cells: impl IntoIterator<Item = C>) -> Result<&mut Self, Error> {
        let cells: Vec<Cell> = cells.into_iter().map(Into::into).collect();
        if cells.len() != self.columns.len() {
            return Err(Error::RowLength {
                table: self.caption.clone(),
                expected: self.columns.len(),
                found: cells.len(),
            });
        }
        self.rows.push(Row::Cells(cells));
        Ok(self)
    }

    /// Begins a group of rows, with a heading of its own over all columns.
    pub fn group(&mut self, heading: impl Into<String>) -> &mut Self {
        self.rows.push(Row::Group(heading.into()));
        self
    }

    /// Leaves the definitions to the headings' tooltips and to a list that the page has once.
    pub fn defined_elsewhere(mut self) -> Self {
        self.is_defined_elsewhere = true;
        self
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// As HTML: a wide table scrolls below its first column, definitions are folded away.
    pub fn html(&self) -> String {
        let mut out = String::from("<div class=\"table\"><table>\n");
        if !self.caption.is_empty() {
            out += &format!("<caption>{}</caption>\n", escape(&self.caption));
        }
        if self.columns.iter().any(|column| !column.name.is_empty()) {
            let heads = self.columns.iter().map(|column| {
                let title = column.definition.as_ref().map(|d| format!(" title=\"{}\"", escape(d)));
                format!(
                    "<th{}{}>{}</th>",
                    class(column.numeric, false),
                    title.unwrap_or_default(),
                    escape(&column.name)
                )
            });
            out += &format!("<thead><tr>{}</tr></thead>\n", heads.collect::<String>());
        }
        out += "<tbody>\n";
        for row in &self.rows {
            let row = match row {
                Row::Cells(row) => row,
                Row::Group(heading) => {
                    let num = self.columns.len();
                    out += &format!(
                        "<tr class=\"group\"><th colspan=\"{num}\"><span>{}</span></th></tr>\n",
                        escape(heading)
                    );
                    continue;
                }
            };
            let cells = row.iter().zip(&self.columns).map(|(cell, column)| {
                let small = cell.small.as_ref().map(|s| format!("<small>{}</small>", escape(s)));
                format!(
                    "<td{}>{}{}</td>",
                    class(column.numeric, cell.best),
                    escape(&cell.text),
                    small.unwrap_or_default()
                )
            });
            out += &format!("<tr>{}</tr>\n", cells.collect::<String>());
        }
        out += "</tbody></table>\n";
        let defined: Vec<(&str, &str)> = self
            .columns
            .iter()
            .filter_map(|column| Some((column.name.as_str(), column.definition.as_deref()?)))
            .collect();
        if !defined.is_empty() && !self.is_defined_elsewhere {
            out += &definitions("What the columns are", defined);
        }
        out + "</div>\n"
    }
}

/// Words and what they mean, folded away.
pub(crate) fn definitions<'a>(
    summary: &str,
    defined: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> String {
    let lines = defined
        .into_iter()
        .map(|(name, definition)| format!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(definition)));
    format!(
        "<details><summary>{}</summary><dl class=\"definitions\">{}</dl></details>\n",
        escape(summary),
        lines.collect::<String>()
    )
}

fn class(numeric: bool, best: bool) -> &'static str {
    match (numeric, best) {
        (true, true) => " class=\"number best\"",
        (true, false) => " class=\"number\"",
        (false, true) => " class=\"best\"",
        (false, false) => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definitions_stand_below_and_text_is_escaped() {
        let columns = [Column::text("method"), Column::number("RRA (°)").defined("angle < 180°")];
        let mut table = Table::new("Pose & co", columns);
        table.row([Cell::from("sift"), Cell::from("0.01").best_if(true).with_small("0.00–0.02")]).unwrap();
        let html = table.html();
        for part in [
            "<caption>Pose &amp; co</caption>",
            "<td class=\"number best\">0.01<small>0.00–0.02</small></td>",
            "<dt>RRA (°)</dt><dd>angle &lt; 180°</dd>",
        ] {
            assert!(html.contains(part), "{part} in {html}");
        }
        assert!(!table.defined_elsewhere().html().contains("<dl"));
    }

    #[test]
    fn rows_have_one_cell_per_column() {
        let mut table = Table::new("t", [Column::text("a")]);
        assert!(table.row(["1", "2"]).is_err());
        assert!(table.is_empty());
        assert!(!Table::of_facts("f", [("name", "value")]).html().contains("<thead>"));
    }
}
