//! Error against run time: several estimates of one scene, each refined once and measured on the way.
//!
//! A [`Request`] says what to compare, [`run()`] does it in a folder, and [`Results`] say what was found. What is measured,
//! and how, is told in `docs/compare.md`; the figures are defined in [`results`].

mod csv;
mod figures;
mod lab;
mod machine;
mod meter;
mod reference;
pub mod results;
mod store;
mod tune;
mod variant;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use crate::image::Image;
use crate::render::checkpoint::Subject;
use crate::render::{Component, Progress, SharedPhotons};
use crate::scene::description::{Description, Method, ToneMap};
use crate::scene::{self, Study, StudyReference, StudyVariant};
use crate::{Error, Result};

pub use machine::peak_bytes;
pub use results::Results;
pub use variant::parse as parse_variants;

use figures::{Standard, figures, mean};
use lab::Lab;
use reference::Known;
use results::{BudgetKind, Budgets, Measure, Measured, Reference, ReferenceKind, Region, SameMap, Setting, Statistics};
use store::{Run, Shot, Store, label};
use variant::{Pair, Tunable, Variant};

/// Hears how far a comparison has come.
pub trait Watch: Progress {
    /// Something begins: a reference, or a run of a variant.
    fn begins(&self, what: &str);
}

/// What to compare.
#[derive(Clone, Debug)]
pub struct Request {
    /// The scene file.
    pub scene: PathBuf,
    /// The study file's text, if it is another.
    pub study: Option<String>,
    /// Overrides for all variants, `key=value`.
    pub set: Vec<String>,
    /// The variants; none: the built-in ones but `beam-fixed`, and but `path` where all share a map.
    pub variants: Vec<StudyVariant>,
    /// Where to measure; `None`: at 1, 2, 4… seconds up to `time`, from the first that no variant misses.
    pub budgets: Option<Budgets>,
    /// Seconds that a variant may take; `None`: 60 where budgets do not say it.
    pub time: Option<f64>,
    /// How many seeds, from the scene's on.
    pub seeds: u32,
    /// What errors are measured against.
    pub reference: StudyReference,
    /// What a reference that is made has besides.
    pub reference_set: Vec<(String, String)>,
    /// The relative standard error that it is made to.
    pub reference_error: f64,
    /// Seconds that it may take.
    pub reference_time: f64,
    /// Camera samples per pixel of variants' own limits.
    pub limit_samples: u32,
    /// Whether all variants gather from one map.
    pub same_map: bool,
    /// The layers to measure: `volume`, or names joined by `+`.
    pub layer: Option<String>,
    /// Parts of the image: name, then leftmost column, top row, width and height.
    pub regions: Vec<(String, [u32; 4])>,
    /// The key to be chosen so that variants take the time given.
    pub tune: Option<String>,
}

impl Request {
    /// What the file at `path` asks for: a study, a scene that holds one, or a scene as it is.
    ///
    /// # Errors
    /// As [`scene::read_study`].
    pub fn read(path: &Path) -> Result<Request> {
        let (study, text) = scene::read_study(path)?;
        let study = study.unwrap_or_default();
        let budgets = |kind, values| Some(Budgets { kind, values });
        let Study { time, same_map, layer, regions, tune, variants, .. } = study;
        Ok(Request {
            study: study.scene.is_some().then_some(text),
            scene: study.scene.unwrap_or_else(|| path.to_owned()),
            set: study.set.iter().map(|(key, value)| format!("{key}={value}")).collect(),
            variants,
            budgets: match (study.budgets, study.samples) {
                (Some(seconds), _) => budgets(BudgetKind::Seconds, seconds),
                (None, Some(samples)) => budgets(BudgetKind::Samples, samples.into_iter().map(f64::from).collect()),
                (None, None) => None,
            },
            time,
            seeds: study.seeds.unwrap_or(1),
            reference: study.reference.unwrap_or(StudyReference::Path),
            reference_set: study.reference_set,
            reference_error: study.reference_error.unwrap_or(0.02),
            reference_time: study.reference_time.unwrap_or(600.0),
            limit_samples: study.limit_samples.unwrap_or(256),
            same_map: same_map.unwrap_or(false),
            layer,
            regions,
            tune,
        })
    }

