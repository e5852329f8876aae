//! Ranges of settings that a campaign draws from.

use crate::Error;
use crate::rng::Stream;
use serde::{Deserialize, Serialize};

/// A closed range that values are drawn from uniformly: `{ min = 0.04, max = 0.10 }`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

impl Interval {
    /// From its ends.
    pub const fn new(min: f64, max: f64) -> Self {
        Self { min, max }
    }

    /// A value drawn uniformly.
    pub fn draw(&self, stream: &mut Stream) -> f64 {
        stream.uniform(self.min, self.max)
    }

    /// Whether a value lies within.
    pub fn contains(&self, value: f64) -> bool {
        (self.min..=self.max).contains(&value)
    }

    /// Checks order and bounds; `key` is the dotted name in the campaign.
    ///
    /// # Errors
    /// [`Error::Contradiction`] if the ends are crossed, [`Error::Value`] if one leaves `bounds`.
    pub fn check(&self, key: &str, bounds: Self) -> Result<(), Error> {
        check_number(&format!("{key}.min"), self.min, bounds)?;
        check_number(&format!("{key}.max"), self.max, bounds)?;
        if self.min > self.max {
            return Err(Error::Contradiction {
                first: format!("{key}.min"),
                second: format!("{key}.max"),
                why: format!("{} is above {}", self.min, self.max),
            });
        }
        Ok(())
    }
}

/// Checks that a setting is a number within bounds.
///
/// # Errors
/// [`Error::Value`] otherwise.
pub fn check_number(key: &str, value: f64, bounds: Interval) -> Result<(), Error> {
    if bounds.contains(value) {
        return Ok(());
    }
    Err(Error::Value {
        key: key.into(),
        expected: format!("a number between {} and {}", bounds.min, bounds.max),
        found: value.to_string(),
    })
}
