//! The network's architecture as data: configuration, presets, names and shapes of its tensors, checkpoints, input rules.
//!
//! Executors (the CPU engine; later others) read it; nothing here computes.
//!
//! | you want to | open |
//! | --- | --- |
//! | know the dimensions of a network | [`config`], [`Preset`] |
//! | know each tensor's name, shape and first value | [`layout`] |
//! | read a checkpoint, or write one | [`checkpoint`], [`safetensors`], [`random`] |
//! | know what a forward pass costs | [`cost`] |
//! | make a network's input of a picture | [`input`] |
#![forbid(unsafe_code)]

pub mod checkpoint;
pub mod config;
pub mod cost;
mod element;
mod error;
pub mod input;
pub mod layout;
pub mod model_string;
mod pickle;
mod presets;
pub mod random;
pub mod safetensors;
mod zip;

pub use checkpoint::Checkpoint;
pub use config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};
pub use element::ElementType;
pub use error::Error;
pub use presets::Preset;
