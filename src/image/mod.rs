//! Pictures: as data, as files, and how far one is from another.
//!
//! An [`Image`] holds linear sRGB radiance, row 0 on top. A [`Picture`] is an image with named
//! [`Layer`]s and attributes, as an EXR file carries them. [`write()`] and [`read`] go by file,
//! [`tone_map`] makes 8-bit pictures of radiance, [`compare`] and [`Pair`] give error figures,
//! [`signed_errors`], [`flip`] and [`hdr_flip`] maps, which [`Palette`]s colour.

mod error;
#[cfg_attr(not(feature = "exr"), path = "left_out/exr.rs")]
mod exr;
mod flip;
#[cfg_attr(not(feature = "png"), path = "left_out/hdr.rs")]
mod hdr;
#[cfg_attr(not(feature = "png"), path = "left_out/jpeg.rs")]
mod jpeg;
mod map;
mod pfm;
#[cfg_attr(not(feature = "png"), path = "left_out/png.rs")]
mod png;
mod tone;
mod write;

use std::fs;
use std::path::Path;

pub use error::{DiffOptions, Figures, NonFinite, Pair, compare};
pub use flip::{DEFAULT_PIXELS_PER_DEGREE, Flip, flip, hdr_flip};
pub use map::{Palette, map_with_bar, range_of, signed_errors};
pub use tone::{ToneMap, ToneSettings, auto_exposure, tone_map};
pub use write::{check_target, write_aside, write_new};

use crate::{Error, Result};

/// A picture in linear sRGB (radiance, if it was rendered), row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// The number of columns.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
    /// The pixels row by row from the top left: `width · height` of them.
    pub pixels: Vec<[f32; 3]>,
}

impl Image {
    /// A black image.
    pub fn new(width: usize, height: usize) -> Self {
        Image { width, height, pixels: vec![[0.0; 3]; width * height] }
    }

    /// An image whose pixel in column `x` of row `y` is `pixel(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut pixel: impl FnMut(usize, usize) -> [f32; 3]) -> Self {
        let pixels = (0..width * height).map(|i| pixel(i % width, i / width)).collect();
        Image { width, height, pixels }
    }

    /// The pixel in column `x` of row `y`. Panics outside the image.
    pub fn get(&self, x: usize, y: usize) -> [f32; 3] {
        assert!(x < self.width, "column {x} of an image {} wide", self.width);
        self.pixels[y * self.width + x]
    }

    /// The mean over pixels and channels; 0 without pixels.
    pub fn mean(&self) -> f64 {
        self.channel_means().iter().sum::<f64>() / 3.0
    }

    /// The mean of each channel over the pixels; 0 without pixels.
    pub fn channel_means(&self) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for pixel in &self.pixels {
            for (sum, &value) in sums.iter_mut().zip(pixel) {
                *sum += f64::from(value);
            }
        }
        sums.map(|sum| sum / self.pixels.len().max(1) as f64)
    }

    /// The means of blocks of `size` × `size` pixels, smaller at the right and bottom edges where
    /// `size` does not divide the image. A `size` of 0 counts as 1.
    pub fn block_means(&self, size: usize) -> Image {
        let size = size.max(1);
        Image::from_fn(self.width.div_ceil(size), self.height.div_ceil(size), |bx, by| {
            let columns = bx * size..((bx + 1) * size).min(self.width);
            let rows = by * size..((by + 1) * size).min(self.height);
            let mut sums = [0.0; 3];
            for y in rows.clone() {
                for pixel in &self.pixels[y * self.width..][columns.clone()] {
                    for (sum, &value) in sums.iter_mut().zip(pixel) {
                        *sum += f64::from(value);
                    }
                }
            }
            sums.map(|sum| (sum / (rows.len() * columns.len()) as f64) as f32)
        })
    }
}

