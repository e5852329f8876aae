//! Pictures in rows and columns with titles: methods side by side.

use super::panel::{BESIDE, ColorBar};
use super::{Picture, image, open_svg};
use crate::escape::escape;

/// Pictures in rows and columns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    columns: Vec<String>,
    rows: Vec<Row>,
    cell: f64,
}

#[derive(Debug, Clone, PartialEq)]
struct Row {
    title: String,
    /// The column of the first picture: those before it stay blank.
    first: usize,
    pictures: Vec<Option<Picture>>,
    bar: Option<ColorBar>,
}

impl Grid {
    /// An empty one with these titles above its columns; cells `cell` CSS pixels wide.
    pub fn new(columns: impl IntoIterator<Item = impl Into<String>>, cell: f64) -> Self {
        Self { columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new(), cell }
    }

    /// Adds a row; where a picture is absent its cell says so.
    pub fn row(&mut self, title: impl Into<String>, pictures: Vec<Option<Picture>>) -> &mut Self {
        self.row_from(0, title, pictures, None)
    }

    /// Adds a row that begins in column `first`, with a bar that says what its colours mean.
    pub fn row_from(
        &mut self,
        first: usize,
        title: impl Into<String>,
        pictures: Vec<Option<Picture>>,
        bar: Option<ColorBar>,
    ) -> &mut Self {
        self.rows.push(Row { title: title.into(), first, pictures, bar });
        self
    }

    /// The drawing.
    pub fn svg(&self) -> String {
        const GAP: f64 = 6.0;
        const TOP: f64 = 22.0;
        let left = if self.rows.iter().all(|row| row.title.is_empty()) { 0.0 } else { 20.0 };
        let heights: Vec<f64> = self.rows.iter().map(|row| self.row_height(&row.pictures)).collect();
        let right = left + self.columns.len() as f64 * (self.cell + GAP);
        let beside = if self.rows.iter().any(|row| row.bar.is_some()) { BESIDE } else { 0.0 };
        let mut out = open_svg(right + beside, TOP + heights.iter().map(|h| h + GAP).sum::<f64>());
        out += "<g text-anchor=\"middle\">\n";
        for (k, title) in self.columns.iter().enumerate() {
            let x = left + k as f64 * (self.cell + GAP) + self.cell / 2.0;
            out += &format!("<text x=\"{x:.1}\" y=\"14\" font-weight=\"600\">{}</text>\n", escape(title));
        }
        let mut y = TOP;
        for (row, height) in self.rows.iter().zip(&heights) {
            let middle = y + height / 2.0;
            out += &format!(
                "<text x=\"13\" y=\"{middle:.1}\" transform=\"rotate(-90 13 {middle:.1})\">{}</text>\n",
                escape(&row.title)
            );
            for (k, picture) in row.pictures.iter().enumerate() {
                let x = left + (row.first + k) as f64 * (self.cell + GAP);
                out += &match picture {
                    Some(picture) => image(picture, x, y, self.cell, self.cell * aspect(picture)),
                    None => format!(
                        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{0:.1}\" height=\"{height:.1}\" class=\"blank\" fill=\"#efefea\"/>\
                         <text x=\"{1:.1}\" y=\"{middle:.1}\" fill=\"#77777f\">no answer</text>\n",
                        self.cell,
                        x + self.cell / 2.0
                    ),
                };
            }
            if let Some(bar) = &row.bar {
                out += &format!("<g text-anchor=\"start\">\n{}</g>\n", bar.svg(right + 4.0, y, *height));
            }
            y += height + GAP;
        }
        out + "</g>\n</svg>\n"
    }

    fn row_height(&self, pictures: &[Option<Picture>]) -> f64 {
        let tallest = pictures.iter().flatten().map(aspect).fold(0.0, f64::max);
        if tallest > 0.0 { tallest * self.cell } else { self.cell / 3.0 }
    }
}

fn aspect(picture: &Picture) -> f64 {
    picture.height as f64 / picture.width.max(1) as f64
}
