//! JPEG, read only.

use std::io::Cursor;

use ::image::codecs::jpeg::JpegDecoder;
use ::image::{DynamicImage, ImageDecoder, ImageError};

use super::png::from_integers;
use super::{Image, check_size};

/// How many times longer than its file an image can be: a block of 64 pixels takes a bit or two at least.
const EXPANSION: u64 = 1024;

/// Reads an image of any colour type, as linear sRGB. `linear`: its numbers already are.
pub(super) fn decode(bytes: &[u8], linear: bool) -> Result<Image, String> {
    let text = |error: ImageError| format!("not a sound JPEG file: {error}");
    let decoder = JpegDecoder::new(Cursor::new(bytes)).map_err(text)?;
    let (width, height) = decoder.dimensions();
    check_size(width as usize, height as usize, 24, EXPANSION, bytes.len())?;
    Ok(from_integers(DynamicImage::from_decoder(decoder).map_err(text)?, linear))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::ExtendedColorType;
    use ::image::codecs::jpeg::JpegEncoder;

    #[test]
    fn what_is_written_is_read_and_what_is_cut_is_refused() {
        let mut bytes = Vec::new();
        let pixels = [188u8; 3 * 16 * 8];
        JpegEncoder::new(&mut bytes).encode(&pixels, 16, 8, ExtendedColorType::Rgb8).unwrap();
        for (linear, expected) in [(true, 188.0 / 255.0), (false, 0.5029)] {
            let image = decode(&bytes, linear).unwrap();
            assert_eq!((image.width, image.height), (16, 8));
            assert!(
                image.pixels.iter().flatten().all(|value| (value - expected).abs() < 0.01),
                "{:?}",
                image.pixels[0]
            );
        }
        for cut in [0, 3, 20, bytes.len() / 2] {
            assert!(decode(&bytes[..cut], true).is_err(), "{cut}");
        }
    }
}
