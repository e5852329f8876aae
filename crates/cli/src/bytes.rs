//! Amounts of memory as people write and read them.

/// Units, the longest name first; without one, a number counts bytes.
const UNITS: [(&str, f64); 9] = [
    ("kib", 1024.0),
    ("mib", 1024.0 * 1024.0),
    ("gib", 1024.0 * 1024.0 * 1024.0),
    ("kb", 1e3),
    ("mb", 1e6),
    ("gb", 1e9),
    ("k", 1e3),
    ("m", 1e6),
    ("g", 1e9),
];

/// `3GB`, `1.5 GiB`, `800M`, `4000000000`.
///
/// # Errors
/// What is wrong with the text.
pub fn parse(text: &str) -> Result<u64, String> {
    let lower = text.trim().to_ascii_lowercase();
    let unit = UNITS.iter().find_map(|(name, factor)| Some((lower.strip_suffix(name)?, *factor)));
    let (number, factor) = unit.unwrap_or_else(|| (lower.strip_suffix('b').unwrap_or(&lower), 1.0));
    match number.trim().parse::<f64>().map(|number| number * factor) {
        Ok(bytes) if bytes >= 1.0 && bytes < u64::MAX as f64 => Ok(bytes as u64),
        _ => Err("expected an amount of memory such as 3GB, 1.5GiB or 800MB".into()),
    }
}

/// Three digits and a unit.
pub fn shown(bytes: u64) -> String {
    let (value, unit) = match bytes as f64 {
        bytes if bytes >= 1e9 => (bytes / 1e9, "GB"),
        bytes if bytes >= 1e6 => (bytes / 1e6, "MB"),
        bytes if bytes >= 1e3 => (bytes / 1e3, "kB"),
        bytes => return format!("{bytes} bytes"),
    };
    let decimals = if value < 9.995 { 2 } else { usize::from(value < 99.95) };
    format!("{value:.decimals$} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_with_and_without_units() {
        for (text, bytes) in [
            ("3GB", 3_000_000_000),
            ("1.5 GiB", 1_610_612_736),
            ("800m", 800_000_000),
            ("512 kB", 512_000),
            ("77b", 77),
            ("4000", 4000),
        ] {
            assert_eq!(parse(text), Ok(bytes), "{text}");
        }
        for text in ["", "GB", "-1GB", "3 parsecs", "nan", "inf", "0", "1e30GB"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn three_digits_are_shown() {
        for (bytes, text) in
            [(12, "12 bytes"), (1500, "1.50 kB"), (69_140_000_000, "69.1 GB"), (250_400_000, "250 MB")]
        {
            assert_eq!(shown(bytes), text);
        }
    }
}
