//! Losses, optimiser, schedule and the training run.
//!
//! | you want to | open |
//! | --- | --- |
//! | know a loss | [`loss`], one file each |
//! | train another network | [`network`], the trait |
//! | know what a batch holds | [`batch`] |
//! | know how weights move | [`optimizer`] |
//! | run, stop and go on | [`run`] |
#![forbid(unsafe_code)]

mod activations;
pub mod batch;
mod error;
mod frozen;
pub mod loss;
mod model_network;
pub mod network;
pub mod optimizer;
pub mod run;

pub use error::Error;
pub use model_network::{Frozen, ModelNetwork};
