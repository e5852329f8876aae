//! The clock: libraries do not read it, the binary stamps runs and says how long they take.

use selenograph_geometry::time::Utc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Now, as `2026-01-31T23:59:59Z`.
pub fn now_utc() -> String {
    Utc::from_unix(Duration::from_secs(since_1970().as_secs())).to_string()
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