/// The values of a [`Layer`], row by row like an [`Image`]'s pixels.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerData {
    /// Colours, linear sRGB.
    Rgb(Vec<[f32; 3]>),
    /// Directions or points: channels X, Y, Z.
    Normal(Vec<[f32; 3]>),
    /// One number a pixel.
    Scalar(Vec<f32>),
}

impl LayerData {
    /// The number of pixels.
    fn len(&self) -> usize {
        match self {
            LayerData::Rgb(values) | LayerData::Normal(values) => values.len(),
            LayerData::Scalar(values) => values.len(),
        }
    }

    /// The values as the pixels of an image; scalars become grey.
    fn to_pixels(&self) -> Vec<[f32; 3]> {
        match self {
            LayerData::Rgb(values) | LayerData::Normal(values) => values.clone(),
            LayerData::Scalar(values) => values.iter().map(|&value| [value; 3]).collect(),
        }
    }
}

/// A named plane of a [`Picture`], of the same size as its image.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The name: the part of EXR channel names before the last dot.
    pub name: String,
    /// What the layer holds of each pixel, row by row.
    pub channels: LayerData,
}

/// The value of an attribute of a [`Picture`].
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// A text.
    Text(String),
    /// A number.
    Number(f64),
}

/// An image with layers and attributes. Only EXR files hold more than the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// What one sees.
    pub image: Image,
    /// Further planes of the same size.
    pub layers: Vec<Layer>,
    /// Names and values of what is known about the picture.
    pub attributes: Vec<(String, Attribute)>,
}

impl Picture {
    /// The layer called `name`.
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.name == name)
    }
}

impl From<Image> for Picture {
    fn from(image: Image) -> Self {
        Picture { image, layers: Vec::new(), attributes: Vec::new() }
    }
}

/// A file format pictures are written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR: layers and attributes, 32-bit floats, ZIP compression.
    Exr,
    /// PNG: tone-mapped, 8-bit sRGB.
    Png,
    /// Portable float map: 32-bit floats.
    Pfm,
    /// Radiance RGBE: 8-bit mantissas with a shared exponent.
    Hdr,
}

impl Format {
    /// The format that the ending of `path` stands for, in either case.
    ///
    /// Errors: [`Error::Usage`] naming the allowed endings, or the feature without which this was built.
    pub fn of(path: impl AsRef<Path>) -> Result<Format> {
        let path = path.as_ref();
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let format = match ending.as_str() {
            "exr" => Format::Exr,
            "png" => Format::Png,
            "pfm" => Format::Pfm,
            "hdr" => Format::Hdr,
            _ => {
                return Err(Error::Usage(format!(
                    "{}: an image's name must end in .exr, .png, .pfm or .hdr, which chooses its format",
                    path.display()
                )));
            }
        };
        match format.is_built_in() {
            true => Ok(format),
            false => Err(Error::Usage(format!("{}: {}", path.display(), format.left_out()))),
        }
    }

    /// Whether this was built with the feature that reads and writes it.
    pub fn is_built_in(self) -> bool {
        match self {
            Format::Exr => cfg!(feature = "exr"),
            Format::Png | Format::Hdr => cfg!(feature = "png"),
            Format::Pfm => true,
        }
    }

    /// What is said of it where it is not.
    fn left_out(self) -> String {
        let (what, feature) = match self {
            Format::Exr => ("OpenEXR files", "exr"),
            Format::Png => ("PNG files", "png"),
            Format::Hdr => ("Radiance HDR files", "png"),
            Format::Pfm => ("PFM files", "default"),
        };
        Error::left_out(what, feature)
    }
}

/// Writes `picture` in the format that the ending of `path` stands for: EXR with all layers and
/// attributes, PNG tone-mapped by `tone`, PFM and HDR the plain image (HDR cannot hold negative and
/// non-finite values: they become the nearest it can, NaN 0).
///
/// The file is written aside and renamed, see [`write_aside`].
///
/// Errors: [`Error::Usage`] for another ending, [`Error::Output`] when the picture cannot be written.
pub fn write(path: impl AsRef<Path>, picture: &Picture, tone: &ToneSettings) -> Result<()> {
    let path = path.as_ref();
    let format = Format::of(path)?;
    check_shape(picture).map_err(|message| Error::output(path, message))?;
    write_aside(path, |file| match format {
        Format::Exr => exr::encode(picture, file),
        Format::Png => png::encode(&picture.image, tone, file),
        Format::Pfm => pfm::encode(&picture.image, file),
        Format::Hdr => hdr::encode(&picture.image, file),
    })
}

