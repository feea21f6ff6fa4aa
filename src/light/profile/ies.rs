//! IESNA LM-63 files, of 1986, 1991, 1995 and 2002: what is measured by type C, all around a vertical axis.

use super::{MOST_VALUES, Measured};
use std::str::FromStr;

/// The words after the line of the tilt, which may be divided into lines anyhow.
struct Words<'t> {
    words: Box<dyn Iterator<Item = (usize, &'t str)> + 't>,
}

impl Words<'_> {
    fn next<T: FromStr>(&mut self, what: &str) -> Result<T, String> {
        let (line, word) = self.words.next().ok_or_else(|| format!("ends before {what}: truncated"))?;
        word.parse().map_err(|_| format!("line {}: found {word:?}; expected {what}", line + 1))
    }

    fn numbers(&mut self, count: usize, what: &str) -> Result<Vec<f64>, String> {
        (0..count).map(|_| self.next(what)).collect()
    }

    fn count(&mut self, what: &str) -> Result<usize, String> {
        let count: usize = self.next(what)?;
        if count == 0 || count > MOST_VALUES {
            return Err(format!("gives {count} as {what}; expected 1 to {MOST_VALUES}"));
        }
        Ok(count)
    }
}

pub(super) fn parse(text: &str) -> Result<Measured, String> {
    // Names and labels, up to the tilt.
    let tilt =
        text.lines().enumerate().find_map(|(line, text)| Some((line, text.trim().strip_prefix("TILT=")?.trim())));
    let Some((line, tilt)) = tilt else {
        return Err("is no IESNA LM-63 file: it has no line that begins with \"TILT=\"".to_string());
    };
    let lines = text.lines().enumerate().skip(line + 1);
    let words = lines.flat_map(|(line, text)| {
        let words = text.split(|c: char| c.is_whitespace() || c == ',');
        words.filter(|word| !word.is_empty()).map(move |word| (line, word))
    });
    let mut words = Words { words: Box::new(words) };

    // How lamps dim when they are tilted: this one is not, or is measured so.
    match tilt {
        "NONE" => {}
        "INCLUDE" => {
            let _geometry: f64 = words.next("how the lamp lies")?;
            let count = words.count("the number of tilts")?;
            words.numbers(2 * count, "an angle of tilt, or its factor")?;
        }
        other => {
            return Err(format!("line {}: TILT={other} is another file; expected NONE or INCLUDE", line + 1));
        }
    }

    // What all intensities have in common counts for nothing: the scene says how strong the lamp is.
    let _lamps: f64 = words.next("the number of lamps")?;
    let _lumens: f64 = words.next("lumens per lamp")?;
    let multiplier: f64 = words.next("the candela multiplier")?;
    let vertical = words.count("the number of vertical angles")?;
    let horizontal = words.count("the number of horizontal angles")?;
    let kind: f64 = words.next("the photometric type")?;
    if kind != 1.0 {
        return Err(format!("is of photometric type {kind}; expected 1, type C: export it as that"));
    }
    if !(multiplier > 0.0 && multiplier.is_finite()) {
        return Err(format!("has the candela multiplier {multiplier}; expected a number above 0"));
    }
    let Some(count) = vertical.checked_mul(horizontal).filter(|count| *count <= MOST_VALUES) else {
        return Err(format!("has {vertical} × {horizontal} directions; expected at most {MOST_VALUES}"));
    };
    words.numbers(4, "the unit of lengths, and width, length and height")?;
    words.numbers(3, "the ballast's factors, and watts")?;
    let vertical = words.numbers(vertical, "a vertical angle")?;
    let horizontal = words.numbers(horizontal, "a horizontal angle")?;
    let values = words.numbers(count, "an intensity")?;
    Ok(Measured { vertical, horizontal, values })
}
