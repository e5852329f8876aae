//! `train` in a program that was built without it.

use crate::args::train::TrainCommand;
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;

/// Says how to get it.
///
/// # Errors
/// Always.
pub fn run(_: &TrainCommand, _: &Ui) -> anyhow::Result<Outcome> {
    Err(refuse(
        "this program was built without training",
        "build it with `cargo install --path crates/cli --features train` (graphics cards: `--features cuda` or `wgpu`)",
    ))
}
