//! The network's architecture as data: configuration, presets, names and shapes of its tensors, checkpoints, input rules.
//!
//! Executors (the CPU engine; later others) read it; nothing here computes.
#![forbid(unsafe_code)]

pub mod config;
