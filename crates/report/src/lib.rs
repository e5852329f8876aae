//! Self-contained HTML pages, SVG plots and pictures. Knows nothing of the field: what is shown comes in as values.
//!
//! A page holds everything it shows (pictures as base64, plots as SVG, its style and the script of the point view), so that it
//! opens from disk, prints, and can be sent as one file.
#![forbid(unsafe_code)]

mod base64;
pub mod chart;
pub mod color;
mod escape;
pub mod figure;
pub mod number;
mod page;
mod points;
mod table;

pub use chart::{Axis, Chart};
pub use figure::{Figure, Picture};
pub use page::Page;
pub use points::{Point, PointView};
pub use table::{Cell, Column, Table};

/// What can go wrong when a report is put together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A picture that no format can hold.
    #[error("picture in a report: {0}")]
    Picture(#[from] selenograph_raster::Error),
    /// A table whose row has another number of cells than the table has columns.
    #[error("table `{table}`: a row of {found} cells, expected {expected}")]
    RowLength {
        /// The table's caption.
        table: String,
        /// Number of columns.
        expected: usize,
        /// Number of cells.
        found: usize,
    },
}

impl Error {
    /// What to do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Picture(error) => error.hint(),
            Self::RowLength { .. } => None,
        }
    }
}
