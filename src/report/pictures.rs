//! The pictures of a report: images as they are shown, maps of FLIP and of signed errors, crops.

use std::fs;
use std::path::Path;

use super::analysis::{common_budget, last_measured, measured};
use crate::compare::results::{Region, Results, Variant};
use crate::image::{
    self, DEFAULT_PIXELS_PER_DEGREE, Image, Palette, ToneMap, ToneSettings, auto_exposure, flip, range_of,
    signed_errors, tone_map, write_pixels,
};
use crate::{Error, Result};

/// The folder of the pictures, in that of the report.
const FOLDER: &str = "pictures";

/// Everything that was drawn. Paths are relative to the folder of the report.
pub struct Pictures {
    /// Stops by which all images are brightened.
    pub exposure: f64,
    /// Maps of signed errors reach from −range to range.
    pub range: f64,
    /// The common reference.
    pub reference: Option<String>,
    /// By variant, in their order.
    pub variants: Vec<VariantPictures>,
    /// The parts of the image that are shown enlarged.
    pub crops: Vec<Crop>,
}

/// The pictures of a variant.
pub struct VariantPictures {
    /// What it is judged by, if that is not the common reference.
    pub limit: Option<String>,
    /// One for each budget; `None` where it was not reached.
    pub budgets: Vec<Option<Shown>>,
}

impl VariantPictures {
    /// Those of the last budget that was reached.
    pub fn last(&self) -> Option<&Shown> {
        self.budgets.iter().rev().find_map(Option::as_ref)
    }
}

/// The pictures of a variant at a budget.
pub struct Shown {
    /// The image of the first seed.
    pub image: String,
    /// Where that image differs from the reference.
    pub maps: Option<Maps>,
    /// The mean over seeds.
    pub mean: Option<String>,
    /// The map of signed errors of that mean.
    pub mean_error: Option<String>,
}

/// Where an image differs from its reference.
pub struct Maps {
    /// The map of FLIP.
    pub flip: String,
    /// The mean of FLIP over the image.
    pub flip_mean: f64,
    /// The map of signed errors.
    pub error: String,
}

/// A part of the image, enlarged.
pub struct Crop {
    /// What the crop is called.
    pub name: String,
    /// Where it is: column, row, width, height.
    pub place: [usize; 4],
    /// The crop of the reference.
    pub reference: Option<String>,
    /// By variant: budget, image and map of signed errors.
    pub variants: Vec<Option<(usize, String, Option<String>)>>,
}

/// An image with what belongs to it.
struct Judged {
    image: Image,
    errors: Option<Vec<f64>>,
}

/// All images side by side, in the folder of the report.
const OVERVIEW: &str = "overview.png";

/// White pixels between the images of an overview.
const GAP: usize = 2;

/// Draws all pictures into the folder of the report.
///
/// Errors: [`Error::Asset`] for images that are missing or of another size, [`Error::Output`].
pub fn draw(results: &Results, dir: &Path) -> Result<Pictures> {
    let folder = dir.join(FOLDER);
    fs::create_dir_all(&folder).map_err(|error| Error::output(&folder, error))?;
    let reader = Reader { dir, width: results.scene.width as usize, height: results.scene.height as usize };
    let common = results.reference.image.as_deref().map(|path| reader.read(path)).transpose()?;
    let limits = results.variants.iter().map(|variant| reader.limit(variant)).collect::<Result<Vec<_>>>()?;
    let judge = |variant: usize| limits[variant].as_ref().or(common.as_ref());

    // What crops show: each variant where they are compared, else at its last measure.
    let budget_of = |variant: &Variant| {
        let common = common_budget(results).filter(|&k| measured(variant, k).is_some());
        common.or_else(|| last_measured(variant).map(|(k, _)| k))
    };
    let mut last: Vec<Option<(usize, Judged)>> = Vec::new();
    for (v, variant) in results.variants.iter().enumerate() {
        last.push(match budget_of(variant).and_then(|k| Some((k, measured(variant, k)?))) {
            Some((k, measured)) => {
                let image = reader.read(&measured.image)?;
                let errors = judge(v).and_then(|reference| signed_errors(&image, reference));
                Some((k, Judged { image, errors }))
            }
            None => None,
        });
    }
    // One exposure and one range for all, so that pictures can be compared.
    let shown = common.as_ref().or(limits.iter().flatten().next());
    let shown = shown.or(last.iter().flatten().next().map(|(_, judged)| &judged.image));
    let exposure = results.scene.exposure.or(shown.map(auto_exposure)).unwrap_or(0.0);
    let curve = if results.scene.filmic { ToneMap::Filmic } else { ToneMap::Linear };
    let artist = Artist {
        dir,
        tone: ToneSettings { exposure: Some(exposure), curve },
        range: range_of(last.iter().flatten().flat_map(|(_, judged)| judged.errors.iter().flatten().copied())),
    };

    let columns: Vec<_> = last.iter().flatten().map(|(_, judged)| (&judged.image, judged.errors.as_deref())).collect();
    artist.overview(common.as_ref(), &columns, reader.width, reader.height)?;
    let reference = common.as_ref().map(|image| artist.image(image, "reference")).transpose()?;
    let mut variants = Vec::new();
    for (v, variant) in results.variants.iter().enumerate() {
        let stem = stem(&variant.name);
        let limit = limits[v].as_ref().map(|image| artist.image(image, &format!("{stem}-limit"))).transpose()?;
        let mut budgets = Vec::new();
        for k in 0..variant.measures.len() {
            let Some(measured) = measured(variant, k) else {
                budgets.push(None);
                continue;
            };
            let stem = format!("{stem}-{}", k + 1);
            let mean = measured.mean_image.as_deref().map(|path| reader.read(path)).transpose()?;
            budgets.push(Some(artist.measure(&reader.read(&measured.image)?, mean.as_ref(), judge(v), &stem)?));
        }
        variants.push(VariantPictures { limit, budgets });
    }

    let mut crops = Vec::new();
    for region in regions(results, &last) {
        let window = Window::within(&region, reader.width, reader.height);
        let stem_of = |name: &str| format!("{}-{}", stem(name), stem(&region.name));
        let show = |image: &Image, name: &str| artist.image(&window.cut(image), &stem_of(name));
        let mut shown = Vec::new();
        for (variant, judged) in results.variants.iter().zip(&last) {
            let Some((k, judged)) = judged else {
                shown.push(None);
                continue;
            };
            let image = show(&judged.image, &format!("{}-{}", variant.name, k + 1))?;
            let errors = judged.errors.as_ref().map(|errors| window.of(errors, reader.width));
            let name = stem_of(&format!("{}-{}", variant.name, k + 1)) + "-error";
            let error = errors.map(|errors| artist.errors(&errors, window.width, &name)).transpose()?;
            shown.push(Some((*k, image, error)));
        }
        crops.push(Crop {
            place: [window.x, window.y, window.width, window.height],
            reference: common.as_ref().map(|image| show(image, "reference")).transpose()?,
            variants: shown,
            name: region.name,
        });
    }
    Ok(Pictures { exposure, range: artist.range, reference, variants, crops })
}

