//! Ctrl-C, and the notice of a scheduler: says what is kept, takes what is unfinished along.

use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(unix)]
pub use unix::listen;

/// Elsewhere the system ends the process as it always did; the next run of the same command clears what it leaves.
#[cfg(not(unix))]
pub fn listen() {}

#[cfg(unix)]
mod unix {
    use crate::target;
    use crate::ui::Ui;
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;

    /// Exit code of a program that was ended from outside.
    const ENDED: i32 = 130;

    /// Answers the first signal from a thread of its own. Commands that come to an end by themselves when they are asked to
    /// ([`crate::commands`]' training) answer it instead.
    #[allow(clippy::disallowed_methods, reason = "after a signal there is nothing to return to")]
    pub fn listen() {
        // Where the system allows no handler, its own way of ending a process remains.
        let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return };
        std::thread::spawn(move || {
            for _ in signals.forever() {
                if super::is_answered() {
                    continue;
                }
                selenograph_files::abandon();
                Ui::plain().complain(&target::stopped());
                std::process::exit(ENDED);
            }
        });
    }
}

static ANSWERED: AtomicBool = AtomicBool::new(false);

/// From here on the command itself comes to an end when it is asked to.
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "only training does"))]
pub fn answered_by_the_command() {
    ANSWERED.store(true, Ordering::Relaxed);
}

#[cfg_attr(not(unix), allow(dead_code, reason = "nobody listens there"))]
fn is_answered() -> bool {
    ANSWERED.load(Ordering::Relaxed)
}
