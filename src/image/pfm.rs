//! Portable float maps: `PF` (colour) or `Pf` (grey), width, height and a scale whose sign tells the
//! byte order (negative: little endian), then 32-bit floats, the bottom row first.
//!
//! Source: P. Debevec, "PFM Portable FloatMap Image Format".

use std::io::{self, Write};

use super::{Image, check_size};

/// Writes `image` in colour, little endian.
pub(super) fn encode(image: &Image, out: &mut impl Write) -> io::Result<()> {
    write!(out, "PF\n{} {}\n-1.0\n", image.width, image.height)?;
    for row in image.pixels.chunks_exact(image.width).rev() {
        for value in row.as_flattened() {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(())
}

/// Reads a colour or grey map.
pub(super) fn decode(bytes: &[u8]) -> Result<Image, String> {
    let mut rest = bytes;
    let channels = match token(&mut rest)? {
        "PF" => 3,
        "Pf" => 1,
        other => return Err(format!("a PFM file begins with PF or Pf, this one with \"{other}\"")),
    };
    let width = number::<usize>(&mut rest, "width")?;
    let height = number::<usize>(&mut rest, "height")?;
    let scale = number::<f32>(&mut rest, "scale")?;
    if !scale.is_finite() || scale == 0.0 {
        return Err(format!("the PFM header's scale is {scale}; its sign must tell the byte order"));
    }
    check_size(width, height, 32 * channels as u64, 1, bytes.len())?;
    let expected = width * height * channels * 4;
    if rest.len() != expected {
        return Err(format!(
            "{width} × {height} pixels take {expected} bytes after the header, there are {}: \
             the file is damaged or cut short",
            rest.len()
        ));
    }

    let value = |bytes: &[u8; 4]| {
        let value = if scale < 0.0 { f32::from_le_bytes(*bytes) } else { f32::from_be_bytes(*bytes) };
        value * scale.abs()
    };
    let (samples, _) = rest.as_chunks::<4>();
    let mut pixels = Vec::with_capacity(width * height);
    for row in samples.chunks_exact(width * channels).rev() {
        match channels {
            1 => pixels.extend(row.iter().map(|sample| [value(sample); 3])),
            _ => pixels.extend(row.as_chunks::<3>().0.iter().map(|[r, g, b]| [value(r), value(g), value(b)])),
        }
    }
    Ok(Image { width, height, pixels })
}

/// Takes a word and the one white space after it.
fn token<'a>(rest: &mut &'a [u8]) -> Result<&'a str, String> {
    let start = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
    let (word, after) = rest[start..]
        .iter()
        .position(u8::is_ascii_whitespace)
        .map(|length| (&rest[start..start + length], &rest[start + length + 1..]))
        .ok_or("the PFM header ends early")?;
    *rest = after;
    std::str::from_utf8(word).map_err(|_| "the PFM header holds something other than text".into())
}

/// Takes a number.
fn number<T: std::str::FromStr>(rest: &mut &[u8], what: &str) -> Result<T, String> {
    let word = token(rest)?;
    word.parse().map_err(|_| format!("the PFM header's {what} is \"{word}\"; a number is expected"))
}
