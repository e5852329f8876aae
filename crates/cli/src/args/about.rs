//! Commands about the program itself.

use clap::Args;
use std::path::PathBuf;

/// `doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// Files of weights, or folders of them; the current folder is searched anyway
    #[arg(value_name = "PATH")]
    pub weights: Vec<PathBuf>,
}

/// `completions`.
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell
    pub shell: clap_complete::Shell,
}
