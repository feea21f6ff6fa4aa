//! JPEG, read only.

use std::io::Cursor;

use ::image::codecs::jpeg::JpegDecoder;
use ::image::{DynamicImage, ImageDecoder, ImageError};

use super::{Image, check_size};

/// How many times longer than its file an image can be: a block of 64 pixels takes a bit or two at least.
const EXPANSION: u64 = 1024;

/// Reads an image of any colour type, as linear sRGB. `linear`: its numbers already are.
pub(super) fn decode(bytes: &[u8], linear: bool) -> Result<Image, String> {
    let text = |error: ImageError| format!("not a sound JPEG file: {error}");
    let decoder = JpegDecoder::new(Cursor::new(bytes)).map_err(text)?;
    let (width, height) = decoder.dimensions();
    check_size(width as usize, height as usize, 24, EXPANSION, bytes.len())?;
    Ok(super::from_integers(DynamicImage::from_decoder(decoder).map_err(text)?, linear))
}