/// Writes `pixels`, rows of `width`, as a PNG file in 8-bit sRGB just as they are. The file is written aside and
/// renamed, see [`write_aside`].
///
/// Errors: [`Error::Output`].
pub fn write_pixels(path: impl AsRef<Path>, pixels: &[[u8; 3]], width: usize) -> Result<()> {
    let path = path.as_ref();
    if width == 0 || pixels.is_empty() || !pixels.len().is_multiple_of(width) {
        return Err(Error::output(path, format!("{} pixels are no rows of {width}", pixels.len())));
    }
    write_aside(path, |file| png::encode_pixels(pixels, width, file))
}

/// Whether every plane of `picture` has as many pixels as its size says.
fn check_shape(picture: &Picture) -> Result<(), String> {
    let Image { width, height, pixels } = &picture.image;
    let expected = width.checked_mul(*height).unwrap_or(usize::MAX);
    if expected == 0 {
        return Err(format!("an image of {width} × {height} pixels is empty"));
    }
    if i32::try_from(*width).is_err() || i32::try_from(*height).is_err() {
        return Err(format!("an image of {width} × {height} pixels is too large for any format"));
    }
    if pixels.len() != expected {
        return Err(format!("{width} × {height} pixels are expected, there are {}", pixels.len()));
    }
    match picture.layers.iter().find(|layer| layer.channels.len() != expected) {
        Some(Layer { name, channels }) => {
            Err(format!("layer \"{name}\" has {} pixels where the image has {width} × {height}", channels.len()))
        }
        None => Ok(()),
    }
}

/// Reads an EXR, PNG, PFM or Radiance HDR file, told apart by their first bytes.
///
/// - EXR: samples of any type; `R`, `G`, `B` or a lone luminance `Y` make the image, all other
///   channels of its data window become layers (`name.R`, `name.G`, `name.B`: colours; `name.X`,
///   `name.Y`, `name.Z`: normals; else scalars); text and numeric attributes.
/// - PNG: 8 or 16 bit, taken as sRGB and made linear; transparency is ignored.
/// - PFM: colour or grey, in either byte order, scaled as the header says.
/// - HDR: divided by the header's exposure.
///
/// Errors: [`Error::Asset`] if the file is missing, damaged or of another kind. Sizes a header
/// claims are held against the file's length before memory is taken.
pub fn read(path: impl AsRef<Path>) -> Result<Picture> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    decode(&bytes).map_err(|message| Error::asset(path, message))
}

/// Reads an image file as a texture, JPEG included: integers by the curve of sRGB, or `linear`, in proportion.
///
/// # Errors
/// [`Error::Asset`] with the path, where the file cannot be read or is no sound image.
pub fn read_texture(path: impl AsRef<Path>, linear: bool) -> Result<Image> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    let image = match bytes[..] {
        [0x89, b'P', b'N', b'G', ..] => png::decode(&bytes, linear),
        [0xff, 0xd8, 0xff, ..] => jpeg::decode(&bytes, linear),
        _ => decode(&bytes).map(|picture| picture.image),
    };
    image.map_err(|message| Error::asset(path, message))
}

/// The contents of the file `path`, which must be a plain one: a device or a pipe may never end.
fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let fail = |error: std::io::Error| Error::asset(path, format!("cannot read the image: {error}"));
    if !fs::metadata(path).map_err(fail)?.is_file() {
        return Err(Error::asset(path, "cannot read the image: this is not a file"));
    }
    fs::read(path).map_err(fail)
}

