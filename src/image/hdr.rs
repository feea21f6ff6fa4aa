//! Radiance's RGBE files: three 8-bit mantissas and a shared exponent a pixel.

use std::io::{self, Write};

use ::image::codecs::hdr::{HdrDecoder, HdrEncoder};
use ::image::{ImageDecoder, ImageError, Rgb};

use super::{DEFLATE, Image, check_size};

/// The largest value RGBE holds: 255/256 · 2^127.
const LARGEST: f32 = 255.0 / 256.0 * (1u128 << 127) as f32;

/// Writes `image`; negative values and NaN become 0, infinite ones the largest there is.
pub(super) fn encode(image: &Image, out: &mut impl Write) -> io::Result<()> {
    let pixels: Vec<_> =
        image.pixels.iter().map(|pixel| Rgb(pixel.map(|v| if v > 0.0 { v.min(LARGEST) } else { 0.0 }))).collect();
    HdrEncoder::new(out).encode(&pixels, image.width, image.height).map_err(|error| match error {
        ImageError::IoError(error) => error,
        other => io::Error::other(other),
    })
}

/// Reads an image with rows from the top and columns from the left, the only order in use.
pub(super) fn decode(bytes: &[u8]) -> Result<Image, String> {
    if !bytes.starts_with(b"#?RADIANCE") && !bytes.starts_with(b"#?RGBE") {
        return Err("a Radiance HDR file begins with #?RADIANCE or #?RGBE".into());
    }
    let text = |error: ImageError| format!("not a sound Radiance HDR file: {error}");
    // The strict decoder knows but one of the two signatures.
    let decoder = HdrDecoder::new_nonstrict(bytes).map_err(text)?;
    let metadata = decoder.metadata();
    let (width, height) = (metadata.width as usize, metadata.height as usize);
    check_size(width, height, 32, DEFLATE, bytes.len())?;
    let exposure = metadata.exposure.unwrap_or(1.0);
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(format!("the header's EXPOSURE is {exposure}; a positive number is expected"));
    }

    let mut samples = vec![0; width * height * 12];
    decoder.read_image(&mut samples).map_err(text)?;
    let (samples, _) = samples.as_chunks::<4>();
    let (pixels, _) = samples.as_chunks::<3>();
    let pixels = pixels.iter().map(|pixel| pixel.map(|sample| f32::from_ne_bytes(sample) / exposure)).collect();
    Ok(Image { width, height, pixels })
}