    /// The components that are measured; `None`: all.
    fn components(&self) -> Result<Option<Vec<Component>>> {
        let Some(layer) = &self.layer else { return Ok(None) };
        let mut components: Vec<Component> = Vec::new();
        for name in layer.split('+').map(str::trim) {
            let named: Vec<Component> = match name {
                "volume" => vec![Component::VolumeEmission, Component::VolumeSingle, Component::VolumeMultiple],
                name => Component::ALL.into_iter().filter(|component| component.name() == name).collect(),
            };
            if named.is_empty() {
                let names: Vec<&str> = Component::ALL.iter().map(|component| component.name()).collect();
                return Err(Error::Usage(format!(
                    "there is no layer {name:?}; expected volume, or some of {}, joined by +",
                    names.join(", ")
                )));
            }
            components.extend(named);
        }
        Ok(Some(components))
    }

    /// Where to measure, and whether budgets that not all variants reach are left out at the start.
    fn where_to_measure(&self) -> Result<(Budgets, bool)> {
        if let Some(budgets) = &self.budgets {
            let ascends = budgets.values.windows(2).all(|pair| pair[0] < pair[1]);
            let positive = budgets.values.iter().all(|&value| value > 0.0 && value.is_finite());
            if budgets.values.is_empty() || !ascends || !positive {
                return Err(Error::Usage("budgets must be above 0, each larger than the one before".to_string()));
            }
            return Ok((budgets.clone(), false));
        }
        let time = self.time.unwrap_or(60.0);
        let mut values: Vec<f64> = (0..30).map(|k| f64::from(1u32 << k)).take_while(|&value| value < time).collect();
        values.push(time);
        Ok((Budgets { kind: BudgetKind::Seconds, values }, true))
    }
}

/// What is common to all parts of a comparison.
struct Context<'r> {
    request: &'r Request,
    /// Overrides for all variants.
    set: Vec<String>,
    /// The scene as it is for all.
    base: Description,
    watch: &'r dyn Watch,
    stop: &'r AtomicBool,
    photons: Option<SharedPhotons>,
    /// What differs between builds of the program.
    build: u128,
}

