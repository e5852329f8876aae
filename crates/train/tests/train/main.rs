//! Losses, gradients and steps against the reference's.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it read"
)]

mod by_heart;
mod frozen;
mod goldens;
mod losses;
mod runs;
mod scene;
mod steps;
