//! Loss scaling: gradients in half precision are lifted above its smallest value, and steps that overflow are left out.
//!
//! # Source
//! Micikevicius et al. 2018, "Mixed Precision Training", section 3.2.

use serde::{Deserialize, Serialize};

/// Good steps after which the scale doubles.
const GROWTH_INTERVAL: u32 = 2000;
/// Scale of the first step.
const INITIAL: f64 = 65536.0;

/// The factor on the loss, and how it has fared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LossScale {
    factor: f64,
    good_steps: u32,
}

impl Default for LossScale {
    fn default() -> Self {
        Self { factor: INITIAL, good_steps: 0 }
    }
}

impl LossScale {
    /// Factor on the loss of the next step.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Takes note of a step: half the factor after an overflow, twice the factor after 2000 good steps.
    pub fn record(&mut self, finite: bool) {
        if !finite {
            *self = Self { factor: self.factor * 0.5, good_steps: 0 };
            return;
        }
        self.good_steps += 1;
        if self.good_steps == GROWTH_INTERVAL {
            *self = Self { factor: self.factor * 2.0, good_steps: 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_overflow_halves_and_two_thousand_good_steps_double() {
        let mut scale = LossScale::default();
        scale.record(false);
        assert_eq!(scale.factor(), 32768.0);
        (0..1999).for_each(|_| scale.record(true));
        assert_eq!(scale.factor(), 32768.0);
        scale.record(true);
        assert_eq!(scale.factor(), 65536.0);
        // An overflow starts the count again.
        (0..1999).for_each(|_| scale.record(true));
        scale.record(false);
        scale.record(true);
        assert_eq!(scale.factor(), 32768.0);
    }
}
