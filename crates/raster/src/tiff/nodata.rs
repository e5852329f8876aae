//! No-data numbers as GDAL, its predecessors and their C libraries write them.

/// What the text of a no-data tag says; `None` if it is no number of any spelling.
///
/// NaN and infinities are absent in any file and need no mention; several numbers stand for several bands.
pub(crate) fn numbers(text: &str) -> Option<Vec<f64>> {
    let text = text.trim().trim_matches('"').trim();
    if matches!(
        text.to_ascii_lowercase().as_str(),
        "none" | "null" | "n/a" | "na" | "no data" | "nodata" | "undefined"
    ) {
        return Some(Vec::new());
    }
    let numbers: Option<Vec<f64>> = text.split_ascii_whitespace().map(number).collect();
    Some(numbers?.into_iter().filter(|value| value.is_finite()).collect())
}

fn number(text: &str) -> Option<f64> {
    if let Ok(value) = text.parse::<f64>() {
        return Some(value);
    }
    let text = text.to_ascii_lowercase();
    let unsigned = text.trim_start_matches(['-', '+']);
    // Microsoft's C library: 1.#IND, 1.#QNAN, 1.#SNAN0, 1.#INF00; glibc's: nan(0x7ff…), nan(ind).
    if unsigned.starts_with("nan") || unsigned.starts_with("1.#") {
        return Some(f64::NAN);
    }
    // A decimal comma.
    text.replacen(',', ".", 1).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_of_other_writers() {
        for (text, expected) in [
            ("-9999", &[-9999.0][..]),
            (" -3.40282346638529e+38 ", &[-3.402_823_466_385_29e38]),
            ("-9999,5", &[-9999.5]),
            ("0 255", &[0.0, 255.0]),
        ] {
            assert_eq!(numbers(text).unwrap(), expected, "{text}");
        }
        for nothing in [
            "-1.#IND",
            "1.#QNAN",
            "-nan(ind)",
            "nan(0x7fc00000)",
            "NaN",
            "-nan",
            "inf",
            "-1.#INF",
            "none",
            "",
        ] {
            assert_eq!(numbers(nothing), Some(Vec::new()), "{nothing}");
        }
        assert_eq!(numbers("water"), None);
    }
}
