//! What errors are measured against: a file, an image made for the comparison, or a variant's own limit.

use std::fs;
use std::path::Path;
use std::time::Duration;

use serde::Serialize;

use super::context::{Context, Pair, settings};
use super::figures::Standard;
use super::lab::Lab;
use super::results::{Reference, ReferenceKind, Region};
use super::store::{Made, Store};
use super::variant::{self, Variant};
use crate::image::{self, Image, Layer, LayerData, Picture};
use crate::render::checkpoint::{self, Checkpoint, Subject};
use crate::render::{Component, End, Limits};
use crate::scene::{self, StudyReference};
use crate::{Error, Result};

/// Seeds of references differ from those of variants, whose noise they must not share.
const SEED: u64 = 0x7265_6665_7265_6e63;
/// Samples per pixel of a pass of a reference.
const SAMPLES: u32 = 16;
/// Passes that tell how far a variant's limit is from itself.
const PASSES: u32 = 16;

/// A reference with what is said of it.
#[derive(Clone, Debug)]
pub struct Known {
    pub standard: Standard,
    pub facts: Reference,
}

impl Known {
    fn new(standard: Standard, regions: &[Region], facts: Reference) -> Known {
        let facts = Reference {
            standard_error: standard.relative_error(),
            regions: regions.iter().map(|region| standard.region(region)).collect(),
            ..facts
        };
        Known { standard, facts }
    }
}

/// The reference of all variants; `None` where each has its own.
pub fn common(context: &Context<'_>, store: &Store, regions: &[Region]) -> Result<Option<Known>> {
    let (kind, method) = match &context.request.reference {
        StudyReference::Own => return Ok(None),
        StudyReference::File(path) => return file(path, context, store, regions).map(Some),
        StudyReference::Path => (ReferenceKind::Made, "path"),
        StudyReference::Photon => (ReferenceKind::Made, "photon"),
    };
    let mut set = vec![("render.method".to_string(), method.to_string())];
    if method == "path" {
        set.push(("render.samples".to_string(), SAMPLES.to_string()));
    }
    set.extend(context.request.reference_set.iter().cloned());
    let limits = Limits {
        target_error: Some(context.request.reference_error),
        time: Some(Duration::from_secs_f64(context.request.reference_time)),
        ..Limits::default()
    };
    let (standard, made) = make("reference", None, &set, &limits, context, store)?;
    let facts = Reference {
        kind,
        method: Some(method.to_string()),
        image: Some("reference.exr".to_string()),
        standard_error: None,
        samples: Some(made.samples),
        seconds: Some(made.seconds),
        set: settings(&context.request.reference_set),
        regions: Vec::new(),
    };
    Ok(Some(Known::new(standard, regions, facts)))
}

/// The limit of a variant on the common map: what it comes to with many samples.
pub fn limit(variant: &Variant, context: &Context<'_>, store: &Store, regions: &[Region]) -> Result<Known> {
    let finer = variant::limit(variant, context)?;
    let mut set = variant.set.clone();
    set.extend(finer.iter().cloned());
    let passes = PASSES.min(context.request.limit_samples);
    let samples = context.request.limit_samples.div_ceil(passes);
    set.push(("render.samples".to_string(), samples.to_string()));
    let limits = Limits { passes: Some(1..=passes), ..Limits::default() };
    // Variants that differ only in what their limits do not have share one.
    let description = context.describe(&variant.asked.name, &set)?;
    let name = format!("limits/{}", &context.digest(&Subject::new(&description, 1).fingerprint())?[..12]);
    let (standard, made) = make(&name, Some(&variant.asked.name), &set, &limits, context, store)?;
    let facts = Reference {
        kind: ReferenceKind::Own,
        method: Some(description.render.method.name().to_string()),
        image: Some(format!("{name}.exr")),
        standard_error: None,
        samples: Some(made.samples),
        seconds: Some(made.seconds),
        set: settings(&finer),
        regions: Vec::new(),
    };
    Ok(Known::new(standard, regions, facts))
}

/// What a reference depends on.
#[derive(Serialize)]
struct Asked {
    settings: String,
    /// First and last of its passes.
    passes: Option<(u32, u32)>,
    /// Seconds it may take.
    time: Option<f64>,
    target_error: Option<f64>,
    map: Option<(String, u64)>,
}

