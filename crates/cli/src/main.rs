//! `selenograph`: lunar terrain in, verified stereo pairs out. Parse, set up, dispatch, answer with an exit code.
#![forbid(unsafe_code)]

mod args;
mod bytes;
mod commands;
mod exit;
mod hints;
mod machine;
mod settings;
mod stop;
mod target;
mod ui;

use args::Cli;
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return exit::answer_usage(&error),
    };
    let ui = ui::Ui::new(&cli.global);
    if let Some(threads) = cli.global.threads {
        // Fails only where the pool exists already, and this is the only place that makes it.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global();
    }
    exit::silence_panics();
    stop::listen();
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| commands::run(&cli.command, &ui)));
    exit::answer(result, &ui)
}
