//! Coordinated Universal Time as labels write it, and the uniform time that ephemerides are functions of.

use crate::Error;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

const DAY_S: f64 = 86_400.0;
/// Days from 1970-01-01 to J2000.0, noon of 2000-01-01.
const J2000_DAY: f64 = 10_957.5;
/// Days of a Julian century.
const CENTURY_DAYS: f64 = 36_525.0;
/// TT − TAI, seconds (IAU 1991).
const TT_MINUS_TAI_S: f64 = 32.184;

/// First days, since 1970-01-01, on which TAI − UTC has that many seconds.
///
/// # Source
/// IERS, Bulletin C 1 to 72 (none was announced after 2017-01-01 until 2026).
const LEAP_SECONDS: [(i64, f64); 28] = [
    (day_of(1972, 1, 1), 10.0),
    (day_of(1972, 7, 1), 11.0),
    (day_of(1973, 1, 1), 12.0),
    (day_of(1974, 1, 1), 13.0),
    (day_of(1975, 1, 1), 14.0),
    (day_of(1976, 1, 1), 15.0),
    (day_of(1977, 1, 1), 16.0),
    (day_of(1978, 1, 1), 17.0),
    (day_of(1979, 1, 1), 18.0),
    (day_of(1980, 1, 1), 19.0),
    (day_of(1981, 7, 1), 20.0),
    (day_of(1982, 7, 1), 21.0),
    (day_of(1983, 7, 1), 22.0),
    (day_of(1985, 7, 1), 23.0),
    (day_of(1988, 1, 1), 24.0),
    (day_of(1990, 1, 1), 25.0),
    (day_of(1991, 1, 1), 26.0),
    (day_of(1992, 7, 1), 27.0),
    (day_of(1993, 7, 1), 28.0),
    (day_of(1994, 7, 1), 29.0),
    (day_of(1996, 1, 1), 30.0),
    (day_of(1997, 7, 1), 31.0),
    (day_of(1999, 1, 1), 32.0),
    (day_of(2006, 1, 1), 33.0),
    (day_of(2009, 1, 1), 34.0),
    (day_of(2012, 7, 1), 35.0),
    (day_of(2015, 7, 1), 36.0),
    (day_of(2017, 1, 1), 37.0),
];

/// An instant of Coordinated Universal Time; before 1972 of universal time as such.
///
/// It is read from ISO 8601 as labels have it: `1971-07-31T14:12:05.5`, also with `Z`, with the day of the year (`1971-212T…`) and
/// without seconds, and written as `1971-07-31T14:12:05.5Z`.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Utc {
    /// Since 1970-01-01.
    day: i64,
    /// Since midnight, `[0, 86401)`: a day may have a second more.
    second: f64,
}

impl Utc {
    /// From the time since 1970-01-01T00:00:00Z, leap seconds not counted, as clocks of computers have it.
    pub fn from_unix(since_1970: Duration) -> Self {
        let whole = since_1970.as_secs();
        let second = (whole % 86_400) as f64 + f64::from(since_1970.subsec_nanos()) * 1e-9;
        Self { day: (whole / 86_400) as i64, second }
    }

    /// Seconds from here to a later time, leap seconds not counted; negative to an earlier one.
    pub fn seconds_to(self, later: Self) -> f64 {
        (later.day - self.day) as f64 * DAY_S + (later.second - self.second)
    }

    /// The time half way to another one.
    #[must_use]
    pub fn middle(self, other: Self) -> Self {
        let second = self.second + 0.5 * self.seconds_to(other);
        let days = (second / DAY_S).floor();
        Self { day: self.day + days as i64, second: second - days * DAY_S }
    }

    /// Calendar year with the part of it that is over; an average year is as good as any here.
    pub fn year(self) -> f64 {
        2000.0 + (self.day as f64 + self.second / DAY_S - J2000_DAY) / 365.25
    }

    /// Terrestrial Time − UTC, seconds.
    ///
    /// Exact from 1972 to the last known leap second and up to a second a year off after it; before, UT1 stands for UTC, which
    /// is 0.2 s off from 1950 on.
    ///
    /// # Source
    /// IERS Bulletin C for leap seconds; before 1972 the polynomials of Espenak and Meeus 2006, "Five millennium canon of solar eclipses",
    /// for TT − UT1.
    pub fn tt_minus_utc_s(self) -> f64 {
        if let Some((_, leap_s)) = LEAP_SECONDS.iter().rev().find(|(first, _)| self.day >= *first) {
            return leap_s + TT_MINUS_TAI_S;
        }
        let year = self.year();
        if year >= 1961.0 {
            let t = year - 1975.0;
            45.45 + 1.067 * t - t * t / 260.0 - t.powi(3) / 718.0
        } else {
            let t = year - 1950.0;
            29.07 + 0.407 * t - t * t / 233.0 + t.powi(3) / 2547.0
        }
    }

