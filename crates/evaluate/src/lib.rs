//! Predictions against truth: every metric with its definition, floors beside it, tables, plots and figures.
#![forbid(unsafe_code)]

pub mod agreement;
pub mod aligned;
pub mod alignment;
pub mod bootstrap;
pub mod calibration;
pub mod cloud;
pub mod dataset_source;
pub mod depth_error;
pub mod error;
pub mod figures;
pub mod hazard;
pub mod method;
pub mod pair_metrics;
pub mod paper;
pub mod plots;
pub mod point_error;
pub mod pose_error;
pub mod profile;
pub mod run;
pub mod slope;
pub mod ssim;
pub mod summary;
pub mod table;
pub mod truth;
pub mod worst;

pub use error::Error;