/// The picture in the bytes of a file, or what is wrong with them.
fn decode(bytes: &[u8]) -> Result<Picture, String> {
    match bytes {
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode(bytes),
        [0x89, b'P', b'N', b'G', ..] => png::decode(bytes, false).map(Picture::from),
        [b'P', b'F' | b'f', ..] => pfm::decode(bytes).map(Picture::from),
        [b'#', b'?', ..] => hdr::decode(bytes).map(Picture::from),
        [] => Err("the file is empty; an EXR, PNG, PFM or Radiance HDR image is expected".into()),
        _ => Err("not an image: the file does not begin like EXR, PNG, PFM or Radiance HDR".into()),
    }
}

/// How many times longer than its file deflated data can be; the wavelet and Huffman codes of EXR stay below.
#[cfg(any(feature = "exr", feature = "png"))]
const DEFLATE: u64 = 1032;

/// Refuses sizes that a file of `file_length` bytes cannot hold, before any memory is taken for them:
/// `bits` is what a pixel takes unpacked in the file's own representation, `expansion` how many
/// times shorter the file's compression can make it.
fn check_size(width: usize, height: usize, bits: u64, expansion: u64, file_length: usize) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err(format!("the header claims {width} × {height} pixels: the image is empty"));
    }
    // Widths and heights are 64-bit numbers at most.
    let pixels = width as u128 * height as u128;
    if pixels.saturating_mul(u128::from(bits)) / 8 > u128::from(expansion) * file_length as u128 {
        return Err(format!(
            "the header claims {width} × {height} pixels, more than a file of {file_length} bytes can hold: \
             it is damaged or cut short"
        ));
    }
    Ok(())
}