/// A name as part of a file's.
fn stem(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

/// The regions that are shown enlarged: those that were asked for, or else the two places where the variants are
/// farthest from their references.
fn regions(results: &Results, last: &[Option<(usize, Judged)>]) -> Vec<Region> {
    if results.regions.len() > 1 {
        return results.regions[1..].to_vec();
    }
    let (width, height) = (results.scene.width as usize, results.scene.height as usize);
    let side = (width.min(height) / 5).max(8);
    if side * 2 > width.min(height) {
        return Vec::new();
    }
    // Mean errors of blocks half as wide as the crops, the largest of the variants.
    let step = side / 2;
    let (columns, rows) = (width / step, height / step);
    let mut blocks = vec![0.0f64; columns * rows];
    for errors in last.iter().flatten().filter_map(|(_, judged)| judged.errors.as_ref()) {
        let mut sums = vec![0.0; columns * rows];
        for (i, error) in errors.iter().enumerate().filter(|(_, error)| error.is_finite()) {
            let (x, y) = (i % width / step, i / width / step);
            if x < columns && y < rows {
                sums[y * columns + x] += error.abs().min(1.0);
            }
        }
        blocks.iter_mut().zip(sums).for_each(|(most, sum)| *most = most.max(sum));
    }
    let worth = |x: usize, y: usize| {
        [(0, 0), (1, 0), (0, 1), (1, 1)].iter().map(|(dx, dy)| blocks[(y + dy) * columns + x + dx]).sum::<f64>()
    };
    let mut places: Vec<(f64, usize, usize)> = (0..rows - 1)
        .flat_map(|y| (0..columns - 1).map(move |x| (x, y)))
        .map(|(x, y)| (worth(x, y), x * step, y * step))
        .filter(|(worth, ..)| *worth > 0.0)
        .collect();
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some(&(_, x, y)) = places.first() else { return Vec::new() };
    let far = places.iter().find(|(_, u, v)| u.abs_diff(x).max(v.abs_diff(y)) >= 2 * side);
    let chosen = [Some((x, y)), far.map(|(_, u, v)| (*u, *v))];
    chosen
        .into_iter()
        .flatten()
        .zip(["largest-errors", "large-errors-elsewhere"])
        .map(|((x, y), name)| Region {
            name: name.into(),
            x: x as u32,
            y: y as u32,
            width: side as u32,
            height: side as u32,
        })
        .collect()
}

/// A rectangle of an image.
struct Window {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl Window {
    /// The part of a region that an image has: a pixel at least.
    fn within(region: &Region, width: usize, height: usize) -> Window {
        let (x, y) = (region.x as usize, region.y as usize);
        let (x, y) = (x.min(width.saturating_sub(1)), y.min(height.saturating_sub(1)));
        let [w, h] = [region.width, region.height].map(|size| (size as usize).max(1));
        Window { x, y, width: w.min(width - x), height: h.min(height - y) }
    }

    /// Its part of a plane.
    fn of<T: Copy>(&self, plane: &[T], width: usize) -> Vec<T> {
        (self.y..self.y + self.height).flat_map(|y| plane[y * width + self.x..][..self.width].iter().copied()).collect()
    }

    fn cut(&self, image: &Image) -> Image {
        Image { width: self.width, height: self.height, pixels: self.of(&image.pixels, image.width) }
    }
}

/// Reads images of the comparison.
struct Reader<'d> {
    dir: &'d Path,
    width: usize,
    height: usize,
}

impl Reader<'_> {
    fn read(&self, path: &str) -> Result<Image> {
        let path = self.dir.join(path);
        let image = image::read(&path)?.image;
        if (image.width, image.height) != (self.width, self.height) {
            return Err(Error::asset(
                path,
                format!(
                    "the image has {} × {} pixels, the results speak of {} × {}",
                    image.width, image.height, self.width, self.height
                ),
            ));
        }
        Ok(image)
    }

    /// The reference that is a variant's own.
    fn limit(&self, variant: &Variant) -> Result<Option<Image>> {
        variant.limit.as_ref().and_then(|limit| limit.image.as_deref()).map(|path| self.read(path)).transpose()
    }
}

