//! Agreement on what is too steep to land on.

/// The limits that are reported, degrees.
pub const LIMITS_DEG: [f64; 4] = [5.0, 10.0, 15.0, 20.0];

/// Shares of the compared pixels; they add up to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HazardAgreement {
    /// Both above the limit or both not.
    pub agree: f64,
    /// Above it in the prediction only.
    pub false_alarm: f64,
    /// Above it in the truth only.
    pub miss: f64,
}

/// Agreement of slopes `(predicted, true)` on a limit, where both are finite; `None` if they never are.
pub fn hazard(slopes_rad: impl Iterator<Item = (f64, f64)>, limit_rad: f64) -> Option<HazardAgreement> {
    let (mut count, mut false_alarms, mut misses) = (0usize, 0usize, 0usize);
    for (predicted, truth) in slopes_rad.filter(|(p, t)| p.is_finite() && t.is_finite()) {
        count += 1;
        false_alarms += usize::from(predicted > limit_rad && truth <= limit_rad);
        misses += usize::from(predicted <= limit_rad && truth > limit_rad);
    }
    let share = |n: usize| n as f64 / count as f64;
    (count > 0).then(|| HazardAgreement {
        agree: share(count - false_alarms - misses),
        false_alarm: share(false_alarms),
        miss: share(misses),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pixel_counts_once() {
        let slopes = [(0.1, 0.1), (0.3, 0.1), (0.1, 0.3), (0.3, 0.3), (f64::NAN, 0.3), (0.2, 0.21)];
        let found = hazard(slopes.into_iter(), 0.2).unwrap();
        assert_eq!(found, HazardAgreement { agree: 0.4, false_alarm: 0.2, miss: 0.4 });
        assert_eq!(hazard([(f64::NAN, 0.0)].into_iter(), 0.2), None);
    }
}
