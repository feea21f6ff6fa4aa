//! PNG: tone-mapped when written, sRGB made linear when read.

use std::io::{self, Cursor, Write};

use ::image::codecs::png::{PngDecoder, PngEncoder};
use ::image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageError, Limits};

use super::tone::srgb_to_linear;
use super::{DEFLATE, Image, ToneSettings, check_size, tone_map};

/// Writes `image`, tone-mapped, in 8-bit sRGB.
pub(super) fn encode(image: &Image, tone: &ToneSettings, out: &mut impl Write) -> io::Result<()> {
    encode_pixels(&tone_map(image, tone), image.width, out)
}

/// Writes rows of `width` pixels of 8-bit sRGB.
pub(super) fn encode_pixels(pixels: &[[u8; 3]], width: usize, out: &mut impl Write) -> io::Result<()> {
    PngEncoder::new(out)
        .write_image(pixels.as_flattened(), width as u32, (pixels.len() / width) as u32, ExtendedColorType::Rgb8)
        .map_err(|error| match error {
            ImageError::IoError(error) => error,
            other => io::Error::other(other),
        })
}

/// Reads an image of any colour type and depth, as linear sRGB without its transparency. `linear`: its numbers already are.
pub(super) fn decode(bytes: &[u8], linear: bool) -> Result<Image, String> {
    let text = |error: ImageError| format!("not a sound PNG file: {error}");

    // The header chunk comes first and has a fixed layout: width, height, depth, colour type.
    let Some(header) = bytes.get(16..26).filter(|_| &bytes[12..16] == b"IHDR") else {
        return Err("not a sound PNG file: the header is missing".into());
    };
    let [width, height] = [0, 4].map(|at| u32::from_be_bytes([0, 1, 2, 3].map(|byte| header[at + byte])) as usize);
    let channels = match header[9] {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    check_size(width, height, u64::from(header[8]) * channels, DEFLATE, bytes.len())?;

    // What is left to limit: chunks beside the picture. One bit may stand for three bytes of palette.
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some((bytes.len() as u64).saturating_mul(24 * DEFLATE));
    let decoder = PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(text)?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(text)?;
    Ok(from_integers(decoded, linear))
}

/// An image of integers, by the curve of sRGB or, `linear`, in proportion.
pub(super) fn from_integers(decoded: DynamicImage, linear: bool) -> Image {
    let value = |share: f64| if linear { share as f32 } else { srgb_to_linear(share) as f32 };
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let pixels = match &decoded {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => {
            let value = |integer: u16| value(f64::from(integer) / 65535.0);
            decoded.into_rgb16().pixels().map(|pixel| pixel.0.map(value)).collect()
        }
        _ => {
            let table: [f32; 256] = std::array::from_fn(|integer| value(integer as f64 / 255.0));
            decoded.into_rgb8().pixels().map(|pixel| pixel.0.map(|integer| table[usize::from(integer)])).collect()
        }
    };
    Image { width, height, pixels }
}
