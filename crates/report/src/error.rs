//! What can go wrong when a report is put together.

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
