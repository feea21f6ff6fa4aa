//! How far an image is from a reference.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{
    DEFAULT_PIXELS_PER_DEGREE, Flip, Image, Picture, ToneSettings, auto_exposure, flip, hdr_flip, read, tone_map,
};
use crate::{Error, Result};

/// Error figures of an image I against a reference R, over pixels and channels.
///
/// Pixels that are not finite in the image, the reference or its standard error take no part in the
/// means, and are reported.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// The number of columns.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
    /// The image's mean in each channel.
    pub mean: [f64; 3],
    /// The reference's mean in each channel.
    pub reference_mean: [f64; 3],
    /// √(mean (I − R)²).
    pub rmse: f64,
    /// mean (I − R)²/(R² + 0.01 · mean(R)²); `None` if the reference's mean is 0.
    pub rel_mse: Option<f64>,
    /// mean(I − R)/mean(R); `None` if the reference's mean is 0.
    pub bias: Option<f64>,
    /// Mean FLIP of the pictures, tone-mapped alike at the reference's exposure; `None` for what is
    /// no colour (normals, depth).
    pub flip: Option<f64>,
    /// Mean FLIP over exposures, see [`hdr_flip`], where it was asked for: it takes about ten times as long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hdr_flip: Option<f64>,
    /// Whether the reference's own variance was subtracted from the squared differences in
    /// `rmse` and `rel_mse`. What falls below 0 by chance is 0.
    pub variance_subtracted: bool,
    /// Pixels of the image that are NaN or infinite.
    pub non_finite: Option<NonFinite>,
    /// Pixels of the reference (or of its standard error) that are NaN or infinite.
    pub reference_non_finite: Option<NonFinite>,
}

/// Pixels that are NaN or infinite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct NonFinite {
    /// How many there are.
    pub count: usize,
    /// Column and row of the first.
    pub first: [usize; 2],
}

impl NonFinite {
    fn of<'a>(pixels: impl Iterator<Item = &'a [f32; 3]>, width: usize) -> Option<NonFinite> {
        let mut places =
            pixels.enumerate().filter(|(_, pixel)| !finite(pixel)).map(|(index, _)| [index % width, index / width]);
        let first = places.next()?;
        Some(NonFinite { count: 1 + places.count(), first })
    }
}

fn finite(pixel: &[f32; 3]) -> bool {
    pixel.iter().all(|value| value.is_finite())
}

/// Compares `image` with `reference`. If the standard error of the reference's pixels is given, its
/// square is subtracted from the squared differences, so that the noise of the reference is not held
/// against the image.
///
/// Errors: [`Error::Usage`] if sizes differ or no pixel is finite everywhere.
pub fn compare(image: &Image, reference: &Image, standard_error: Option<&Image>) -> Result<Figures> {
    let (width, height) = (reference.width, reference.height);
    if (image.width, image.height) != (width, height) {
        return Err(Error::Usage(format!(
            "the image has {} × {} pixels, the reference {width} × {height}; equal sizes are expected",
            image.width, image.height
        )));
    }
    if let Some(error) = standard_error.filter(|error| (error.width, error.height) != (width, height)) {
        return Err(Error::Usage(format!(
            "the standard error has {} × {} pixels, the reference {width} × {height}; equal sizes are expected",
            error.width, error.height
        )));
    }

    let errors = |index: usize| standard_error.map_or([0.0; 3], |error| error.pixels[index]);
    let triples: Vec<([f64; 3], [f64; 3], [f64; 3])> = (0..reference.pixels.len())
        .map(|index| (image.pixels[index], reference.pixels[index], errors(index)))
        .filter(|(i, r, e)| finite(i) && finite(r) && finite(e))
        .map(|(i, r, e)| (i.map(f64::from), r.map(f64::from), e.map(f64::from)))
        .collect();
    if triples.is_empty() {
        return Err(Error::Usage("no pixel is finite in both the image and the reference".into()));
    }

    // Means first, then what is relative to them.
    let mut mean = [0.0; 3];
    let mut reference_mean = [0.0; 3];
    for (i, r, _) in &triples {
        for c in 0..3 {
            mean[c] += i[c] / triples.len() as f64;
            reference_mean[c] += r[c] / triples.len() as f64;
        }
    }
    let overall = |means: [f64; 3]| means.iter().sum::<f64>() / 3.0;
    let level = overall(reference_mean);
    let mut squares = 0.0;
    let mut relative = 0.0;
    for (i, r, e) in &triples {
        for c in 0..3 {
            let square = (i[c] - r[c]).powi(2) - e[c] * e[c];
            squares += square;
            relative += square / (r[c] * r[c] + 0.01 * level * level);
        }
    }
    let values = 3.0 * triples.len() as f64;

    let flip = shown_difference(image, reference).map(|flip| flip.mean);

    let doubtful = reference.pixels.iter().enumerate().map(|(index, pixel)| match standard_error {
        Some(error) if finite(pixel) => &error.pixels[index],
        _ => pixel,
    });
    Ok(Figures {
        width,
        height,
        mean,
        reference_mean,
        rmse: (squares / values).max(0.0).sqrt(),
        rel_mse: (level != 0.0).then(|| (relative / values).max(0.0)),
        bias: (level != 0.0).then(|| (overall(mean) - level) / level),
        flip,
        hdr_flip: None,
        variance_subtracted: standard_error.is_some(),
        non_finite: NonFinite::of(image.pixels.iter(), width),
        reference_non_finite: NonFinite::of(doubtful, width),
    })
}

