//! Predictions against truth: every metric with its definition, floors beside it, tables, plots and figures.
#![forbid(unsafe_code)]

pub mod error;

pub use error::Error;
