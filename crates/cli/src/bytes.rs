//! Amounts of memory as people read them.

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
    fn three_digits_are_shown() {
        for (bytes, text) in
            [(12, "12 bytes"), (1500, "1.50 kB"), (69_140_000_000, "69.1 GB"), (250_400_000, "250 MB")]
        {
            assert_eq!(shown(bytes), text);
        }
    }
}