/// What [`Pair::read`] takes of two files.
#[derive(Clone, Debug, Default)]
pub struct DiffOptions {
    /// The layer to compare, by name; `None`: the image itself.
    pub layer: Option<String>,
    /// A file with the standard error of the reference's pixels; `None`: the reference's layer
    /// `standard_error`, if it has one (it belongs to the image, not to other layers).
    pub standard_error: Option<PathBuf>,
}

/// An image and what it is judged by.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The image.
    pub image: Image,
    /// The reference.
    pub reference: Image,
    /// The standard error of the reference's pixels.
    pub standard_error: Option<Image>,
    /// Whether they hold colours, which can be looked at; otherwise normals or a depth.
    pub coloured: bool,
}

impl Pair {
    /// Reads two image files, of any formats.
    ///
    /// Errors: [`Error::Asset`] for a file that cannot be read or lacks the layer.
    pub fn read(image: impl AsRef<Path>, reference: impl AsRef<Path>, options: &DiffOptions) -> Result<Pair> {
        let (image, reference) = (image.as_ref(), reference.as_ref());
        let layer = options.layer.as_deref();
        let (image, _) = choose(image, read(image)?, layer)?;
        let picture = read(reference)?;
        let standard_error = match &options.standard_error {
            Some(path) => Some(read(path)?.image),
            None if layer.is_none() => picture.layer("standard_error").map(|layer| Image {
                width: picture.image.width,
                height: picture.image.height,
                pixels: layer.channels.to_pixels(),
            }),
            None => None,
        };
        let (reference, coloured) = choose(reference, picture, layer)?;
        Ok(Pair { image, reference, standard_error, coloured })
    }

    /// How far the image is from the reference, see [`compare`].
    ///
    /// Errors: [`Error::Usage`] if sizes differ or no pixel is finite.
    pub fn figures(&self) -> Result<Figures> {
        let mut figures = compare(&self.image, &self.reference, self.standard_error.as_ref())?;
        if !self.coloured {
            figures.flip = None;
        }
        Ok(figures)
    }

    /// The difference one sees at the exposure chosen for the reference, as in [`Figures::flip`]; `None` if the images
    /// differ in size.
    pub fn flip(&self) -> Option<Flip> {
        shown_difference(&self.image, &self.reference)
    }

    /// The largest difference over all exposures, see [`hdr_flip`].
    pub fn hdr_flip(&self) -> Option<Flip> {
        hdr_flip(&self.reference, &self.image, DEFAULT_PIXELS_PER_DEGREE)
    }
}

