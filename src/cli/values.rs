//! Values of options: times, sizes, shares, ranges.

use std::ops::RangeInclusive;

use crate::quantity::number;
pub(crate) use crate::quantity::{share, time};

/// A limit of 0 or more: `0.02`, `2%` or `1e-4`.
pub fn limit(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (digits, scale) = text.strip_suffix('%').map_or((text, 1.0), |share| (share.trim(), 0.01));
    match digits.parse::<f64>() {
        Ok(number) if number >= 0.0 && number.is_finite() => Ok(scale * number),
        _ => Err("expected a number from 0, such as 0.02, 2% or 1e-4".to_string()),
    }
}

/// A number of bytes: `8GiB`, `500 MB`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let expected = || "expected a size such as 8GiB or 500MB".to_string();
    let (count, unit) = number(text.trim()).ok_or_else(expected)?;
    let unit = match unit.to_ascii_lowercase().as_str() {
        "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        "k" | "kib" => 2f64.powi(10),
        "m" | "mib" => 2f64.powi(20),
        "g" | "gib" => 2f64.powi(30),
        "t" | "tib" => 2f64.powi(40),
        _ => return Err(expected()),
    };
    let bytes = (count * unit) as u64;
    if bytes > 0 { Ok(bytes) } else { Err(expected()) }
}

/// A key and the ends of what its values are to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Ends {
    pub key: String,
    pub values: [f64; 2],
    /// Whether both are written as whole numbers.
    pub whole: bool,
}

/// A key with two ends: `media.fog.scale=1e-8..1e6`.
pub fn sweep(text: &str) -> Result<Ends, String> {
    let expected = || "expected KEY=A..B with two numbers, such as media.fog.scale=1e-8..1e6".to_string();
    let (key, ends) = text.split_once('=').ok_or_else(expected)?;
    let (from, to) = ends.split_once("..").ok_or_else(expected)?;
    let [from, to] = [from.trim(), to.trim()];
    let number = |text: &str| text.replace('_', "").parse::<f64>().ok().filter(|number| number.is_finite());
    let (Some(low), Some(high)) = (number(from), number(to)) else { return Err(expected()) };
    let whole = [from, to].iter().all(|text| text.chars().all(|c| c.is_ascii_digit() || matches!(c, '-' | '+' | '_')));
    Ok(Ends { key: key.trim().to_string(), values: [low, high], whole })
}

/// Passes from 1, both ends included: `9..16`, or `9` alone.
pub fn passes(text: &str) -> Result<RangeInclusive<u32>, String> {
    let passes = range(text).filter(|passes| *passes.start() >= 1);
    passes.ok_or_else(|| "expected the first and the last pass, counted from 1, such as 9..16".to_string())
}

/// Frames, both ends included: `1..240`, or `12` alone.
pub fn frames(text: &str) -> Result<RangeInclusive<u32>, String> {
    range(text).ok_or_else(|| "expected the numbers of the first and the last frame, such as 1..240".to_string())
}

/// Both ends included: `9..16`, or `9` alone.
fn range(text: &str) -> Option<RangeInclusive<u32>> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let [first, last] = [first, last].map(|number| number.trim().parse::<u32>().ok());
    Some(first?..=last?).filter(|range| !range.is_empty())
}

/// A part of an image: `name=x,y,width,height`.
pub fn region(text: &str) -> Result<(String, [u32; 4]), String> {
    let expected = || "expected a name and a part of the image in pixels, such as caustic=40,60,32,24".to_string();
    let (name, numbers) = text.split_once('=').ok_or_else(expected)?;
    let numbers: Vec<u32> =
        numbers.split(',').map(|number| number.trim().parse()).collect::<Result<_, _>>().map_err(|_| expected())?;
    match numbers[..] {
        [x, y, width, height] if !name.trim().is_empty() => Ok((name.trim().to_string(), [x, y, width, height])),
        _ => Err(expected()),
    }
}

/// A sample of a pixel: `x,y,sample`.
pub fn replay(text: &str) -> Result<((u32, u32), u64), String> {
    let expected = || "expected column, row and sample, from 0, such as 12,5,3".to_string();
    let numbers: Vec<&str> = text.split(',').map(str::trim).collect();
    let [x, y, sample] = numbers[..] else { return Err(expected()) };
    match (x.parse(), y.parse(), sample.parse()) {
        (Ok(x), Ok(y), Ok(sample)) => Ok(((x, y), sample)),
        _ => Err(expected()),
    }
}

/// `HOST:PORT`, as it is.
#[cfg(feature = "tev")]
pub fn address(text: &str) -> Result<String, String> {
    match text.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(text.to_string()),
        _ => Err("expected HOST:PORT, such as localhost:14158".to_string()),
    }
}

/// A file that ends in .png.
pub fn png(text: &str) -> Result<std::path::PathBuf, String> {
    if text.to_ascii_lowercase().ends_with(".png") {
        Ok(text.into())
    } else {
        Err("expected a name that ends in .png".to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_with_their_units() {
        let seconds = |text| time(text).map(|time| time.as_secs_f64()).ok();
        for (text, expected) in
            [("60s", 60.0), ("1.5m", 90.0), ("1h30m", 5400.0), ("2 min", 120.0), ("250ms", 0.25), ("0.5h", 1800.0)]
        {
            assert_eq!(seconds(text), Some(expected), "{text}");
        }
        for text in ["", "60", "0s", "-1s", "s", "1d", "1e400h", "1..2s", "9999999999999999999999s"] {
            assert_eq!(seconds(text), None, "{text}");
        }
        assert_eq!((share("2%"), share(" 0.5 % "), share("0.02")), (Ok(0.02), Ok(0.005), Ok(0.02)));
        for text in ["", "0", "-1%", "2%%", "x", "nan", "inf"] {
            assert!(share(text).is_err(), "{text}");
        }
        assert_eq!((limit("2%"), limit("0"), limit(" 1e-4")), (Ok(0.02), Ok(0.0), Ok(1e-4)));
        for text in ["", "-1", "inf", "nan", "2%%"] {
            assert!(limit(text).is_err(), "{text}");
        }
        assert_eq!((bytes("8GiB"), bytes("500 MB"), bytes("1.5k")), (Ok(8 << 30), Ok(500_000_000), Ok(1536)));
        for text in ["", "8", "0MB", "-1GB", "GiB", "8 GiB s"] {
            assert!(bytes(text).is_err(), "{text}");
        }
        assert_eq!((passes("9..16"), passes("3"), passes(" 1 .. 1 ")), (Ok(9..=16), Ok(3..=3), Ok(1..=1)));
        for text in ["", "0..3", "4..3", "1..", "..4", "1...4", "a..b", "1..99999999999"] {
            assert!(passes(text).is_err(), "{text}");
        }
    }
}
