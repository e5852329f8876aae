//! What the user sees: data on stdout, everything else on stderr.

use crate::args::Global;
use crate::commands::clock::instant;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::io::{IsTerminal, Write};

/// The two streams, and how much goes to them.
pub struct Ui {
    /// Data as JSON rather than for reading.
    pub json: bool,
    quiet: bool,
    notes: bool,
    verbose: bool,
}

impl Ui {
    /// As asked for on the command line.
    pub fn new(global: &Global) -> Self {
        Self { json: global.json, quiet: global.quiet, notes: !global.quiet, verbose: global.verbose }
    }

    /// Before the command line is known.
    pub fn plain() -> Self {
        Self { json: false, quiet: false, notes: true, verbose: false }
    }

    /// For a step of a longer command: progress bars and times, but no words of its own and no data.
    pub fn without_notes(&self) -> Self {
        Self { json: false, quiet: self.quiet, notes: false, verbose: self.verbose }
    }

    /// A line of data.
    ///
    /// # Errors
    /// If stdout is closed.
    pub fn data(&self, text: &str) -> anyhow::Result<()> {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{text}")?;
        Ok(out.flush()?)
    }

    /// Data as JSON.
    ///
    /// # Errors
    /// If stdout is closed.
    pub fn data_json<T: Serialize>(&self, value: &T) -> anyhow::Result<()> {
        self.data(&serde_json::to_string_pretty(value)?)
    }

    /// What happens, unless --quiet.
    pub fn note(&self, text: &str) {
        if self.notes {
            self.complain(text);
        }
    }

    /// Details, with --verbose.
    pub fn detail(&self, text: &str) {
        if self.verbose {
            self.complain(text);
        }
    }

    /// Does a stage of the work; with --verbose, tells how long it took.
    pub fn timed<T>(&self, stage: &str, work: impl FnOnce() -> T) -> T {
        let start = instant();
        let done = work();
        self.detail(&format!("time: {stage} {:.3} s", start.elapsed().as_secs_f64()));
        done
    }

    /// Errors and skips: always shown.
    pub fn complain(&self, text: &str) {
        // A closed stderr leaves nobody to tell.
        let _ = writeln!(std::io::stderr().lock(), "{text}");
    }

    /// A progress bar with rate and time left; hidden with --quiet and where stderr is no terminal.
    pub fn bar(&self, length: u64, unit: &'static str) -> ProgressBar {
        let shown = !self.quiet && std::io::stderr().is_terminal();
        let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(length), target);
        let template = format!(
            "{{msg}} {{wide_bar}} {{human_pos}}/{{human_len}} {unit} {{per_sec}} {unit}, {{eta}} left"
        );
        match ProgressStyle::with_template(&template) {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        }
    }
}
