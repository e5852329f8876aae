//! Where a run stands in its schedule, and a budget of time: steps sized to it, and again where the machine's pace changes.

use super::checkpoint::Anchor;
use super::pace::Pace;
use super::trainer::Trainer;
use crate::Error;

/// Shares of a budget after which the rest of it is sized: with enough timed steps, and at the latest.
const SIZED_AFTER: [f64; 2] = [0.02, 0.05];
/// Steps that are timed before a budget is sized.
const TIMED_STEPS: u64 = 3;
/// The rest is sized again where it would take so much more or less than there is, as a share of it.
const OFF_PACE: f64 = 0.05;

impl Trainer<'_> {
    pub(super) fn elapsed_s(&self) -> f64 {
        (self.context.clock)().saturating_sub(self.epoch_zero).as_secs_f64()
    }

    pub(super) fn is_over(&self) -> bool {
        let of_time = self.context.budget_s.is_some_and(|budget| {
            let spare = self.save_s + self.validation_s + self.step_s().unwrap_or(0.0);
            self.state.step > 0 && self.elapsed_s() + spare > budget
        });
        of_time || self.state.total_steps.is_some_and(|total| self.state.step >= total)
    }

    /// Mean seconds from step to step, lately.
    pub(super) fn step_s(&self) -> Option<f64> {
        let timed = self.pace.from.filter(|(_, from)| self.num_timed() >= 1 && self.state.step > *from);
        let mean_s =
            timed.map(|(from_s, from)| (self.state.elapsed_s - from_s) / (self.state.step - from) as f64);
        if self.num_timed() >= TIMED_STEPS { mean_s } else { self.pace.before_s.or(mean_s) }
    }

    fn num_timed(&self) -> u64 {
        self.pace.from.map_or(0, |(_, from)| self.state.step - from)
    }

    /// Fractional epoch of the schedule after `step` steps.
    pub(super) fn epoch_at(&self, step: u64) -> f64 {
        let epochs = self.settings.epochs;
        match (self.context.budget_s, self.state.total_steps) {
            // Until a budget is sized the schedule follows the clock.
            (Some(budget_s), None) => epochs * self.state.elapsed_s / budget_s,
            (Some(_), Some(total)) => {
                let Anchor { step: from, epoch } = self.state.sized;
                let left = total.saturating_sub(from).max(1) as f64;
                epoch + (epochs - epoch) * (step as f64 - from as f64) / left
            }
            (None, _) => {
                step as f64 * self.settings.accumulate as f64 / self.context.source.batches_per_epoch() as f64
            }
        }
    }

    pub(super) fn size_budget(&mut self) -> Result<(), Error> {
        let Some(budget_s) = self.context.budget_s.filter(|_| self.state.total_steps.is_none()) else {
            return Ok(());
        };
        let elapsed_s = self.elapsed_s();
        if self.state.step == 1 && elapsed_s + self.save_s > budget_s {
            return Err(Error::BudgetTooShort { budget_s, needed_s: elapsed_s + self.save_s });
        }
        let [early, late] = SIZED_AFTER.map(|share| elapsed_s > share * budget_s);
        let is_timed = self.num_timed() >= TIMED_STEPS && early || late;
        if let Some(step_s) = self.step_s().filter(|_| is_timed) {
            self.plan(self.steps_left(budget_s, step_s));
        }
        Ok(())
    }

    /// Sizes the rest of a budget again, where it would not be kept.
    pub(super) fn resize_budget(&mut self) {
        let (Some(budget_s), Some(total)) = (self.context.budget_s, self.state.total_steps) else { return };
        if self.num_timed() < TIMED_STEPS {
            return;
        }
        let Some(step_s) = self.step_s() else { return };
        let (planned, fitting) = (total.saturating_sub(self.state.step), self.steps_left(budget_s, step_s));
        if planned.abs_diff(fitting) as f64 > OFF_PACE * planned as f64 {
            self.plan(fitting);
        }
        self.pace = Pace { from: Some((self.state.elapsed_s, self.state.step)), before_s: Some(step_s) };
    }

    fn steps_left(&self, budget_s: f64, step_s: f64) -> u64 {
        ((budget_s - self.elapsed_s() - self.save_s - self.validation_s) / step_s).max(0.0) as u64
    }

    /// So many steps from here to the end of the schedule, which goes on from where it is.
    fn plan(&mut self, steps: u64) {
        self.state.sized = Anchor { step: self.state.step, epoch: self.epoch_at(self.state.step) };
        self.state.total_steps = Some(self.state.step + steps);
    }
}
