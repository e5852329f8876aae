//! Two pictures into terrain: features, matches, dense stereo, pointmaps, clouds and elevation models.
//!
//! Everything takes plain arrays, so that any matcher can feed it.
#![forbid(unsafe_code)]

pub mod cloud;
pub mod error;
pub mod frames;
pub mod grid;
pub mod hazard;
pub mod prediction;
pub mod scale;
pub mod view;

pub use error::Error;
pub use prediction::{Fill, PredictedView, Prediction};
pub use view::View;
