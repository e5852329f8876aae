//! What a run says while it runs.

use crate::ui::Ui;
use indicatif::ProgressBar;
use selenograph_train::Error;
use selenograph_train::run::Event;
use selenograph_train::run::metrics::StepRecord;
use std::path::Path;

/// Steps between two lines where there is no terminal to draw a bar in.
const LINE_EVERY: u64 = 100;

/// A bar that tells of steps, and lines for what is rarer.
pub struct Teller<'a> {
    ui: &'a Ui,
    bar: ProgressBar,
}

impl<'a> Teller<'a> {
    /// One that has nothing to tell yet.
    pub fn new(ui: &'a Ui) -> Self {
        Self { ui, bar: ui.bar(0, "steps") }
    }

    /// Tells of an event.
    ///
    /// # Errors
    /// None of its own.
    pub fn tell(&mut self, event: &Event<'_>) -> Result<(), Error> {
        match event {
            Event::Step(record, left_s) => self.step(record, *left_s),
            Event::Validation(found) => {
                let values: Vec<String> =
                    found.values.iter().map(|(name, value)| format!("{name} {value:.4}")).collect();
                self.line(&format!("step {}: held-out pairs: {}", found.step, values.join(", ")));
            }
            Event::Saved(path) => self.ui.detail(&format!("saved: {}", Path::display(path))),
            Event::NotSaved(error) => self.line(&format!("warning: {error}; the checkpoint before is whole")),
            _ => {}
        }
        Ok(())
    }

    /// Leaves the terminal as it was.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, text: &str) {
        self.bar.suspend(|| self.ui.note(text));
    }

    fn step(&self, record: &StepRecord, left_s: Option<f64>) {
        let terms: Vec<String> =
            record.terms.iter().map(|(name, value)| format!("{name} {value:.3}")).collect();
        let left = left_s.map_or("sizing".to_owned(), |s| format!("{:.0} min left", s / 60.0));
        let text = format!(
            "loss {:.4} ({}), lr {:.1e}, {:.2} pairs/s, waiting {:.0} %, {left}",
            record.loss,
            terms.join(", "),
            record.learning_rate,
            record.pairs_per_s,
            100.0 * record.data_wait_share
        );
        if self.bar.is_hidden() && (record.step == 1 || record.step.is_multiple_of(LINE_EVERY)) {
            self.ui.note(&format!("step {}: {text}", record.step));
        }
        if let Some(left_s) = left_s {
            let rate = record.elapsed_s / record.step as f64;
            self.bar.set_length(record.step + (left_s / rate.max(f64::MIN_POSITIVE)) as u64);
        }
        self.bar.set_position(record.step);
        self.bar.set_message(text);
    }
}
