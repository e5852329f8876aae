//! What the commands do, one file each.

mod completions;

use crate::args::Command;
use crate::exit::Outcome;
use crate::ui::Ui;

/// Runs a command.
///
/// # Errors
/// Whatever stops it; [`crate::exit`] turns it into a line, a hint and an exit code.
pub fn run(command: &Command, ui: &Ui) -> anyhow::Result<Outcome> {
    match command {
        Command::Completions(args) => completions::run(args, ui),
        Command::Dem(_) => Ok(Outcome::Done),
    }
}
