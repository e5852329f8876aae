//! Stereo datasets: campaigns planned, pairs rendered with their truth, folders read, checked and exported.
//!
//! The folder layout and every file of it are described in `docs/formats.md`.
#![forbid(unsafe_code)]

pub mod error;
pub mod pair;
pub mod rng;

pub use error::Error;
