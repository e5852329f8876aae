//! Learning rate over a run: a linear warm-up, then half a cosine.
//!
//! # Source
//! Loshchilov and Hutter 2017, "SGDR", equation 5, without restarts.

use serde::{Deserialize, Serialize};

/// Learning rate as a function of the fractional epoch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Learning rate after the warm-up.
    pub peak: f64,
    /// Learning rate at the end.
    pub minimum: f64,
    /// Epochs of warm-up.
    pub warmup_epochs: f64,
    /// Epochs of the run.
    pub epochs: f64,
}

impl Schedule {
    /// Learning rate at `epoch`, a fraction counted from the start of the run.
    pub fn at(&self, epoch: f64) -> f64 {
        if epoch < self.warmup_epochs {
            return self.peak * epoch / self.warmup_epochs;
        }
        let progress = ((epoch - self.warmup_epochs) / (self.epochs - self.warmup_epochs)).min(1.0);
        self.minimum + (self.peak - self.minimum) * 0.5 * (1.0 + (std::f64::consts::PI * progress).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_without_warm_up_begins_at_its_peak_and_ends_at_its_minimum() {
        let schedule = Schedule { peak: 3e-5, minimum: 2e-7, warmup_epochs: 0.0, epochs: 25.0 };
        assert_eq!(schedule.at(0.0), 3e-5);
        assert!((schedule.at(25.0) - 2e-7).abs() < 1e-20);
        // A run that goes on stays there.
        assert!((schedule.at(30.0) - 2e-7).abs() < 1e-20);
    }
}