#[cfg(all(test, feature = "exr", feature = "png"))]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;
    use ::exr::prelude::{self as raw, WritableImage};
    use ::image::{ExtendedColorType, ImageEncoder};

    /// Smooth, with some of what files must carry: large, tiny and negative values.
    fn sample(width: usize, height: usize) -> Image {
        let mut image = Image::from_fn(width, height, |x, y| [0.01 * x as f32, 0.3 + 0.02 * y as f32, 0.5]);
        image.pixels[1] = [1e4, 1e-4, -0.25];
        image
    }

    fn full_picture() -> Picture {
        let mut image = sample(7, 5);
        image.pixels[3] = [f32::NAN, f32::INFINITY, f32::MIN_POSITIVE];
        let vectors = image.pixels.iter().map(|&[r, g, b]| [g, b, r]).collect();
        let scalars = (0..35).map(|i| if i == 4 { f32::INFINITY } else { i as f32 }).collect();
        Picture {
            layers: vec![
                Layer { name: "depth".into(), channels: LayerData::Scalar(scalars) },
                Layer { name: "direct".into(), channels: LayerData::Rgb(image.pixels.clone()) },
                Layer { name: "normal".into(), channels: LayerData::Normal(vectors) },
            ],
            image,
            attributes: vec![
                ("scene".into(), Attribute::Text("# Rauch, \"äöü\" → 光\n[film]\0\nwidth = 640".into())),
                ("seconds".into(), Attribute::Number(12.75)),
                ("seed".into(), Attribute::Number(9_007_199_254_740_991.0)),
            ],
        }
    }

    fn bits(pixels: &[[f32; 3]]) -> Vec<[u32; 3]> {
        pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
    }

    #[test]
    fn exr_files_keep_every_bit_of_image_layers_and_attributes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ein Bild – 光.EXR");
        let picture = full_picture();
        write(&path, &picture, &ToneSettings::default()).unwrap();
        let back = read(&path).unwrap();
        assert_eq!((back.image.width, back.image.height), (7, 5));
        assert_eq!(bits(&back.image.pixels), bits(&picture.image.pixels));
        assert_eq!(back.attributes, picture.attributes);
        assert_eq!(back.layers.len(), 3);
        for layer in &picture.layers {
            let read = back.layer(&layer.name).unwrap();
            assert_eq!(std::mem::discriminant(&read.channels), std::mem::discriminant(&layer.channels));
            assert_eq!(bits(&read.channels.to_pixels()), bits(&layer.channels.to_pixels()), "{}", layer.name);
        }
        // Viewers look for one part with these channels.
        let metadata = raw::MetaData::read_from_file(&path, true).unwrap();
        let names: Vec<String> = metadata.headers[0].channels.list.iter().map(|c| c.name.to_string()).collect();
        let expected =
            "B G R depth.Z direct.B direct.G direct.R normal.X normal.Y normal.Z".split(' ').collect::<Vec<_>>();
        assert_eq!((metadata.headers.len(), names), (1, expected.into_iter().map(String::from).collect()));
        assert_eq!(metadata.headers[0].compression, raw::Compression::ZIP16);
        assert!(!metadata.requirements.is_single_layer_and_tiled);
    }

    #[test]
    fn plain_formats_keep_what_they_can_hold() {
        let folder = tempfile::tempdir().unwrap();
        let image = sample(37, 11);
        let tone = ToneSettings { exposure: Some(0.0), curve: ToneMap::Linear };
        let trip = |name: &str| {
            let path = folder.path().join(name);
            write(&path, &image.clone().into(), &tone).unwrap();
            let back = read(&path).unwrap().image;
            assert_eq!((back.width, back.height), (37, 11));
            back
        };
        assert_eq!(bits(&trip("a.pfm").pixels), bits(&image.pixels));

        // RGBE: eight bits below the largest channel.
        for (back, pixel) in trip("a.hdr").pixels.iter().zip(&image.pixels) {
            let step = pixel.iter().fold(0.0f32, |a, &b| a.max(b)) / 128.0;
            for (back, value) in back.iter().zip(pixel) {
                assert!((back - value.max(0.0)).abs() <= step, "{value} came back as {back}");
            }
        }

        // PNG: the nearest of 256 sRGB levels.
        for (back, pixel) in trip("a.png").pixels.iter().zip(&image.pixels) {
            for (&back, &value) in back.iter().zip(pixel) {
                let [back, value] = [back, value.clamp(0.0, 1.0)].map(|v| tone::linear_to_srgb(f64::from(v)));
                assert!((back - value).abs() <= 0.5001 / 255.0, "{value} came back as {back}");
            }
        }
    }

    /// An EXR file of one part a list of channels.
    fn raw_exr(
        parts: Vec<(&str, Vec<(&str, raw::FlatSamples)>)>,
        size: (usize, usize),
        encoding: raw::Encoding,
    ) -> Vec<u8> {
        let layers: Vec<_> = parts
            .into_iter()
            .map(|(name, channels)| {
                let channels = channels.into_iter().map(|(name, samples)| raw::AnyChannel::new(name, samples));
                let channels = raw::AnyChannels::sort(channels.collect());
                raw::Layer::new(size, raw::LayerAttributes::named(name), encoding, channels)
            })
            .collect();
        let attributes = raw::ImageAttributes::new(raw::IntegerBounds::from_dimensions(size));
        let mut file = std::io::Cursor::new(Vec::new());
        raw::Image::from_layers(attributes, layers).write().to_buffered(&mut file).unwrap();
        file.into_inner()
    }

    #[test]
    fn exr_files_of_other_programs_are_understood() {
        use raw::FlatSamples::{F16, F32, U32};
        let encoding = raw::Encoding::FAST_LOSSLESS;
        let half = |values: [f32; 2]| F16(values.map(half::f16::from_f32).to_vec());
        let grey = raw_exr(vec![("", vec![("Y", half([0.5, 2.0])), ("A", U32(vec![1, 7]))])], (2, 1), encoding);
        let grey = decode(&grey).unwrap();
        assert_eq!(grey.image.pixels, [[0.5; 3], [2.0; 3]]);
        assert_eq!(grey.layer("A").unwrap().channels, LayerData::Scalar(vec![1.0, 7.0]));

        // Layers as parts instead of dotted names.
        let channels = |scale: f32| {
            let plane = move |c: f32| F32(vec![scale * c, scale]);
            vec![("R", plane(1.0)), ("G", plane(2.0)), ("B", plane(3.0))]
        };
        let parts = raw_exr(vec![("beauty", channels(1.0)), ("direct", channels(0.5))], (2, 1), encoding);
        let parts = decode(&parts).unwrap();
        assert_eq!(parts.image.pixels, [[1.0, 2.0, 3.0], [1.0; 3]]);
        assert_eq!(parts.layer("direct").unwrap().channels, LayerData::Rgb(vec![[0.5, 1.0, 1.5], [0.5; 3]]));

        let lacking = raw_exr(vec![("", vec![("R", half([1.0; 2])), ("G", half([1.0; 2]))])], (2, 1), encoding);
        let message = decode(&lacking).unwrap_err();
        assert!(message.contains("R, G, B or Y") && message.contains("has G, R"), "{message}");
    }

    #[test]
    fn png_and_pfm_of_other_programs_are_understood() {
        let mut png = Vec::new();
        let samples: Vec<u8> = [0u16, 65535, 32768, 1000].iter().flat_map(|value| value.to_ne_bytes()).collect();
        ::image::codecs::png::PngEncoder::new(&mut png).write_image(&samples, 2, 2, ExtendedColorType::L16).unwrap();
        let deep = decode(&png).unwrap().image;
        assert_eq!([deep.get(0, 0), deep.get(1, 0)], [[0.0; 3], [1.0; 3]]);
        let expected = ((1000.0 / 65535.0) / 12.92) as f32;
        assert!((deep.get(1, 1)[0] / expected - 1.0).abs() < 1e-6);

        // Big endian, grey, scaled, the bottom row first.
        let mut pfm = b"Pf\n1 2\n2.0\n".to_vec();
        pfm.extend([3.0f32, 5.0].iter().flat_map(|value| value.to_be_bytes()));
        let grey = decode(&pfm).unwrap().image;
        assert_eq!(grey.pixels, [[10.0; 3], [6.0; 3]]);

        // Radiance's other signature, and an exposure to undo.
        let hdr = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=4\n\n-Y 1 +X 1\n\x80\x40\x20\x83";
        assert_eq!(decode(hdr).unwrap().image.pixels, [[1.0, 0.5, 0.25]]);
    }

    #[test]
    fn headers_that_claim_too_much_are_refused() {
        let image = Picture::from(sample(16, 16));
        let folder = tempfile::tempdir().unwrap();
        let file = |ending: &str| {
            let path = folder.path().join(format!("a.{ending}"));
            write(&path, &image, &ToneSettings::default()).unwrap();
            fs::read(path).unwrap()
        };
        let mut exr = file("exr");
        let at = exr.windows(19).position(|w| w == b"dataWindow\0box2i\0\x10\0").unwrap() + 21;
        exr[at + 8..at + 16].copy_from_slice(&[0xff, 0xff, 0x0f, 0, 0xff, 0xff, 0x0f, 0]);
        let mut png = file("png");
        png[16..24].copy_from_slice(&[0, 0x0f, 0xff, 0xff, 0, 0x0f, 0xff, 0xff]);
        let pfm = b"PF\n1000000 1000000\n-1\n\0\0\0\0".to_vec();
        let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 1000000\n\0\0\0\0".to_vec();
        for (kind, bytes) in [("exr", exr), ("png", png), ("pfm", pfm), ("hdr", hdr)] {
            let message = decode(&bytes).unwrap_err();
            assert!(message.contains("can hold"), "{kind}: {message}");
        }
    }

    #[test]
    fn damaged_files_are_errors_or_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = Vec::new();
        for ending in ["exr", "png", "pfm", "hdr"] {
            let path = folder.path().join(format!("a.{ending}"));
            write(&path, &full_picture(), &ToneSettings::default()).unwrap();
            files.push(fs::read(path).unwrap());
        }
        use raw::Compression::{B44, PIZ, PXR24, RLE};
        for (compression, blocks) in [
            (PIZ, raw::Blocks::ScanLines),
            (PXR24, raw::Blocks::Tiles(raw::Vec2(8, 8))),
            (RLE, raw::Blocks::Tiles(raw::Vec2(16, 4))),
            (B44, raw::Blocks::ScanLines),
        ] {
            let plane = || raw::FlatSamples::F16((0..300).map(|i| half::f16::from_f32((i % 17) as f32)).collect());
            let encoding = raw::Encoding { compression, blocks, line_order: raw::LineOrder::Increasing };
            files.push(raw_exr(vec![("", vec![("Y", plane()), ("id.Z", plane())])], (20, 15), encoding));
        }
        let mut random = Stream::new(23, Purpose::Test, 0, 0);
        let mut draw = |below: usize| (random.uniform() * below as f64) as usize;
        for good in &files {
            assert!(decode(good).is_ok());
            for length in (0..good.len()).step_by(1 + good.len() / 200) {
                if let Ok(picture) = decode(&good[..length]) {
                    check_shape(&picture).unwrap();
                }
            }
            for _ in 0..400 {
                let mut bad = good.clone();
                let reach = if draw(2) == 0 { bad.len() } else { bad.len().min(400) };
                let at = draw(reach);
                let end = bad.len().min(at + 4);
                match draw(3) {
                    0 => bad[at..end].fill(0xff),
                    1 => bad[at] ^= 1 << draw(8),
                    _ => bad[at..end].iter_mut().for_each(|byte| *byte = draw(256) as u8),
                }
                if let Ok(picture) = decode(&bad) {
                    check_shape(&picture).unwrap();
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_written_or_read_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let tone = ToneSettings::default();
        let picture = full_picture();

        let error = write(at("a.jpg"), &picture, &tone).unwrap_err();
        assert!(matches!(&error, Error::Usage(message) if message.contains(".exr, .png, .pfm or .hdr")), "{error}");
        let error = write(at("missing/a.exr"), &picture, &tone).unwrap_err();
        assert!(matches!(&error, Error::Output { message, .. } if message.contains("there is no folder")), "{error}");
        let mut twice = picture.clone();
        twice.layers.push(twice.layers[0].clone());
        assert!(matches!(write(at("a.exr"), &twice, &tone), Err(Error::Output { .. })));
        let mut reserved = picture.clone();
        reserved.attributes.push(("channels".into(), Attribute::Number(1.0)));
        assert!(matches!(write(at("a.exr"), &reserved, &tone), Err(Error::Output { .. })));
        let mut short = picture.clone();
        short.layers[0].channels = LayerData::Scalar(vec![0.0; 3]);
        assert!(matches!(write(at("a.exr"), &short, &tone), Err(Error::Output { .. })));
        assert!(fs::read_dir(folder.path()).unwrap().next().is_none(), "a failed write left something behind");

        fs::write(at("text.exr"), "no image").unwrap();
        for name in ["absent.png", "text.exr", "."] {
            assert!(matches!(read(at(name)), Err(Error::Asset { .. })), "{name}");
        }
    }

    #[test]
    fn means_are_taken_over_pixels_and_over_partial_blocks() {
        let image = Image::from_fn(10, 9, |x, y| [x as f32, y as f32, 1.0]);
        assert_eq!(image.channel_means(), [4.5, 4.0, 1.0]);
        assert!((image.mean() - 9.5 / 3.0).abs() < 1e-12);
        let blocks = image.block_means(8);
        assert_eq!((blocks.width, blocks.height), (2, 2));
        assert_eq!(blocks.pixels, [[3.5, 3.5, 1.0], [8.5, 3.5, 1.0], [3.5, 8.0, 1.0], [8.5, 8.0, 1.0]]);
    }
}
