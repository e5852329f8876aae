//! Predictions against truth: every metric with its definition, floors beside it, tables, plots and figures.
#![forbid(unsafe_code)]

mod agreement;
mod aligned;
mod alignment;
mod bootstrap;
mod calibration;
mod cloud;
pub mod dataset_source;
mod depth_error;
mod error;
mod figures;
mod hazard;
pub mod method;
pub mod pair_metrics;
mod paper;
mod plots;
mod point_error;
mod pose_error;
mod profile;
pub mod run;
mod slope;
mod ssim;
pub mod summary;
mod table;
pub mod truth;
mod worst;

pub use error::Error;
pub use figures::ItemFigures;
pub use plots::{Plot, plots};
pub use ssim::ssim;
pub use worst::{Worst, worst};
