//! `completions`.

use crate::args::{Cli, about::Completions};
use crate::exit::Outcome;
use crate::ui::Ui;
use clap::CommandFactory;

/// Writes the completion script of a shell to stdout.
///
/// # Errors
/// If stdout is closed.
pub fn run(args: &Completions, ui: &Ui) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "selenograph", &mut script);
    ui.data(String::from_utf8_lossy(&script).trim_end())?;
    Ok(Outcome::Done)
}
