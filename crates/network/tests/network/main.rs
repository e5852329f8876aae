//! Checkpoints as files: the goldens, hostile ones, and what is written here.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod goldens;
mod hostile;
mod torch_file;
mod written;
