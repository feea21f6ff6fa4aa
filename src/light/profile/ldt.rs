//! EULUMDAT files: one value a line.

use super::{MOST_VALUES, Measured};
use std::str::FromStr;

struct Lines<'t> {
    lines: std::iter::Enumerate<std::str::Lines<'t>>,
}

impl Lines<'_> {
    fn next<T: FromStr>(&mut self, what: &str) -> Result<T, String> {
        let (line, text) = self.lines.next().ok_or_else(|| format!("ends before {what}: truncated"))?;
        // Some write decimal fractions with a comma.
        let number = text.trim().replace(',', ".");
        number.parse().map_err(|_| format!("line {}: found {:?}; expected {what}", line + 1, text.trim()))
    }

    fn skip(&mut self, count: usize, what: &str) -> Result<(), String> {
        match count.checked_sub(1).map(|last| self.lines.nth(last)) {
            Some(None) => Err(format!("ends before {what}: truncated")),
            _ => Ok(()),
        }
    }

    fn numbers(&mut self, count: usize, what: &str) -> Result<Vec<f64>, String> {
        (0..count).map(|_| self.next(what)).collect()
    }
}

pub(super) fn parse(text: &str) -> Result<Measured, String> {
    let mut lines = Lines { lines: text.lines().enumerate() };
    lines.skip(2, "the symmetry")?;
    let symmetry: u32 = lines.next("the symmetry, from 0 to 4")?;
    let planes: usize = lines.next("the number of C-planes")?;
    lines.skip(1, "the number of angles")?;
    let angles: usize = lines.next("the number of angles in a plane")?;
    if planes == 0 || angles == 0 || planes.checked_mul(angles).is_none_or(|count| count > MOST_VALUES) {
        return Err(format!("has {planes} × {angles} directions; expected 1 to {MOST_VALUES}"));
    }
    // The distance of angles, names, lengths, and factors.
    lines.skip(19, "the number of lamps")?;
    let lamps: usize = lines.next("the number of sets of lamps")?;
    // Of each set six lines; then ten ratios of rooms.
    let more = lamps.checked_mul(6).and_then(|lines| lines.checked_add(10));
    lines.skip(more.ok_or("has more sets of lamps than lines")?, "the angles of C-planes")?;
    let horizontal = lines.numbers(planes, "the angle of a C-plane")?;
    let vertical = lines.numbers(angles, "an angle in a plane")?;

    // Which planes were measured.
    let (first, count) = match symmetry {
        0 => (0, planes),
        1 => (0, 1),
        2 => (0, planes / 2 + 1),
        3 => (planes / 4, planes / 2 + 1),
        4 => (0, planes / 4 + 1),
        _ => return Err(format!("has the symmetry {symmetry}; expected 0 to 4")),
    };
    let Some(horizontal) = horizontal.get(first..first + count).map(<[f64]>::to_vec) else {
        return Err(format!("has {planes} C-planes; expected more for its symmetry, {symmetry}"));
    };
    let values = lines.numbers(count * angles, "an intensity")?;
    Ok(Measured { vertical, horizontal, values })
}
