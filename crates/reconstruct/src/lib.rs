//! Two pictures into terrain: features, matches, dense stereo, pointmaps, clouds and elevation models.
//!
//! Everything takes plain arrays, so that any matcher can feed it.
#![forbid(unsafe_code)]

pub mod error;
pub mod frames;
pub mod prediction;
pub mod view;

pub use error::Error;
pub use prediction::{Fill, PredictedView, Prediction};
pub use view::View;
