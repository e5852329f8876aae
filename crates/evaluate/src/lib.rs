//! Predictions against truth: every metric with its definition, floors beside it, tables, plots and figures.
#![forbid(unsafe_code)]

pub mod error;
pub mod pair_metrics;
pub mod pose_error;
pub mod truth;

pub use error::Error;
