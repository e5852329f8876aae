//! Planned pairs rendered into a dataset folder.

pub mod settings;