impl<'r> Context<'r> {
    fn new(request: &'r Request, watch: &'r dyn Watch, stop: &'r AtomicBool) -> Result<Context<'r>> {
        let mut set = request.set.clone();
        // Layers cost time and memory; only one kind of scattering cannot be told without.
        let components = request.components()?.unwrap_or_default();
        let tells = components.contains(&Component::VolumeSingle) != components.contains(&Component::VolumeMultiple);
        set.push(format!("film.layers={tells}"));
        let base = scene::read(&request.scene, &set)?;
        Ok(Context { request, set, base, watch, stop, photons: None, build: machine::build() })
    }

    /// The scene with further settings; errors name the variant they are of.
    fn describe(&self, variant: &str, set: &[Pair]) -> Result<Description> {
        let mut all = self.set.clone();
        all.extend(set.iter().map(|(key, value)| format!("{key}={value}")));
        scene::read(&self.request.scene, &all).map_err(|error| match error {
            Error::Scene(message) => Error::Scene(format!("variant {variant}: {message}")),
            other => other,
        })
    }

    /// The photons that all variants share, or that tell how wide kernels should be.
    fn photons(&mut self) -> Result<&SharedPhotons> {
        if self.photons.is_none() {
            self.watch.begins("photons");
            let mut base = self.base.clone();
            base.render.method = Method::Photon;
            let (scene, settings) = scene::build(&base)?;
            self.photons = Some(SharedPhotons::trace(&scene, &settings, &self.watch, self.stop)?);
        }
        self.photons.as_ref().ok_or(Error::Interrupted)
    }

    /// The photons of the common map, if there is one.
    fn shared(&self) -> Option<&SharedPhotons> {
        self.photons.as_ref().filter(|_| self.request.same_map)
    }

    /// A short text that differs where any of `parts` does, or the program, or what is measured.
    fn digest(&self, parts: &[&str]) -> String {
        let mut text = format!("{:032x} {:?} {:?}", self.build, self.request.layer, rayon::current_num_threads());
        parts.iter().for_each(|part| text.push_str(&format!("\n{part}")));
        format!("{:032x}", xxhash_rust::xxh3::xxh3_128(text.as_bytes()))
    }

    /// What the common map is of, for those who gather from it.
    fn map_digest(&self, gathers: bool) -> String {
        if !gathers || !self.request.same_map {
            return String::new();
        }
        format!("{} {}", Subject::new(&self.base, 1).fingerprint(), self.base.render.seed)
    }
}

/// Key and value as results hold them.
fn settings(pairs: &[Pair]) -> Vec<Setting> {
    pairs.iter().map(|(key, value)| Setting { key: key.clone(), value: value.clone() }).collect()
}

fn method_name(description: &Description) -> String {
    match description.render.method {
        Method::Photon => "photon".to_string(),
        Method::Path => "path".to_string(),
    }
}

/// Compares, in `folder`: what it already holds of the same comparison is not repeated. Runs on the current thread pool;
/// `stop` ends it early, and what was measured by then is in the results, which are written to the folder too.
///
/// # Errors
/// [`Error::Usage`], [`Error::Scene`] and [`Error::Asset`] for what cannot be compared; [`Error::Output`] where the folder
/// cannot be written to; [`Error::Interrupted`] if nothing was measured yet.
pub fn run(request: &Request, folder: &Path, watch: &dyn Watch, stop: &AtomicBool) -> Result<Results> {
    let (budgets, trim) = request.where_to_measure()?;
    let mut context = Context::new(request, watch, stop)?;
    let regions = regions(request, &context.base)?;
    let store = Store::new(folder)?;
    let variants = variants(&mut context, &budgets)?;
    if request.same_map {
        context.photons()?;
    }
    let common = reference::common(&context, &store, &regions)?;
    let comparison = Comparison { context: &context, store: &store, budgets, regions, common };
    let mut found: Vec<Found> = variants.into_iter().map(Found::new).collect();
    let complete = match comparison.measure(&mut found) {
        Ok(()) => true,
        Err(Error::Interrupted) if found.iter().any(|found| !found.runs.is_empty()) => false,
        Err(error) => return Err(error),
    };
    let results = comparison.results(&found, complete, trim)?;
    store.write_results(&results)?;
    Ok(results)
}

/// The regions with the whole image first.
fn regions(request: &Request, base: &Description) -> Result<Vec<Region>> {
    let (width, height) = (base.film.width, base.film.height);
    let mut regions = vec![Region { name: "image".to_string(), x: 0, y: 0, width, height }];
    for (name, [x, y, w, h]) in &request.regions {
        let fits = |from: u32, size: u32, all: u32| size > 0 && from.checked_add(size).is_some_and(|end| end <= all);
        if !fits(*x, *w, width) || !fits(*y, *h, height) {
            return Err(Error::Usage(format!(
                "region {name}={x},{y},{w},{h} is not within the image of {width} × {height} pixels"
            )));
        }
        if regions.iter().any(|region| region.name == *name) {
            return Err(Error::Usage(format!("two regions are named {name:?}")));
        }
        regions.push(Region { name: name.clone(), x: *x, y: *y, width: *w, height: *h });
    }
    Ok(regions)
}

/// Keys that variants may set although they share photons: how these are gathered.
fn is_of_gathering(key: &str) -> bool {
    let key = key.trim();
    (key.starts_with("volume.") && key != "volume.single_scattering")
        || matches!(key, "render.method" | "render.samples")
}

/// What was asked for, checked and with everything it sets.
fn variants(context: &mut Context<'_>, budgets: &Budgets) -> Result<Vec<Variant>> {
    let request = context.request;
    let default = |name: &&(&str, _)| name.0 != "beam-fixed" && (name.0 != "path" || !request.same_map);
    let asked: Vec<StudyVariant> = if request.variants.is_empty() {
        let names = variant::BUILT_IN.iter().filter(default);
        names.map(|(name, _)| StudyVariant { name: name.to_string(), ..StudyVariant::default() }).collect()
    } else {
        request.variants.clone()
    };
    if request.reference == StudyReference::Own && !request.same_map {
        return Err(Error::Usage(
            "a reference of each variant's own needs one map for all: add --same-map (same_map = true)".to_string(),
        ));
    }
    for (index, variant) in asked.iter().enumerate() {
        if asked[..index].iter().any(|other| other.name == variant.name) {
            return Err(Error::Usage(format!("two variants are named {}", variant.name)));
        }
        let other = variant.set.iter().find(|(key, _)| !is_of_gathering(key));
        if let (true, Some((key, _))) = (request.same_map, other) {
            return Err(Error::Usage(format!(
                "variant {} sets {key}, but with one map for all, variants differ only in how they gather: set it for all of them with --set, or leave --same-map out",
                variant.name
            )));
        }
    }
    let mut variants = Vec::new();
    for asked in &asked {
        let mut variant = Variant::new(asked, context)?;
        let (film, base) = (&variant.description.film, &context.base.film);
        if (film.width, film.height) != (base.width, base.height) {
            return Err(Error::Usage(format!(
                "variant {} has {} × {} pixels, the scene {} × {}; all variants need one size",
                asked.name, film.width, film.height, base.width, base.height
            )));
        }
        let common = request.tune.as_deref().map(Tunable::of).transpose()?;
        variant.tune = match &asked.tune {
            Some(key) => Some(Tunable::of(key)?),
            None => common.filter(|tunable| tunable.concerns(&variant)),
        };
        check_tuning(&variant, context, budgets)?;
        variants.push(variant);
    }
    Ok(variants)
}

fn check_tuning(variant: &Variant, context: &Context<'_>, budgets: &Budgets) -> Result<()> {
    let name = &variant.asked.name;
    let Some(tunable) = variant.tune else {
        if !variant.asked.samples.is_empty() {
            return Err(Error::Usage(format!(
                "variant {name} has numbers of samples to try, but nothing to tune: give it `tune`"
            )));
        }
        return Ok(());
    };
    if !tunable.concerns(variant) {
        return Err(Error::Usage(format!("variant {name} does not depend on {}", tunable.key())));
    }
    if context.request.same_map && tunable == Tunable::Photons {
        return Err(Error::Usage("photons.volume cannot be tuned where all variants share one map".to_string()));
    }
    if budgets.kind == BudgetKind::Samples && variant.asked.time.is_none() {
        return Err(Error::Usage(format!(
            "variant {name} is to be tuned, but to which time? Give budgets in seconds, or `time` with the variant whose time it gets"
        )));
    }
    Ok(())
}

/// A variant with what was found of it.
struct Found {
    variant: Variant,
    limit: Option<Known>,
    /// By seed.
    runs: Vec<Run>,
}

impl Found {
    fn new(variant: Variant) -> Found {
        Found { variant, limit: None, runs: Vec::new() }
    }
}

struct Comparison<'c> {
    context: &'c Context<'c>,
    store: &'c Store,
    budgets: Budgets,
    regions: Vec<Region>,
    common: Option<Known>,
}

