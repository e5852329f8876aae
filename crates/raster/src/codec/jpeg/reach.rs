//! How large coefficients of samples of 8 bits can be: larger ones tell that bits before them are missing or changed.
//!
//! A block's coefficients are sums over its samples, which lie within 128 of their middle. None is larger than 1024: the mean's
//! is 8 · 128, and for the others `¼ (Σ |cos|)² · 128 ≤ 1024` over 8 samples a side. They are stored in steps. Codes of one block
//! say the difference of its mean from the last one's, so that whatever is lost or changed stays in the means of all blocks
//! behind it, and in most pictures soon leads one of them past white or black.
//!
//! # Source
//! ITU-T T.81: the transform (A.3.3), steps (A.3.4), differences (F.1.1.5.1).

use super::entropy::CUT;

/// Largest coefficient of the mean.
const MOST: u16 = 1024;
/// Some encoders raise white against ringing, by up to 31 levels of 128 (mozjpeg), which the mean does not take part in.
const MOST_OTHER: u16 = MOST + MOST / 4;
/// Rounding and those who round otherwise, steps.
const SLACK: i64 = 2;

/// For each coefficient, in the order in which they are stored, its largest size in steps.
#[derive(Clone, Copy)]
pub(super) struct Reach([i64; 64]);

impl Reach {
    /// Of coefficients of which nothing is known.
    pub const ANY: Self = Self([i64::MAX; 64]);

    /// Reads tables of steps; those of `reach` with their numbers are replaced.
    pub fn read_all(reach: &mut [Self; 4], mut body: &[u8]) -> Result<(), String> {
        while let [place, rest @ ..] = body {
            let size = if place >> 4 == 0 { 1 } else { 2 };
            let (steps, rest) = rest.split_at_checked(64 * size).ok_or(CUT)?;
            let mut found = Self::ANY;
            for (k, (most, step)) in found.0.iter_mut().zip(steps.chunks_exact(size)).enumerate() {
                let step = step.iter().fold(0, |step, byte| step << 8 | u16::from(*byte));
                let largest = if k == 0 { MOST } else { MOST_OTHER };
                *most = i64::from(largest.checked_div(step).ok_or("a table with a step of 0")?) + SLACK;
            }
            *reach.get_mut(usize::from(place & 15)).ok_or("a fifth table of steps")? = found;
            body = rest;
        }
        Ok(())
    }

    /// The level of a block, without its `low` last bits.
    pub fn check_level(&self, level: i64, low: u8) -> Result<(), String> {
        let missing = (1 << low) - 1;
        if (level << low) > self.0[0] || (level << low).saturating_add(missing) < -self.0[0] {
            return Err(
                "a block beyond black or white: coded samples before it are missing or changed".to_owned()
            );
        }
        Ok(())
    }

    /// Coefficient `k`, not the first, without its `low` last bits.
    pub fn check(&self, k: usize, value: i64, low: u8) -> Result<(), String> {
        if value.abs() << low > self.0[k] {
            return Err("a coefficient that no samples have: coded samples before it are missing or changed"
                .to_owned());
        }
        Ok(())
    }
}
