//! From gradients to weights.

mod adamw;
mod average;
mod clip;
mod scaling;
mod schedule;

pub use adamw::{AdamW, AdamWSettings, Moments, decays};
pub(crate) use average::WeightAverage;
pub use clip::{clip, norm, scale};
pub use scaling::LossScale;
pub use schedule::Schedule;
