//! Numbers with units, as people write them.

use std::time::Duration;

/// A number and what follows it.
pub(crate) fn number(text: &str) -> Option<(f64, &str)> {
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let number: f64 = text[..end].parse().ok()?;
    Some((number, text[end..].trim()))
}

/// A time above 0: `90s`, `1.5m`, `2h`; several may follow each other.
pub(crate) fn time(text: &str) -> Result<Duration, String> {
    let expected = || "expected a time such as 90s, 1.5m, 2h or 1h30m".to_string();
    let mut rest = text.trim();
    let mut seconds = 0.0;
    while !rest.is_empty() {
        let (count, after) = number(rest).ok_or_else(expected)?;
        let end = after.find(|c: char| c.is_ascii_digit()).unwrap_or(after.len());
        let unit = match after[..end].trim() {
            "ms" => 1e-3,
            "s" | "sec" => 1.0,
            "m" | "min" => 60.0,
            "h" => 3600.0,
            _ => return Err(expected()),
        };
        seconds += count * unit;
        rest = &after[end..];
    }
    match Duration::try_from_secs_f64(seconds) {
        Ok(time) if !time.is_zero() => Ok(time),
        _ => Err(expected()),
    }
}

/// A share above 0: `2%` or `0.02`.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    let share = match number(text.trim()) {
        Some((number, "%")) => number / 100.0,
        Some((number, "")) => number,
        _ => 0.0,
    };
    if share > 0.0 { Ok(share) } else { Err("expected a share above 0, such as 2% or 0.02".to_string()) }
}
