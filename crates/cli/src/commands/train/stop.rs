//! Ctrl-C, and the notice of a scheduler: a run ends at its next step and leaves a checkpoint.

use anyhow::Context;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Exit code of a program that was told twice.
const TOLD_TWICE: i32 = 130;

/// What is set as soon as someone asks for the end; who asks again gets it at once.
///
/// # Errors
/// If the system allows no handler.
pub fn on_request() -> anyhow::Result<Arc<AtomicBool>> {
    crate::stop::answered_by_the_command();
    let asked = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first time the flag is not set yet.
        flag::register_conditional_shutdown(signal, TOLD_TWICE, asked.clone())
            .and_then(|_| flag::register(signal, asked.clone()))
            .context("cannot listen to Ctrl-C")?;
    }
    Ok(asked)
}