/// Reads the reference called `name` from the folder, or makes it.
fn make(
    name: &str,
    variant: Option<&str>,
    set: &[Pair],
    limits: &Limits,
    context: &Context<'_>,
    store: &Store,
) -> Result<(Standard, Made)> {
    let request = context.request;
    let mut description = context.describe(variant.unwrap_or(name), set)?;
    description.render.seed = SEED;
    let subject = Subject::new(&description, 1);
    let [image, facts, part] = ["exr", "json", "part"].map(|ending| format!("{name}.{ending}"));
    let digest = context.digest(&Asked {
        settings: subject.fingerprint(),
        passes: limits.passes.as_ref().map(|passes| (*passes.start(), *passes.end())),
        time: limits.time.map(|time| time.as_secs_f64()),
        target_error: limits.target_error,
        map: variant.and_then(|_| context.map()),
    })?;
    if let Some(made) = store.read::<Made>(&facts).filter(|made| made.digest == digest)
        && let Ok(picture) = image::read(store.path(&image))
        && let Some(error) = picture.layer("standard_error").and_then(|layer| plane(&picture.image, layer))
    {
        return Ok((Standard { image: picture.image, error: Some(error) }, made));
    }

    let built = scene::build(&description)?;
    context.watch.begins(&match variant {
        Some(variant) => format!("{variant}: limit with {} samples", request.limit_samples),
        None => format!("reference to {} %", 100.0 * request.reference_error),
    });
    let photons = variant.and(context.shared());
    let mut lab = Lab::new(built, photons, request.components()?, context.watch, context.stop)?;
    let limits = Limits { resumable: true, shown: lab.limits().shown, ..limits.clone() };
    // An interrupted one goes on.
    let begun = store.read::<String>(&format!("{part}.json")).is_some_and(|begun| begun == digest);
    let before = begun.then(|| Checkpoint::read(store.path(&part)).ok()).flatten();
    let before = before.map(|checkpoint| (checkpoint.film, checkpoint.stats));
    let spent =
        before.as_ref().map_or(0.0, |(_, stats)| stats.render_seconds + stats.photons_seconds + stats.build_seconds);
    let limits = match limits.time {
        Some(time) => Limits { time: Some(time.saturating_sub(Duration::from_secs_f64(spent))), ..limits },
        None => limits,
    };
    let rendering = lab.render(&limits, before, &context.watch, context.stop)?;
    if rendering.end == End::Interrupted {
        if rendering.film.done().count() > 0 {
            store.write(&format!("{part}.json"), &digest)?;
            checkpoint::write(store.path(&part), &subject, &rendering.film, &rendering.stats)?;
        }
        return Err(Error::Interrupted);
    }
    let picture = Picture { image: rendering.film.image(), layers: rendering.film.layers(), attributes: Vec::new() };
    let Some(error) = picture.layer("standard_error").and_then(|layer| plane(&picture.image, layer)) else {
        return Err(Error::Limit(format!(
            "the reference had time for {} passes; two at least tell its error: allow more for it, or give one as a file",
            rendering.stats.passes
        )));
    };
    let stats = &rendering.stats;
    let seconds = stats.photons_seconds + stats.build_seconds + stats.render_seconds;
    let made = Made { digest, samples: stats.samples, seconds };
    store.write_image(&image, &picture)?;
    store.write(&facts, &made)?;
    for left in [format!("{part}.json"), part] {
        // A leftover does no harm.
        let _ = fs::remove_file(store.path(&left));
    }
    Ok((Standard { image: picture.image, error: Some(error) }, made))
}

/// A reference that was given, copied beside the results.
fn file(path: &Path, context: &Context<'_>, store: &Store, regions: &[Region]) -> Result<Known> {
    let picture = image::read(path)?;
    let (width, height) = context.base.film.size();
    let (width, height) = (width as usize, height as usize);
    if (picture.image.width, picture.image.height) != (width, height) {
        return Err(Error::asset(
            path,
            format!(
                "this reference has {} × {} pixels, the scene {width} × {height}; equal sizes are expected: set film.width and film.height, or give another reference",
                picture.image.width, picture.image.height
            ),
        ));
    }
    let (image, error) = match context.request.components()? {
        None => {
            let error = picture.layer("standard_error").and_then(|layer| plane(&picture.image, layer));
            (picture.image, error)
        }
        Some(components) => (sum(path, &picture, &components)?, None),
    };
    let layer =
        |error: &Image| Layer { name: "standard_error".to_string(), channels: LayerData::Rgb(error.pixels.clone()) };
    let layers = error.iter().map(layer).collect();
    store.write_image("reference.exr", &Picture { image: image.clone(), layers, attributes: Vec::new() })?;
    // It is none that could be taken for one that was made.
    let _ = fs::remove_file(store.path("reference.json"));
    let facts = Reference {
        kind: ReferenceKind::File,
        method: None,
        image: Some("reference.exr".to_string()),
        standard_error: None,
        samples: None,
        seconds: None,
        set: Vec::new(),
        regions: Vec::new(),
    };
    Ok(Known::new(Standard { image, error }, regions, facts))
}

/// The sum of layers; those that are black throughout may be missing, but not all of them.
fn sum(path: &Path, picture: &Picture, components: &[Component]) -> Result<Image> {
    let layers: Vec<Image> = components
        .iter()
        .filter_map(|component| picture.layer(component.name()))
        .filter_map(|layer| plane(&picture.image, layer))
        .collect();
    if layers.is_empty() {
        let wanted: Vec<&str> = components.iter().map(|component| component.name()).collect();
        let names: Vec<&str> = picture.layers.iter().map(|layer| layer.name.as_str()).collect();
        let known = if names.is_empty() { "it has none".to_string() } else { format!("it has {}", names.join(", ")) };
        return Err(Error::asset(path, format!("there is no layer {}; {known}", wanted.join(" or "))));
    }
    let mut image = Image::new(picture.image.width, picture.image.height);
    for layer in layers {
        for (sum, value) in image.pixels.as_flattened_mut().iter_mut().zip(layer.pixels.as_flattened()) {
            *sum += value;
        }
    }
    Ok(image)
}

/// A layer of colours as an image.
fn plane(image: &Image, layer: &Layer) -> Option<Image> {
    match &layer.channels {
        LayerData::Rgb(pixels) => Some(Image { width: image.width, height: image.height, pixels: pixels.clone() }),
        _ => None,
    }
}
