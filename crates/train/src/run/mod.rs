//! The run: steps, checkpoints, curves.

mod budget;
pub mod checkpoint;
pub mod feed;
pub mod memory;
pub mod metrics;
mod pace;
pub mod page;
pub mod preset;
mod settings;
mod step;
mod tensorboard;
mod trainer;
pub mod validation;

pub use settings::{CheckpointSettings, Precision, TrainSettings, ValidationSettings};
pub use trainer::{BatchSource, Event, Trainer, TrainerContext, Validate, checkpoints, metrics_path};
