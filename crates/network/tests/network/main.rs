//! Checkpoints as files: the goldens, hostile ones, and what is written here.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it ran"
)]

mod goldens;
mod hostile;
mod torch_file;
mod written;