/// Writes pictures and maps into a folder.
struct Artist<'d> {
    dir: &'d Path,
    tone: ToneSettings,
    range: f64,
}

impl Artist<'_> {
    fn write(&self, pixels: &[[u8; 3]], width: usize, stem: &str) -> Result<String> {
        let path = format!("{FOLDER}/{stem}.png");
        write_pixels(self.dir.join(&path), pixels, width)?;
        Ok(path)
    }

    fn image(&self, image: &Image, stem: &str) -> Result<String> {
        self.write(&tone_map(image, &self.tone), image.width, stem)
    }

    fn errors(&self, errors: &[f64], width: usize, stem: &str) -> Result<String> {
        self.write(&self.coloured(errors), width, stem)
    }

    fn coloured(&self, errors: &[f64]) -> Vec<[u8; 3]> {
        errors.iter().map(|error| Palette::Diverging.colour(error / self.range)).collect()
    }

    /// The reference and the variants' images beside each other, and below each image its signed errors.
    fn overview(
        &self,
        reference: Option<&Image>,
        columns: &[(&Image, Option<&[f64]>)],
        width: usize,
        height: usize,
    ) -> Result<()> {
        let columns: Vec<_> = reference.map(|image| (image, None)).into_iter().chain(columns.iter().copied()).collect();
        let rows = if columns.iter().any(|(_, errors)| errors.is_some()) { 2 } else { 1 };
        if columns.is_empty() {
            return Ok(());
        }
        let across = columns.len() * (width + GAP) - GAP;
        let mut pixels = vec![[255; 3]; across * (rows * (height + GAP) - GAP)];
        let mut place = |part: &[[u8; 3]], column: usize, row: usize| {
            for (y, line) in part.chunks_exact(width).enumerate() {
                pixels[(row * (height + GAP) + y) * across + column * (width + GAP)..][..width].copy_from_slice(line);
            }
        };
        for (column, (image, errors)) in columns.into_iter().enumerate() {
            place(&tone_map(image, &self.tone), column, 0);
            if let Some(errors) = errors {
                place(&self.coloured(errors), column, 1);
            }
        }
        write_pixels(self.dir.join(OVERVIEW), &pixels, across)
    }

    fn measure(&self, image: &Image, mean: Option<&Image>, reference: Option<&Image>, stem: &str) -> Result<Shown> {
        let error = |image: &Image, stem: &str| -> Result<Option<String>> {
            let errors = reference.and_then(|reference| signed_errors(image, reference));
            errors.map(|errors| self.errors(&errors, image.width, stem)).transpose()
        };
        let maps = match (reference, error(image, &format!("{stem}-error"))?) {
            (Some(reference), Some(error)) => {
                let [seen, tried] = [reference, image].map(|image| tone_map(image, &self.tone));
                match flip(&seen, &tried, image.width, DEFAULT_PIXELS_PER_DEGREE) {
                    Some(flip) => {
                        let colours = flip.map.iter().map(|&value| Palette::Magma.colour(f64::from(value)));
                        let path = self.write(&colours.collect::<Vec<_>>(), image.width, &format!("{stem}-flip"))?;
                        Some(Maps { flip: path, flip_mean: flip.mean, error })
                    }
                    None => None,
                }
            }
            _ => None,
        };
        Ok(Shown {
            image: self.image(image, stem)?,
            maps,
            mean: mean.map(|mean| self.image(mean, &format!("{stem}-mean"))).transpose()?,
            mean_error: match mean {
                Some(mean) => error(mean, &format!("{stem}-mean-error"))?,
                None => None,
            },
        })
    }
}
