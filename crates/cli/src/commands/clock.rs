//! The clock: libraries do not read it, the binary stamps runs and says how long they take.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const DAY_S: u64 = 86_400;

/// Now, as `2026-01-31T23:59:59Z`.
pub fn now_utc() -> String {
    format_utc(since_1970())
}

/// Time since 1970.
#[allow(
    clippy::disallowed_methods,
    reason = "the binary stamps runs; everything below it is handed the stamp"
)]
pub fn since_1970() -> Duration {
    // A clock before 1970 is told as 1970: the stamp decides nothing.
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO)
}

/// Where a stretch of time begins: `elapsed` says how long it is.
#[allow(
    clippy::disallowed_methods,
    reason = "the binary says how long things take, and keeps a budget of time"
)]
pub fn instant() -> Instant {
    Instant::now()
}

/// Seconds since 1970 as a date and time of the Gregorian calendar.
///
/// # Source
/// Howard Hinnant, "chrono-compatible low-level date algorithms", `civil_from_days`.
fn format_utc(since_epoch: Duration) -> String {
    let (days, seconds) = (since_epoch.as_secs() / DAY_S, since_epoch.as_secs() % DAY_S);
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(format_utc(Duration::from_secs(seconds)), text);
        }
    }
}
