//! Stereo datasets: campaigns planned, pairs rendered with their truth, folders read, checked and exported.
//!
//! The folder layout and every file of it are described in `docs/formats.md`.
#![forbid(unsafe_code)]

pub mod augment;
pub mod check;
pub mod correspondence;
mod covisibility;
mod error;
pub mod export;
mod font;
pub mod generate;
pub mod import;
pub mod loader;
pub mod pair;
pub mod photometric;
pub mod plan;
pub mod rng;
pub mod sample;
pub mod sheet;
pub mod split;
pub mod stored;
mod view_truth;

pub use error::Error;

#[cfg(test)]
mod test_terrain;