impl Comparison<'_> {
    fn seeds(&self) -> Vec<u64> {
        let first = self.context.base.render.seed;
        (0..u64::from(self.context.request.seeds.max(1))).map(|k| first.wrapping_add(k)).collect()
    }

    /// All runs: seed by seed, so that a machine that slows down slows all variants alike; those whose time others get
    /// come first.
    fn measure(&self, found: &mut [Found]) -> Result<()> {
        let (first, later): (Vec<usize>, Vec<usize>) =
            (0..found.len()).partition(|&index| found[index].variant.asked.time.is_none());
        for seed in self.seeds() {
            for &index in first.iter().chain(&later) {
                let given = found[index].variant.asked.time.clone();
                let times = given.map(|name| {
                    let other = found.iter().find(|other| other.variant.asked.name == name);
                    let shots = other.and_then(|other| other.runs.first()).map(|run| run.shots.as_slice());
                    shots.unwrap_or_default().iter().map(|shot| shot.as_ref().map(|shot| shot.seconds)).collect()
                });
                if self.common.is_none() && found[index].limit.is_none() {
                    let limit = reference::limit(&found[index].variant, self.context, self.store, &self.regions)?;
                    found[index].limit = Some(limit);
                }
                let run = self.run(&found[index], seed, times)?;
                let whole = run.whole;
                if whole || run.shots.iter().any(Option::is_some) {
                    found[index].runs.push(run);
                }
                if !whole {
                    return Err(Error::Interrupted);
                }
            }
        }
        Ok(())
    }

    /// A run of a variant with a seed, made or read. `times` are those it gets, by budget, if they are another's.
    fn run(&self, found: &Found, seed: u64, times: Option<Vec<Option<f64>>>) -> Result<Run> {
        let (context, variant) = (self.context, &found.variant);
        let name = &variant.asked.name;
        let mut description = variant.description.clone();
        description.render.seed = seed;
        let parts = [
            Subject::new(&description, 1).fingerprint(),
            seed.to_string(),
            format!("{:?} {:?} {times:?}", self.budgets, context.request.time),
            format!("{:?} {:?}", variant.tune, variant.asked.samples),
            context.map_digest(true),
            // The best of several numbers of samples is so against its reference.
            variant.tune.map_or(String::new(), |_| format!("{:?}", self.standard(found).facts())),
        ];
        let digest = context.digest(&parts.each_ref().map(String::as_str));
        if let Some(run) = self.store.run(name, seed, &digest).filter(|run| run.whole) {
            return Ok(run);
        }
        context.watch.begins(&format!("{name}, seed {seed}"));
        let start = Instant::now();
        let fresh = context.describe(name, &variant.set)?;
        let (scene, mut settings) = scene::build(&fresh)?;
        settings.render.seed = seed;
        let loading_seconds = start.elapsed().as_secs_f64();
        let peak = machine::forget_peak();
        let mut lab =
            Lab::new((scene, settings), context.shared(), context.request.components()?, context.watch, context.stop)?;
        let mut measuring =
            Measuring { comparison: self, found, seed, warnings: Vec::new(), stats: None, shots: Vec::new() };
        let ended = match variant.tune {
            None => measuring.refine(&mut lab, times),
            Some(tunable) => measuring.tuned(&mut lab, tunable, times),
        };
        let whole = match ended {
            Ok(()) => !context.stop.load(Ordering::Relaxed),
            Err(Error::Interrupted) => false,
            Err(error) => return Err(error),
        };
        let Measuring { warnings, stats, mut shots, .. } = measuring;
        shots.resize(self.budgets.values.len(), None);
        let statistics = statistics(&lab, stats, peak.then(machine::peak_bytes).flatten());
        let run = Run { digest, whole, loading_seconds, statistics, warnings, shots };
        if whole || run.shots.iter().any(Option::is_some) {
            self.store.write(&Store::run_name(name, seed, ".json"), &run)?;
        }
        Ok(run)
    }

    fn standard<'f>(&'f self, found: &'f Found) -> Held<'f> {
        Held(self.common.as_ref().or(found.limit.as_ref()))
    }

    fn results(&self, found: &[Found], complete: bool, trim: bool) -> Result<Results> {
        let (context, request) = (self.context, self.context.request);
        let base = &context.base;
        let mut budgets = self.budgets.clone();
        let mut variants: Vec<results::Variant> =
            found.iter().map(|found| self.variant(found)).collect::<Result<_>>()?;
        if trim {
            let missed = |index: usize| variants.iter().any(|variant| variant.measures[index].measured.is_none());
            let left_out = (0..budgets.values.len()).take_while(|&index| missed(index)).count();
            if left_out < budgets.values.len() {
                budgets.values.drain(..left_out);
                variants.iter_mut().for_each(|variant| drop(variant.measures.drain(..left_out)));
            }
        }
        let reference = match &self.common {
            Some(known) => known.facts.clone(),
            None => Reference {
                kind: ReferenceKind::Own,
                method: None,
                image: None,
                standard_error: None,
                samples: Some(request.limit_samples.into()),
                seconds: None,
                set: Vec::new(),
                regions: Vec::new(),
            },
        };
        let mut warnings: Vec<String> = Vec::new();
        for found in found {
            for warning in found.runs.iter().flat_map(|run| &run.warnings) {
                let warning = format!("{}: {warning}", found.variant.asked.name);
                if !warnings.contains(&warning) {
                    warnings.push(warning);
                }
            }
        }
        if let (Some(error), ReferenceKind::Made) = (reference.standard_error, reference.kind)
            && error > request.reference_error
        {
            warnings.push(format!(
                "the reference has a standard error of {:.2} %, not of {:.2} %: its time was up",
                100.0 * error,
                100.0 * request.reference_error
            ));
        }
        let doubtful = found.iter().zip(&variants).filter(|(found, variant)| self.is_doubtful(found, variant));
        let doubtful: Vec<&str> = doubtful.map(|(_, variant)| variant.name.as_str()).collect();
        if !doubtful.is_empty() {
            warnings.push(format!(
                "errors of {} are less than half of what the reference is uncertain by: it needs a smaller --reference-error and the --reference-time for it, or limits more limit_samples",
                doubtful.join(", ")
            ));
        }
        let split =
            |text: &String| text.split_once('=').map(|(key, value)| (key.trim().to_string(), value.trim().to_string()));
        let (scene_text, set) = (scene::read_study(&request.scene)?.1, request.set.iter().filter_map(split));
        Ok(Results {
            version: results::VERSION,
            program: machine::program(),
            machine: machine::machine(),
            threads: rayon::current_num_threads(),
            complete,
            scene: results::Scene {
                path: request.scene.display().to_string(),
                title: base.title.clone(),
                text: scene_text,
                width: base.film.width,
                height: base.film.height,
                exposure: base.film.exposure,
                filmic: base.film.tone_map == ToneMap::Filmic,
            },
            study: results::Study {
                text: request.study.clone(),
                budgets,
                seeds: self.seeds(),
                set: settings(&set.collect::<Vec<_>>()),
                layer: request.layer.clone(),
                same_map: context.shared().map(|photons| SameMap {
                    seed: base.render.seed,
                    photons: photons.stored(),
                    emitted: photons.emitted,
                    seconds: photons.seconds,
                }),
            },
            reference,
            regions: self.regions.clone(),
            variants,
            warnings,
        })
    }

    /// Whether some error over the whole image is less than half of what the reference itself is uncertain by.
    fn is_doubtful(&self, found: &Found, variant: &results::Variant) -> bool {
        let known = self.standard(found).facts().and_then(|facts| facts.regions.first()?.variance);
        let squares = variant.measures.iter().flat_map(|measure| &measure.measured).map(|m| m.regions[0].mse.value);
        known.is_some_and(|known| squares.into_iter().any(|square| square < 0.25 * known))
    }

    fn variant(&self, found: &Found) -> Result<results::Variant> {
        let Found { variant, limit, runs } = found;
        let loading: Vec<f64> = runs.iter().map(|run| run.loading_seconds).collect();
        let measures = self.budgets.values.iter().enumerate();
        Ok(results::Variant {
            name: variant.asked.name.clone(),
            method: method_name(&variant.description),
            set: settings(&variant.set),
            notes: variant.notes.clone(),
            limit: limit.as_ref().map(|known| known.facts.clone()),
            loading_seconds: mean(&loading).value,
            statistics: runs.first().map(|run| run.statistics.clone()).unwrap_or_default(),
            measures: measures
                .map(|(index, &budget)| Ok(Measure { budget, measured: self.measured(found, index, budget)? }))
                .collect::<Result<_>>()?,
        })
    }

    /// What was measured at a budget, where all seeds reached it.
    fn measured(&self, found: &Found, index: usize, budget: f64) -> Result<Option<Measured>> {
        // An interrupted run adds what it has.
        let counts = |run: &&Run| run.whole || run.shots[index].is_some();
        let shots: Option<Vec<&Shot>> = found.runs.iter().filter(counts).map(|run| run.shots[index].as_ref()).collect();
        let (Some(shots), Some(standard)) = (shots.filter(|shots| !shots.is_empty()), self.standard(found).0) else {
            return Ok(None);
        };
        let images: Vec<Image> = shots.iter().map(|shot| self.store.read_image(&shot.image)).collect::<Result<_>>()?;
        let mean_image = if images.len() > 1 {
            let name = format!("runs/{}/mean-{}.exr", found.variant.asked.name, label(self.budgets.kind, budget));
            self.store.write_image(&name, &mean_of(&images).into())?;
            Some(name)
        } else {
            None
        };
        let cpu: Option<Vec<f64>> = shots.iter().map(|shot| shot.cpu_seconds).collect();
        Ok(Some(Measured {
            seconds: mean(&shots.iter().map(|shot| shot.seconds).collect::<Vec<_>>()),
            cpu_seconds: cpu.map(|seconds| mean(&seconds)),
            passes: shots[0].passes,
            samples: shots[0].samples,
            tuned: shots[0].tuned.clone(),
            image: shots[0].image.clone(),
            mean_image,
            regions: self.regions.iter().map(|region| figures(&images, &standard.standard, region)).collect(),
        }))
    }
}

