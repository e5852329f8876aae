//! How long the steps of a run take.

/// How long steps take.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// The seconds and the step from which on steps are timed.
    pub(super) from: Option<(f64, u64)>,
    /// Mean seconds from step to step before that.
    pub(super) before_s: Option<f64>,
}

impl Pace {
    /// A step has ended. The first of a sitting is slower than the others and not timed.
    pub(super) fn step(&mut self, elapsed_s: f64, step: u64) {
        self.from.get_or_insert((elapsed_s, step));
    }
}