    /// Julian centuries of Terrestrial Time since J2000.0.
    pub fn julian_centuries_tt(self) -> f64 {
        (self.day as f64 - J2000_DAY + (self.second + self.tt_minus_utc_s()) / DAY_S) / CENTURY_DAYS
    }
}

/// Days from 1970-01-01 to a date of the Gregorian calendar.
///
/// # Source
/// Howard Hinnant, "chrono-compatible low-level date algorithms", `days_from_civil`.
const fn day_of(year: i64, month: i64, day: i64) -> i64 {
    let from_march = if month > 2 { year } else { year - 1 };
    let (era, year_of_era) = (from_march.div_euclid(400), from_march.rem_euclid(400));
    let month_from_march = if month > 2 { month - 3 } else { month + 9 };
    let day_of_year = (153 * month_from_march + 2) / 5 + day - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

/// Year, month and day of the Gregorian calendar, days after 1970-01-01.
///
/// # Source
/// The same, `civil_from_days`.
fn date_of(day: i64) -> (i64, i64, i64) {
    let shifted = day + 719_468;
    let (era, day_of_era) = (shifted.div_euclid(146_097), shifted.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (year_of_era + era * 400 + i64::from(month <= 2), month, day)
}

impl fmt::Display for Utc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (year, month, day) = date_of(self.day);
        let milliseconds = (self.second * 1000.0).round() as u64;
        // The 61st second of a last minute is written as such.
        let minutes = (milliseconds / 60_000).min(1439);
        let (seconds, rest) = ((milliseconds - minutes * 60_000) / 1000, milliseconds % 1000);
        write!(f, "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{seconds:02}", minutes / 60, minutes % 60)?;
        if rest > 0 {
            f.write_str(format!(".{rest:03}").trim_end_matches('0'))?;
        }
        f.write_str("Z")
    }
}

impl FromStr for Utc {
    type Err = Error;

    /// # Errors
    /// [`Error::Time`] for what is no date with a time of day, and for other time zones.
    fn from_str(text: &str) -> Result<Self, Error> {
        parse(text.trim()).map_err(|expected| Error::Time { text: text.to_owned(), expected })
    }
}

fn parse(text: &str) -> Result<Utc, &'static str> {
    let text = text.strip_suffix(['Z', 'z']).unwrap_or(text);
    let (date, time) = text.split_once(['T', 't', ' ']).ok_or("a date and a time of day with T between")?;
    if time.contains(['+', '-']) {
        return Err("UTC, without an offset");
    }
    let day = match date.split('-').collect::<Vec<_>>().as_slice() {
        [year, month, day] => {
            let (year, month, day) = (whole(year, 4), whole(month, 2), whole(day, 2));
            let (Some(year), Some(month), Some(day)) = (year, month, day) else {
                return Err(DATE);
            };
            let count = day_of(year, month, day);
            Some(count).filter(|count| date_of(*count) == (year, month, day))
        }
        [year, day] => {
            let (Some(year), Some(day)) = (whole(year, 4), whole(day, 3)) else { return Err(DATE) };
            let count = day_of(year, 1, 1) + day - 1;
            Some(count).filter(|count| day >= 1 && date_of(*count).0 == year)
        }
        _ => return Err(DATE),
    };
    let day = day.ok_or("a day of the calendar")?;
    let parts: Vec<&str> = time.split(':').collect();
    let (hour, minute, second) = match parts.as_slice() {
        [hour, minute] => (whole(hour, 2), whole(minute, 2), Some(0.0)),
        [hour, minute, second] => (whole(hour, 2), whole(minute, 2), seconds(second)),
        _ => return Err(TIME),
    };
    let (Some(hour), Some(minute), Some(second)) = (hour, minute, second) else { return Err(TIME) };
    let is_last =
        (hour, minute) == (23, 59) && LEAP_SECONDS.iter().skip(1).any(|(first, _)| *first == day + 1);
    let longest = if is_last { 61.0 } else { 60.0 };
    if hour > 23 || minute > 59 || second >= longest {
        return Err("a time before 24:00:00");
    }
    Ok(Utc { day, second: (hour * 60 + minute) as f64 * 60.0 + second })
}

const DATE: &str = "a date as 1971-07-31 or 1971-212";
const TIME: &str = "a time of day as 14:12 or 14:12:05.5";

