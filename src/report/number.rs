//! Numbers as people read them.

/// Three digits at most: `0.0123`, `1.5`, `12.3`, `4560`; powers of ten where zeros would be many.
pub fn short(value: f64) -> String {
    let text = digits(value, 3);
    let (number, power) = text.split_once('·').unwrap_or((&text, ""));
    let number = if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { number };
    match (number, power) {
        (number, "") => number.to_string(),
        ("1", power) => power.to_string(),
        (number, power) => format!("{number}·{power}"),
    }
}

/// So many digits, zeros at the end included.
pub fn digits(value: f64, count: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".into() } else { value.to_string() };
    }
    // Rounding may carry into the next power of ten.
    let written = format!("{:.*e}", count - 1, value);
    let (mantissa, exponent) = written.split_once('e').unwrap_or((&written, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if !(-4..6).contains(&exponent) {
        return format!("{mantissa}·10{}", superscript(exponent)).replace("-", "−");
    }
    let decimals = (count as i32 - 1 - exponent).max(0) as usize;
    format!("{value:.decimals$}").replace('-', "−")
}

fn superscript(number: i32) -> String {
    let raise = |c: char| match c {
        '-' => '⁻',
        digit => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit.to_digit(10).unwrap_or(0) as usize],
    };
    number.to_string().chars().map(raise).collect()
}

/// A value with its standard error, with as many decimals as two digits of that need: `0.0123 ± 0.0012`; alone where the error is below
/// its fourth digit.
pub fn with_error(value: f64, error: Option<f64>) -> String {
    let Some(error) = error.filter(|error| *error > 0.0 && error.is_finite() && value.is_finite()) else {
        return digits(value, 3);
    };
    if error < 1e-3 * value.abs() {
        return digits(value, 4);
    }
    let place = error.log10().floor() as i32;
    let large = value.abs().max(error).log10().floor() as i32;
    if !(-3..6).contains(&large) {
        let unit = 10f64.powi(large);
        let decimals = (large - place + 1).clamp(0, 8) as usize;
        let text = format!("({:.decimals$} ± {:.decimals$})·10{}", value / unit, error / unit, superscript(large));
        return text.replace('-', "−");
    }
    let decimals = (1 - place).clamp(0, 12) as usize;
    format!("{value:.decimals$} ± {error:.decimals$}").replace('-', "−")
}

/// Seconds in a unit that suits them.
pub fn time(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "–".into(),
        s if s >= 3600.0 => format!("{} h", short(s / 3600.0)),
        s if s >= 100.0 => format!("{} min", short(s / 60.0)),
        s if s >= 0.1 || s == 0.0 => format!("{} s", short(s)),
        s => format!("{} ms", short(1e3 * s)),
    }
}

/// Bytes in a unit that suits them.
pub fn bytes(bytes: u64) -> String {
    let bytes = bytes as f64;
    match bytes {
        b if b >= 1e9 => format!("{} GB", short(b / 1e9)),
        b if b >= 1e6 => format!("{} MB", short(b / 1e6)),
        b if b >= 1e3 => format!("{} kB", short(b / 1e3)),
        b => format!("{b} bytes"),
    }
}

/// A count with its thousands apart.
pub fn count(number: u64) -> String {
    let text = number.to_string();
    let mut grouped = String::new();
    for (k, digit) in text.chars().enumerate() {
        if k > 0 && (text.len() - k).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_keep_their_digits() {
        for (value, expected) in [
            (0.0, "0"),
            (2.0, "2"),
            (0.5, "0.5"),
            (1234.5, "1234"),
            (0.012_34, "0.0123"),
            (9.999, "10"),
            (-0.25, "−0.25"),
            (1.5e-7, "1.5·10⁻⁷"),
            (2e9, "2·10⁹"),
            (1e-5, "10⁻⁵"),
            (1e-4, "0.0001"),
            (100.0, "100"),
            (30.0, "30"),
        ] {
            assert_eq!(short(value), expected, "{value}");
        }
        for (value, error, expected) in [
            (0.012_34, Some(0.001_21), "0.0123 ± 0.0012"),
            (12.345, Some(0.5), "12.35 ± 0.50"),
            (1.234e-7, Some(2e-9), "(1.234 ± 0.020)·10⁻⁷"),
            (-3e-9, Some(1e-8), "(−0.3 ± 1.0)·10⁻⁸"),
            (0.0049, Some(2e-7), "0.004900"),
            (0.5, None, "0.500"),
        ] {
            assert_eq!(with_error(value, error), expected);
        }
        assert_eq!([time(0.05), time(1.5), time(150.0), time(7200.0)], ["50 ms", "1.5 s", "2.5 min", "2 h"]);
        assert_eq!(
            (bytes(999), bytes(47_000_000), count(1_234_567)),
            ("999 bytes".into(), "47 MB".into(), "1\u{202f}234\u{202f}567".into())
        );
    }
}