/// What errors of a variant are held against.
struct Held<'f>(Option<&'f Known>);

impl Held<'_> {
    fn facts(&self) -> Option<&Reference> {
        self.0.map(|known| &known.facts)
    }

    fn standard(&self) -> Result<&Standard> {
        self.0.map(|known| &known.standard).ok_or(Error::Interrupted)
    }
}

fn mean_of(images: &[Image]) -> Image {
    let mut sums = vec![0.0f64; 3 * images[0].pixels.len()];
    for image in images {
        sums.iter_mut().zip(image.pixels.as_flattened()).for_each(|(sum, &value)| *sum += f64::from(value));
    }
    let mut mean = Image::new(images[0].width, images[0].height);
    let count = images.len() as f64;
    mean.pixels.as_flattened_mut().iter_mut().zip(sums).for_each(|(mean, sum)| *mean = (sum / count) as f32);
    mean
}

/// A run on its way.
struct Measuring<'m> {
    comparison: &'m Comparison<'m>,
    found: &'m Found,
    seed: u64,
    warnings: Vec<String>,
    /// Of the last image.
    stats: Option<crate::render::Stats>,
    shots: Vec<Option<Shot>>,
}

impl Measuring<'_> {
    /// Refines, and measures on the way.
    fn refine(&mut self, lab: &mut Lab<'_>, times: Option<Vec<Option<f64>>>) -> Result<()> {
        let request = self.comparison.context.request;
        let asked = &self.comparison.budgets;
        let (places, budgets, most): (Vec<usize>, Budgets, Option<f64>) = match times {
            // Another's times ascend as its budgets do; two of them may be the same.
            Some(times) => {
                let times = times.into_iter().enumerate().filter_map(|(index, time)| Some((index, time?)));
                let (places, values) = times.unzip();
                (places, Budgets { kind: BudgetKind::Seconds, values }, None)
            }
            None => ((0..asked.values.len()).collect(), asked.clone(), request.time),
        };
        self.shots = vec![None; asked.values.len()];
        if places.is_empty() {
            return Ok(());
        }
        let outcome = lab.measure(&budgets, most)?;
        self.warnings.extend(outcome.warnings);
        for (index, taken) in places.into_iter().zip(outcome.taken) {
            self.shots[index] = taken.map(|snapshot| self.keep(index, &snapshot, None)).transpose()?;
        }
        Ok(())
    }

    /// Finds, for each budget, what takes its time, as the first seed has it.
    fn tuned(&mut self, lab: &mut Lab<'_>, tunable: Tunable, times: Option<Vec<Option<f64>>>) -> Result<()> {
        let comparison = self.comparison;
        let times = times.unwrap_or_else(|| comparison.budgets.values.iter().copied().map(Some).collect());
        for (index, time) in times.into_iter().enumerate() {
            let known = self.found.runs.first().map(|run| run.shots[index].as_ref());
            let taken = match (known, time) {
                (Some(known), _) => self.repeat(lab, tunable, known)?,
                (None, Some(time)) => self.find(lab, tunable, time)?,
                (None, None) => None,
            };
            let shot = taken.map(|(snapshot, tuned)| self.keep(index, &snapshot, Some(tuned))).transpose()?;
            self.shots.push(shot);
        }
        Ok(())
    }

    fn find(
        &self,
        lab: &mut Lab<'_>,
        tunable: Tunable,
        time: f64,
    ) -> Result<Option<(Arc<meter::Snapshot>, results::Tuned)>> {
        let samples = match self.found.variant.asked.samples.as_slice() {
            [] => vec![lab.settings.render.samples],
            several => several.to_vec(),
        };
        let held = self.comparison.standard(self.found);
        let (standard, whole) = (held.standard()?, &self.comparison.regions[0]);
        let rmse = |image: &Image| figures(std::slice::from_ref(image), standard, whole).rmse.value;
        tune::tune(lab, tunable, &samples, time, &rmse)
    }

    /// What the first seed had, with another.
    fn repeat(
        &self,
        lab: &mut Lab<'_>,
        tunable: Tunable,
        known: Option<&Shot>,
    ) -> Result<Option<(Arc<meter::Snapshot>, results::Tuned)>> {
        let Some((shot, tuned)) = known.and_then(|shot| Some((shot, shot.tuned.clone()?))) else { return Ok(None) };
        let value: f64 = tuned.setting.value.parse().map_err(|_| Error::Interrupted)?;
        lab.set(tunable, value)?;
        Ok(lab.shoot(shot.samples as u32, None)?.map(|snapshot| (snapshot, tuned)))
    }

    /// Writes an image.
    fn keep(&mut self, index: usize, snapshot: &meter::Snapshot, tuned: Option<results::Tuned>) -> Result<Shot> {
        let Comparison { budgets, store, .. } = self.comparison;
        let budget = label(budgets.kind, budgets.values[index]);
        let image = Store::run_name(&self.found.variant.asked.name, self.seed, &format!("-{budget}.exr"));
        store.write_image(&image, &snapshot.image.clone().into())?;
        self.stats = Some(snapshot.stats.clone());
        Ok(Shot {
            seconds: snapshot.seconds,
            cpu_seconds: snapshot.cpu_seconds,
            passes: snapshot.stats.passes,
            samples: snapshot.samples,
            image,
            tuned,
        })
    }
}