/// A number of exactly so many digits.
fn whole(text: &str, digits: usize) -> Option<i64> {
    let is_number = text.len() == digits && text.bytes().all(|b| b.is_ascii_digit());
    is_number.then(|| text.parse().ok())?
}

/// Two digits and perhaps a fraction.
fn seconds(text: &str) -> Option<f64> {
    let (before, after) = text.split_once('.').unwrap_or((text, "0"));
    let is_fraction = after.bytes().all(|b| b.is_ascii_digit());
    (whole(before, 2).is_some() && is_fraction).then(|| text.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utc(text: &str) -> Utc {
        text.parse().unwrap()
    }

    #[test]
    fn the_forms_of_labels_are_one_time() {
        let expected = utc("1971-07-31T14:12:05.5");
        for text in [
            "1971-07-31T14:12:05.5Z",
            "1971-212T14:12:05.500",
            " 1971-07-31 14:12:05.5 ",
            "1971-212T14:12:05.5Z",
        ] {
            assert_eq!(utc(text), expected, "{text}");
        }
        assert_eq!(expected.to_string(), "1971-07-31T14:12:05.5Z");
        assert_eq!(utc("2009-11-29T14:51").to_string(), "2009-11-29T14:51:00Z");
        assert_eq!(utc("2009-11-29T14:51:21.968000").to_string(), "2009-11-29T14:51:21.968Z");
        assert_eq!(utc("2008-366T00:00:00").to_string(), "2008-12-31T00:00:00Z");
    }

    #[test]
    fn dates_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(Utc::from_unix(Duration::from_secs(seconds)).to_string(), text);
            assert_eq!(utc(text), Utc::from_unix(Duration::from_secs(seconds)));
        }
    }

    #[test]
    fn what_is_no_time_is_refused_with_what_was_expected() {
        for (text, expected) in [
            ("", "a date and a time of day with T between"),
            ("1971-07-31", "a date and a time of day with T between"),
            ("1971-07-31T14:12:05+09:00", "UTC, without an offset"),
            ("31.7.1971T14:12", DATE),
            ("71-07-31T14:12", DATE),
            ("1971-02-29T14:12", "a day of the calendar"),
            ("1971-366T14:12", "a day of the calendar"),
            ("1971-000T14:12", "a day of the calendar"),
            ("1971-07-31T14", TIME),
            ("1971-07-31T14:12:5", TIME),
            ("1971-07-31T14:12:0é", TIME),
            ("1971-07-31T24:00:00", "a time before 24:00:00"),
            ("1971-07-31T14:12:60", "a time before 24:00:00"),
            ("2018-12-31T23:59:60", "a time before 24:00:00"),
        ] {
            let error = text.parse::<Utc>().unwrap_err();
            assert_eq!(error, Error::Time { text: text.into(), expected }, "{text}");
        }
    }

    #[test]
    fn leap_seconds_are_there_when_they_were() {
        assert_eq!(utc("2016-12-31T23:59:60.5").to_string(), "2016-12-31T23:59:60.5Z");
        for (text, tt_minus_utc_s) in [
            ("1972-01-01T00:00", 42.184),
            ("1999-01-01T00:00", 64.184),
            ("2005-12-31T23:59:59", 64.184),
            ("2016-12-31T23:59:60", 68.184),
            ("2017-01-01T00:00", 69.184),
            ("2030-01-01T00:00", 69.184),
        ] {
            assert!((utc(text).tt_minus_utc_s() - tt_minus_utc_s).abs() < 1e-9, "{text}");
        }
        // Observed values of TT − UT1: the Astronomical Almanac, page K9.
        for (text, observed) in
            [("1950-01-01T00:00", 29.15), ("1960-01-01T00:00", 33.15), ("1971-07-01T00:00", 41.68)]
        {
            assert!(
                (utc(text).tt_minus_utc_s() - observed).abs() < 0.2,
                "{text}: {}",
                utc(text).tt_minus_utc_s()
            );
        }
    }

    #[test]
    fn julian_centuries_run_in_terrestrial_time() {
        // 2000-01-01T12:00:00 TT.
        assert!(utc("2000-01-01T11:58:55.816").julian_centuries_tt().abs() < 1e-15);
        let half = utc("1999-12-31T23:00").middle(utc("2000-01-01T03:00"));
        assert_eq!(half.to_string(), "2000-01-01T01:00:00Z");
        assert!((utc("1999-12-31T23:00").seconds_to(half) - 7200.0).abs() < 1e-9);
    }
}
