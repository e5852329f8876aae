//! Two pictures into terrain: features, matches, dense stereo, pointmaps, clouds and elevation models.
//!
//! Everything takes plain arrays, so that any matcher can feed it.
// Allowed in `dispatch` only, to call what was compiled for an instruction set that the machine has.
#![deny(unsafe_code)]

pub mod camera_file;
mod cloud;
mod dispatch;
mod error;
pub mod evidence;
pub mod exif;
pub mod features;
mod field;
pub mod frames;
pub mod grid;
pub mod hazard;
mod input_file;
mod judge;
pub mod learned;
pub mod matches_file;
pub mod matching;
pub mod pipeline;
mod prediction;
pub mod priors;
pub mod products;
pub mod reference;
pub mod refine;
pub mod relative_pose;
pub mod scale;
pub mod scene;
pub mod shading;
pub mod stereo;
mod subpixel;
pub mod transform_file;
mod triangulate;
mod view;

pub use error::Error;
pub use prediction::{Fill, NoPose, PredictedView, Prediction};
pub use view::View;
