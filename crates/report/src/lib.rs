//! Self-contained HTML pages, SVG plots and pictures. Knows nothing of the field: what is shown comes in as values.
//!
//! A page holds everything it shows (pictures as base64, plots as SVG, its style and the script of the point view), so that it
//! opens from disk, prints, and can be sent as one file.
#![forbid(unsafe_code)]

mod base64;
pub mod chart;
pub mod color;
mod error;
mod escape;
pub mod figure;
pub mod number;
mod page;
mod points;
mod table;

pub use chart::{Axis, Chart};
pub use error::Error;
pub use figure::{Figure, Picture};
pub use page::Page;
pub use points::{Point, PointView};
pub use table::{Cell, Column, Table};
