//! Exit codes, the error line and its hint.
//!
//! 0 done · 1 input or configuration is wrong · 2 unexpected failure · 3 done, with skips (listed).

use crate::hints::hint;
use crate::ui::Ui;
use std::any::Any;
use std::io::ErrorKind;
use std::process::ExitCode;

const WRONG_INPUT: u8 = 1;
const UNEXPECTED: u8 = 2;
const DONE_WITH_SKIPS: u8 = 3;

/// How a command that did not fail ended.
pub enum Outcome {
    /// Everything was done.
    Done,
    /// The input was read and is not clean: findings are on stdout (`data check`).
    Faulty,
    /// Done except for these, each with its reason.
    Skipped(Vec<String>),
}

/// Input that the command itself refuses (libraries have their own errors).
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    message: String,
    /// What to do about it.
    pub hint: String,
}

/// An error of the command line itself, with what to do about it.
pub fn refuse(message: impl Into<String>, hint: impl Into<String>) -> anyhow::Error {
    Refusal { message: message.into(), hint: hint.into() }.into()
}

/// Answers a command that ran, or panicked.
pub fn answer(result: Result<anyhow::Result<Outcome>, Box<dyn Any + Send>>, ui: &Ui) -> ExitCode {
    match result {
        Ok(Ok(Outcome::Done)) => ExitCode::SUCCESS,
        Ok(Ok(Outcome::Faulty)) => ExitCode::from(WRONG_INPUT),
        Ok(Ok(Outcome::Skipped(reasons))) => {
            for reason in &reasons {
                ui.complain(&format!("skipped: {}", one_line(reason)));
            }
            ExitCode::from(DONE_WITH_SKIPS)
        }
        Ok(Err(error)) => {
            if is_broken_pipe(&error) {
                // `selenograph … | head` is not a failure.
                return ExitCode::SUCCESS;
            }
            ui.complain(&format!("error: {}", message(&error)));
            if let Some(hint) = hint(&error) {
                ui.complain(&format!("hint: {}", one_line(&hint)));
            }
            ExitCode::from(code(&error))
        }
        Err(panic) => {
            let text = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            ui.complain(&format!("error: unexpected failure: {}", one_line(text)));
            ui.complain(
                "hint: this is a fault of selenograph; run again with RUST_BACKTRACE=1 and report it",
            );
            ExitCode::from(UNEXPECTED)
        }
    }
}

/// Keeps a panic's own report for those who ask for a backtrace; everyone else gets one line from [`answer`].
pub fn silence_panics() {
    if std::env::var_os("RUST_BACKTRACE").is_none() {
        std::panic::set_hook(Box::new(|_| {}));
    }
}

/// Answers a command line that cannot be parsed, or a call for help.
pub fn answer_usage(error: &clap::Error) -> ExitCode {
    use clap::error::ErrorKind::{DisplayHelp, DisplayHelpOnMissingArgumentOrSubcommand, DisplayVersion};
    match error.kind() {
        DisplayHelp | DisplayVersion => {
            // Nothing useful can be said where stdout itself is closed.
            let _ = error.print();
            ExitCode::SUCCESS
        }
        DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
            ExitCode::from(WRONG_INPUT)
        }
        _ => {
            let (message, hint) = usage_lines(&error.render().to_string());
            Ui::plain().complain(&format!("{message}\nhint: {hint}"));
            ExitCode::from(WRONG_INPUT)
        }
    }
}

/// Clap's message as one error line and one hint.
fn usage_lines(rendered: &str) -> (String, String) {
    let mut paragraphs = rendered.split("\n\n");
    let message = one_line(paragraphs.next().unwrap_or("error: the command line cannot be read"));
    let tip = rendered.lines().find_map(|line| line.trim().strip_prefix("tip: ")).map(str::to_owned);
    let usage = rendered.lines().find_map(|line| line.trim().strip_prefix("Usage: "));
    let hint = tip
        .or_else(|| usage.map(|usage| format!("usage: {usage}")))
        .unwrap_or_else(|| "`--help` shows what can be typed".into());
    (message, hint)
}

/// The chain of causes in one line; a cause that its predecessor quotes already is not told twice.
fn message(error: &anyhow::Error) -> String {
    let mut told = String::new();
    for cause in error.chain() {
        let text = one_line(&cause.to_string());
        if told.is_empty() {
            told = text;
        } else if !told.contains(&text) {
            told = format!("{told}: {text}");
        }
    }
    told
}

/// Lines joined; the excerpt of a file that a parser draws (`3 | key = value`, `  | ^^^`) is left out.
fn one_line(text: &str) -> String {
    let drawn =
        |line: &str| line.trim_start_matches(|c: char| c.is_ascii_digit() || c == ' ').starts_with('|');
    let lines = text.split('\n').map(str::trim).filter(|line| !line.is_empty() && !drawn(line));
    lines.collect::<Vec<_>>().join(" ")
}

/// The system's reason, where there is one.
pub fn io_kind(error: &anyhow::Error) -> Option<ErrorKind> {
    io_error(error).map(std::io::Error::kind)
}

fn io_error(error: &anyhow::Error) -> Option<&std::io::Error> {
    error.chain().find_map(|cause| cause.downcast_ref())
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    io_kind(error) == Some(ErrorKind::BrokenPipe)
}

/// 1 where the user can mend it by another input, 2 where the machine failed.
fn code(error: &anyhow::Error) -> u8 {
    match io_kind(error) {
        Some(
            ErrorKind::NotFound
            | ErrorKind::PermissionDenied
            | ErrorKind::AlreadyExists
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::ReadOnlyFilesystem
            | ErrorKind::InvalidInput
            | ErrorKind::InvalidData
            | ErrorKind::InvalidFilename
            | ErrorKind::UnexpectedEof,
        ) => WRONG_INPUT,
        // Of a reader that will not hold it; a system that will not write it says the same, and has a number for it.
        Some(ErrorKind::FileTooLarge) if io_error(error).is_some_and(|e| e.raw_os_error().is_none()) => {
            WRONG_INPUT
        }
        Some(_) => UNEXPECTED,
        None => WRONG_INPUT,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usage_becomes_one_line_and_a_hint() {
        let rendered = "error: unexpected argument '--jsn' found\n\n  tip: a similar argument exists: '--json'\n\nUsage: selenograph dem info --json <FILE>...\n\nFor more information, try '--help'.\n";
        let (message, hint) = usage_lines(rendered);
        assert_eq!(message, "error: unexpected argument '--jsn' found");
        assert_eq!(hint, "a similar argument exists: '--json'");
    }

    #[test]
    fn a_full_disk_is_not_the_users_fault_and_a_missing_file_is() {
        let full = anyhow::Error::from(std::io::Error::from(ErrorKind::StorageFull)).context("writing");
        let missing = anyhow::Error::from(std::io::Error::from(ErrorKind::NotFound)).context("reading");
        assert_eq!((code(&full), code(&missing)), (UNEXPECTED, WRONG_INPUT));
        assert!(hint(&full).is_some() && hint(&missing).is_some());
    }
}
