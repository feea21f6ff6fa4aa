//! Pictures: as data, as files, and how far one is from another.
//!
//! An [`Image`] holds linear sRGB radiance, row 0 on top. A [`Picture`] is an image with named
//! [`Layer`]s and attributes, as an EXR file carries them. [`write`] and [`read`] go by file,
//! [`tone_map`] makes 8-bit pictures of radiance, [`compare`] and [`diff`] give error figures.

mod error;
mod exr;
mod flip;
mod hdr;
mod pfm;
mod png;
mod tone;
mod write;

use std::io::Read;
use std::path::Path;

pub use error::{DiffOptions, Figures, NonFinite, compare, diff};
pub use flip::{DEFAULT_PIXELS_PER_DEGREE, Flip, flip};
pub use tone::{ToneMap, ToneSettings, auto_exposure, tone_map};
pub use write::{check_target, write_aside};

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

    /// An image of pixels given row by row from the top left; `None` unless there are
    /// `width · height` of them.
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Option<Self> {
        (width.checked_mul(height) == Some(pixels.len())).then_some(Image { width, height, pixels })
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
    /// The values.
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
    /// Errors: [`Error::Usage`] naming the allowed endings.
    pub fn of(path: impl AsRef<Path>) -> Result<Format> {
        let path = path.as_ref();
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match ending.as_str() {
            "exr" => Ok(Format::Exr),
            "png" => Ok(Format::Png),
            "pfm" => Ok(Format::Pfm),
            "hdr" => Ok(Format::Hdr),
            _ => Err(Error::Usage(format!(
                "{}: an image's name must end in .exr, .png, .pfm or .hdr, which chooses its format",
                path.display()
            ))),
        }
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

/// The contents of the file `path`, which must be a regular one: a device would never end.
fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let fail = |error: std::io::Error| Error::asset(path, format!("cannot read the image: {error}"));
    let mut file = std::fs::File::open(path).map_err(fail)?;
    let metadata = file.metadata().map_err(fail)?;
    if !metadata.is_file() {
        return Err(Error::asset(path, "cannot read the image: this is not a file"));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(metadata.len() as usize).map_err(|error| fail(error.into()))?;
    file.read_to_end(&mut bytes).map_err(fail)?;
    Ok(bytes)
}

/// The picture in the bytes of a file, or what is wrong with them.
fn decode(bytes: &[u8]) -> Result<Picture, String> {
    match bytes {
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode(bytes),
        [0x89, b'P', b'N', b'G', ..] => png::decode(bytes).map(Picture::from),
        [b'P', b'F' | b'f', ..] => pfm::decode(bytes).map(Picture::from),
        [b'#', b'?', ..] => hdr::decode(bytes).map(Picture::from),
        [] => Err("the file is empty; an EXR, PNG, PFM or Radiance HDR image is expected".into()),
        _ => Err("not an image: the file does not begin like EXR, PNG, PFM or Radiance HDR".into()),
    }
}

/// How many times longer than its file deflated data can be; the wavelet and Huffman codes of EXR stay below.
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
