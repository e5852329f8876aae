//! The binary from outside: what it prints, what it answers, and what it leaves behind.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests may stop and tell why")]

mod bad_campaign;
mod bad_input;
mod campaign;
mod dem;
mod doctor;
mod estimate;
mod evaluate;
mod exchange;
mod foreign;
mod frames;
mod help;
mod import;
mod mast3r;
mod photometry;
mod program;
mod reconstruct;
mod refine;
mod shading;
mod shipped;
mod suns;
mod tiff;
#[cfg(feature = "train")]
mod train_input;
#[cfg(all(feature = "train", unix))]
mod train_runs;
mod weights;