/// FLIP of both images, tone-mapped alike at the exposure chosen for the reference.
fn shown_difference(image: &Image, reference: &Image) -> Option<Flip> {
    let tone = ToneSettings { exposure: Some(auto_exposure(reference)), ..ToneSettings::default() };
    let shown = [reference, image].map(|image| tone_map(image, &tone));
    flip(&shown[0], &shown[1], reference.width, DEFAULT_PIXELS_PER_DEGREE)
}

/// The image of `picture` or its layer, and whether it holds colours.
fn choose(path: &Path, picture: Picture, layer: Option<&str>) -> Result<(Image, bool)> {
    let Some(name) = layer else { return Ok((picture.image, true)) };
    match picture.layer(name) {
        Some(layer) => {
            let Image { width, height, .. } = picture.image;
            let coloured = matches!(layer.channels, super::LayerData::Rgb(_));
            Ok((Image { width, height, pixels: layer.channels.to_pixels() }, coloured))
        }
        None => {
            let names: Vec<&str> = picture.layers.iter().map(|layer| &*layer.name).collect();
            let known = if names.is_empty() { "it has none".into() } else { format!("it has {}", names.join(", ")) };
            Err(Error::asset(path, format!("there is no layer \"{name}\"; {known}")))
        }
    }
}

/// `value` with six decimals, or in powers of ten where those would hide it.
fn shown(value: f64) -> String {
    if value == 0.0 || (1e-2..1e6).contains(&value.abs()) { format!("{value:.6}") } else { format!("{value:.5e}") }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let triple = |[r, g, b]: [f64; 3]| [r, g, b].map(shown).join(" ");
        let black = "undefined: the reference's mean is 0";
        writeln!(f, "size       {} × {}", self.width, self.height)?;
        writeln!(f, "mean       {}", triple(self.mean))?;
        writeln!(f, "reference  {}", triple(self.reference_mean))?;
        let subtracted = if self.variance_subtracted { "  (reference's own variance subtracted)" } else { "" };
        writeln!(f, "RMSE       {}{subtracted}", shown(self.rmse))?;
        match self.rel_mse {
            Some(value) => writeln!(f, "relMSE     {}{subtracted}", shown(value))?,
            None => writeln!(f, "relMSE     {black}")?,
        }
        match self.bias {
            Some(value) => writeln!(f, "bias       {:+.3} %", 100.0 * value)?,
            None => writeln!(f, "bias       {black}")?,
        }
        if let Some(value) = self.flip {
            writeln!(f, "FLIP       {}", shown(value))?;
        }
        if let Some(value) = self.hdr_flip {
            writeln!(f, "HDR-FLIP   {}", shown(value))?;
        }
        for (whose, found) in [("image", self.non_finite), ("reference", self.reference_non_finite)] {
            if let Some(NonFinite { count, first: [x, y] }) = found {
                writeln!(f, "not finite {count} pixels of the {whose}, left out; the first in column {x}, row {y}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Layer, LayerData, write};
    use crate::math::Stream;
    use crate::math::random::Purpose;

    #[test]
    fn figures_follow_their_definitions() {
        let reference = Image { width: 2, height: 1, pixels: vec![[1.0, 2.0, 3.0], [0.0, 2.0, 4.0]] };
        let image = Image { width: 2, height: 1, pixels: vec![[1.5, 2.0, 3.0], [0.0, 1.0, 4.0]] };
        let figures = compare(&image, &reference, None).unwrap();
        assert_eq!((figures.mean, figures.reference_mean), ([0.75, 1.5, 3.5], [0.5, 2.0, 3.5]));
        assert!((figures.rmse - (1.25f64 / 6.0).sqrt()).abs() < 1e-12);
        // mean(R) = 2, so the denominators are 1.04 and 4.04.
        let expected = (0.25 / 1.04 + 1.0 / 4.04) / 6.0;
        assert!((figures.rel_mse.unwrap() - expected).abs() < 1e-12);
        assert!((figures.bias.unwrap() - (-0.5 / 6.0) / 2.0).abs() < 1e-12);

        let same = compare(&reference, &reference, None).unwrap();
        assert_eq!((same.rmse, same.rel_mse, same.bias, same.flip), (0.0, Some(0.0), Some(0.0), Some(0.0)));
        let black = Image::new(2, 1);
        let dark = compare(&image, &black, None).unwrap();
        assert_eq!((dark.rel_mse, dark.bias), (None, None));
        assert!(matches!(compare(&image, &Image::new(1, 2), None), Err(Error::Usage(_))));
    }

    #[test]
    fn noise_of_the_reference_is_not_held_against_the_image() {
        let mut random = Stream::new(5, Purpose::Test, 0, 0);
        // Uniform noise of the given standard deviation about 1.
        let mut noisy = |deviation: f64| {
            Image::from_fn(96, 96, |_, _| {
                [0; 3].map(|_| (1.0 + deviation * 12f64.sqrt() * (random.uniform() - 0.5)) as f32)
            })
        };
        let (image, reference) = (noisy(0.2), noisy(0.3));
        let error = Image { width: 96, height: 96, pixels: vec![[0.3; 3]; 96 * 96] };
        let figures = compare(&image, &reference, Some(&error)).unwrap();
        // Squares of the difference spread by at most √2 times their mean, 0.13.
        let bound = 3.0 * 2f64.sqrt() * 0.13 / (3.0 * 96.0 * 96.0f64).sqrt();
        assert!(figures.variance_subtracted && (figures.rmse.powi(2) - 0.04).abs() < bound, "{}", figures.rmse);
        assert!((compare(&image, &reference, None).unwrap().rmse.powi(2) - 0.13).abs() < bound);
    }

    #[test]
    fn pixels_that_are_not_finite_are_left_out_and_reported() {
        let reference = Image::from_fn(4, 4, |_, _| [1.0; 3]);
        let mut image = Image::from_fn(4, 4, |_, _| [1.5; 3]);
        image.pixels[6] = [1.0, f32::NAN, 1.0];
        image.pixels[9] = [f32::INFINITY, 1.0, 1.0];
        let figures = compare(&image, &reference, None).unwrap();
        assert_eq!(figures.non_finite, Some(NonFinite { count: 2, first: [2, 1] }));
        assert_eq!((figures.reference_non_finite, figures.rmse), (None, 0.5));
        assert!(figures.to_string().contains("column 2, row 1"));
        let nothing = Image::from_fn(4, 4, |_, _| [f32::NAN; 3]);
        assert!(matches!(compare(&nothing, &reference, None), Err(Error::Usage(_))));
    }

    #[test]
    fn files_and_their_layers_are_compared() {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, level: f32| {
            let plane = |value: f32| LayerData::Rgb(vec![[value; 3]; 64]);
            let layers = vec![
                Layer { name: "direct".into(), channels: plane(0.5 * level) },
                Layer { name: "standard_error".into(), channels: plane(0.25) },
                Layer { name: "depth".into(), channels: LayerData::Scalar(vec![level; 64]) },
            ];
            let path = folder.path().join(name);
            let image = Image::from_fn(8, 8, |_, _| [level; 3]);
            write(&path, &Picture { image, layers, attributes: Vec::new() }, &ToneSettings::default()).unwrap();
            path
        };
        let (image, reference) = (save("a.exr", 1.5), save("b.exr", 1.0));
        let layer = |name: &str| DiffOptions { layer: Some(name.into()), standard_error: None };

        let figures = |options: &DiffOptions| Pair::read(&image, &reference, options).unwrap().figures().unwrap();
        let whole = figures(&DiffOptions::default());
        assert!((whole.rmse - (0.25f64 - 0.0625).sqrt()).abs() < 1e-7 && whole.variance_subtracted);
        let direct = figures(&layer("direct"));
        assert!((direct.rmse - 0.25).abs() < 1e-7 && !direct.variance_subtracted && direct.flip.is_some());
        assert_eq!(figures(&layer("depth")).flip, None);
        let error = Pair::read(&image, &reference, &layer("caustic")).unwrap_err().to_string();
        assert!(error.contains("a.exr") && error.contains("it has depth, direct, standard_error"), "{error}");

        let json = serde_json::to_value(&whole).unwrap();
        assert_eq!((&json["width"], &json["bias"]), (&8.into(), &0.5.into()));
    }
}
