//! Numbers as people read them.

/// A number with `digits` significant digits, without an exponent between 1e-4 and 1e7; `n/a` for NaN.
pub fn significant(value: f64, digits: usize) -> String {
    if value.is_nan() {
        return "n/a".into();
    }
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "−∞" }.into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let digits = digits.max(1);
    // Rounded first: 9.996 with three digits is 10.0, not 10.00.
    let rounded: f64 = format!("{value:.*e}", digits - 1).parse().unwrap_or(value);
    let exponent = rounded.abs().log10().floor() as i32;
    if !(-4..7).contains(&exponent) {
        return minus(format!("{rounded:.*e}", digits - 1));
    }
    let decimals = usize::try_from(digits as i32 - 1 - exponent).unwrap_or(0);
    minus(format!("{rounded:.decimals$}"))
}

/// A number with a fixed number of decimals; `n/a` where it is not finite.
pub fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() { minus(format!("{value:.decimals$}")) } else { "n/a".into() }
}

/// With a proper minus sign, and none before a zero.
fn minus(text: String) -> String {
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().any(|c| ('1'..='9').contains(&c)) => format!("−{rest}"),
        Some(rest) => rest.to_owned(),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn significant_digits_survive_rounding_up() {
        assert_eq!(significant(9.996, 3), "10.0");
        assert_eq!(significant(0.000_612_3, 3), "0.000612");
        assert_eq!(significant(-1234.5, 2), "−1200");
        assert_eq!(significant(1.0e-7, 2), "1.0e-7");
        assert_eq!(significant(f64::NAN, 2), "n/a");
        assert_eq!(significant(0.0, 4), "0");
    }

    #[test]
    fn no_negative_zero() {
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(fixed(-0.01, 2), "−0.01");
        assert_eq!(fixed(f64::INFINITY, 1), "n/a");
    }
}