/// What a run did until its last image.
fn statistics(lab: &Lab<'_>, stats: Option<crate::render::Stats>, peak_bytes: Option<u64>) -> Statistics {
    let Some(mut stats) = stats else { return Statistics { peak_bytes, ..Statistics::default() } };
    if let Some(map) = lab.map_stats() {
        (stats.emitted, stats.volume, stats.radii) = (map.emitted, map.volume, map.radii);
        (stats.map_bytes, stats.build_seconds) = (map.map_bytes, map.build_seconds);
    }
    let pixels = f64::from(lab.settings.film.width) * f64::from(lab.settings.film.height);
    let queries = stats.gather.queries as f64;
    Statistics {
        passes: stats.passes,
        samples: stats.samples,
        emitted: stats.emitted,
        photons: stats.volume,
        photons_seconds: stats.photons_seconds,
        build_seconds: stats.build_seconds,
        render_seconds: stats.render_seconds,
        queries: stats.gather.queries,
        photons_per_query: (queries > 0.0).then(|| stats.gather.photons as f64 / queries),
        queries_per_sample: queries / (pixels * stats.samples.max(1) as f64),
        radii: (stats.volume > 0).then(|| [stats.radii.min, stats.radii.mean, stats.radii.max].map(f64::from)),
        map_bytes: stats.map_bytes,
        peak_bytes,
    }
}
