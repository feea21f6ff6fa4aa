//! Whether a scene can be believed: small pictures of it by several estimators and seeds, held against each other; where the power
//! of its light goes; whether its shapes are what they seem, and what it asks in vain.
//!
//! A [`Request`] says what to check, [`run`] does it, and a [`Report`] says what was found, row by row: passed, failed, or not
//! applicable where a test cannot tell. Each test is told in `docs/check.md`.

mod bench;
mod blocks;
mod geometry;
mod halt;
mod judge;
mod ledger;
mod names;
mod photons;
mod pixels;
mod probe;
mod report;
mod statistics;
mod vain;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use bench::{Bench, Series};
use blocks::Blocks;
use halt::{Halt, seconds_of_threads};
use judge::{Side, unbiased};
use pixels::Pixels;
use probe::Prober;

pub use names::Names;
pub use report::{Outcome, PMap, Report, Row};

use crate::image::Image;
use crate::light::Light;
use crate::render::{Camera, Progress};
use crate::scene::description::{Indirect, Method};
use crate::scene::{self, Description, Scene, Settings};
use crate::surface::{Bsdf, Material, Nature};
use crate::{Error, Result};

/// What to check.
#[derive(Clone, Debug)]
pub struct Request {
    /// The scene file.
    pub scene: PathBuf,
    /// Keys of it that are set otherwise, as `key=value`.
    pub set: Vec<String>,
    /// About how many seconds the check may take, of all threads together.
    pub seconds: f64,
    /// So many pictures of photon maps, and eight times as many by paths and by light paths, whatever time these take; `None`: as
    /// many as there is time for.
    pub seeds: Option<u32>,
}

/// For each picture of photons that is asked for, so many of unbiased estimators.
const PATHS: usize = 8;
/// The most pictures of an unbiased estimator.
const MOST: usize = 64;
/// Shares of the time that shapes, what is asked in vain, the ledger, paths and light paths may take; photons take the rest.
const SHARES: [f64; 5] = [0.04, 0.04, 0.04, 0.18, 0.12];
/// The share of that for photons as the scene asks for them, where there are other ways to gather them.
const OWN: f64 = 0.6;
/// The share of the time that is left for the end.
const END: f64 = 0.03;

/// Seconds that are more than there are.
const FOREVER: f64 = 1e8;

/// Phase functions of a greater mean cosine have a peak that a camera, which is asked for light by each collision, hardly ever lies in.
const PEAK: f64 = 0.97;

const BY_CHANCE: &str = "paths find light of small lamps by way of mirrors and glass by chance only";
const COATS: &str = "light paths do not see what coats and sheets mirror";
const PEAKED: &str = "light paths seldom meet the camera within the peak of a phase function";
const PINHOLE: &str = "light paths of a pinhole within a medium have infinite variance";
const ENDLESS: &str = "what a glowing medium without an end scatters is left out";
const NOBODY: &str = "the scene leaves indirect light out (surface.indirect = \"none\")";

/// Checks a scene on the current thread pool. `stop` ends it early: the report holds the rows that are done.
///
/// # Errors
/// [`Error::Scene`], [`Error::Asset`] and [`Error::Limit`] for what cannot be rendered at all.
pub fn run(request: &Request, watch: &dyn Progress, stop: &AtomicBool) -> Result<Report> {
    let (start, spent) = (Instant::now(), seconds_of_threads());
    let description = scene::read(&request.scene, &request.set)?;
    let (scene, settings) = scene::build(&description)?;
    Halt::with(stop, |halt| {
        let bench = Bench::new(&scene, &settings, halt, watch);
        let names = Names::new(&description, &scene);
        let mut check = Check {
            request,
            start: spent,
            description: &description,
            scene: &scene,
            settings: &settings,
            bench,
            names,
        };
        let (width, height) = check.bench.settings.film.size();
        let mut report = Report {
            scene: description.path.display().to_string(),
            size: [width, height],
            samples: 0,
            seconds: 0.0,
            thread_seconds: 0.0,
            complete: true,
            rows: Vec::new(),
            warnings: scene.warnings.clone(),
        };
        match check.all(&mut report) {
            Err(Error::Interrupted) => report.complete = false,
            other => other?,
        }
        report.samples = check.bench.settings.render.samples;
        report.seconds = start.elapsed().as_secs_f64();
        report.thread_seconds = seconds_of_threads() - spent;
        Ok(report)
    })
}

/// Whether two sets of pictures, of several seeds each, have the same means: Welch's t-test in blocks, of which there are no more than
/// 32 across, as in the rows of a report.
///
/// # Errors
/// [`Error::Usage`] where the pictures are not of one size, not finite, or fewer than two in a set.
pub fn t_test(images: &[Image], references: &[Image]) -> Result<Row> {
    const ACROSS: usize = 32;
    let [first, ..] = images else { return Err(Error::Usage("there is no image".to_string())) };
    if images.len() < 2 || references.len() < 2 {
        return Err(Error::Usage(format!(
            "a t-test needs two pictures of each kind at least, by different seeds; there are {} and {}",
            images.len(),
            references.len()
        )));
    }
    let mut all = images.iter().chain(references);
    if let Some(other) = all.clone().find(|other| (other.width, other.height) != (first.width, first.height)) {
        return Err(Error::Usage(format!(
            "one picture has {} × {} pixels, another {} × {}; equal sizes are expected",
            first.width, first.height, other.width, other.height
        )));
    }
    if all.any(|image| !image.pixels.as_flattened().iter().all(|value| value.is_finite())) {
        return Err(Error::Usage("a t-test needs pictures whose pixels are all finite".to_string()));
    }
    let block = first.width.max(first.height).div_ceil(ACROSS);
    let [a, b] = [images, references].map(|images| Blocks::of(images, block));
    Ok(unbiased("t-test", &Side::whole("the image", &a), &Side::whole("the reference", &b), false))
}

/// A check on its way.
struct Check<'c> {
    request: &'c Request,
    /// Seconds of threads at its start.
    start: f64,
    description: &'c Description,
    scene: &'c Scene,
    settings: &'c Settings,
    bench: Bench<'c>,
    names: Names<'c>,
}

impl Check<'_> {
    /// All tests. Rows are added as they are done.
    fn all(&mut self, report: &mut Report) -> Result<()> {
        self.shapes(report)?;
        if self.request.seeds.is_none() {
            self.bench.hurry(SHARES[3] * self.request.seconds)?;
        }
        let (path, light) = (self.series(Method::Path, SHARES[3])?, self.series(Method::Light, SHARES[4])?);
        let minutes = self.request.seconds / 60.0;
        let mut photons = photons::variants(&self.bench, minutes)?;
        let most = self.request.seeds.map_or(usize::MAX, |seeds| seeds as usize);
        let (own, others) = photons.split_at_mut(1);
        self.bench.watch.phase("photons", 0);
        let left = || match self.request.seeds {
            Some(_) => FOREVER,
            None => (1.0 - END) * self.request.seconds - (seconds_of_threads() - self.start),
        };
        photons::shoot(&self.bench, own, left() * if others.is_empty() { 1.0 } else { OWN }, most)?;
        photons::shoot(&self.bench, others, left(), most)?;
        self.pixels(report, &path, &light, &photons)?;
        self.estimators(report, &path, &light, &photons);
        Ok(())
    }

    /// What a share of the time is.
    fn seconds(&self, share: f64) -> f64 {
        if self.request.seeds.is_some() { FOREVER } else { share * self.request.seconds }
    }

    fn series(&self, method: Method, share: f64) -> Result<Option<Series>> {
        self.bench.watch.phase(method.name(), 0);
        let most = self.request.seeds.map_or(MOST, |seeds| PATHS * seeds as usize);
        self.bench.series(method, self.seconds(share), most)
    }

    /// What needs no pictures: shapes, energy, and what is asked in vain.
    fn shapes(&self, report: &mut Report) -> Result<()> {
        let (scene, names, halt) = (self.scene, &self.names, self.bench.halt);
        let prober = Prober::new(scene, self.settings.render.seed);
        let stop = || halt.is_over();
        self.bench.watch.phase("shapes", 0);
        halt.allow(self.seconds(SHARES[0]));
        report.rows.push(geometry::meshes((scene, names)));
        report.rows.extend(geometry::boundaries((scene, self.description, names), self.settings.render.seed, &stop));
        halt.go_on()?;
        self.bench.watch.phase("walks", 0);
        halt.allow(self.seconds(SHARES[1]));
        report.rows.extend(vain::rows((scene, self.description, names), &self.bench.settings, &prober, &stop));
        halt.go_on()?;
        let seconds = self.seconds(SHARES[2]);
        report.rows.extend(ledger::rows((scene, names, self.settings), &prober, (halt, seconds))?);
        halt.go_on()
    }

    /// Pixels of all pictures.
    fn pixels(
        &self,
        report: &mut Report,
        path: &Option<Series>,
        light: &Option<Series>,
        photons: &[photons::Variant],
    ) -> Result<()> {
        // A replay may take as long as it takes.
        self.bench.halt.allow(self.seconds(SHARES[0]));
        let film = &self.bench.settings.film;
        let mut command = format!("volpm render {}", quoted(&self.description.path.display().to_string()));
        let mut set: Vec<String> = self.request.set.clone();
        set.extend([
            "render.method=path".to_string(),
            format!("film.width={}", film.width),
            format!("film.height={}", film.height),
            "render.passes=1".to_string(),
            "film.standard_error=false".to_string(),
        ]);
        if let Some(crop) = film.crop {
            set.push(format!("film.crop=[{},{},{},{}]", crop.x, crop.y, crop.width, crop.height));
        }
        for pair in &set {
            command += &format!(" --set {}", quoted(pair));
        }
        command += &format!(" --samples {}", self.bench.settings.render.samples);
        let pixels = Pixels { bench: &self.bench, command };
        let mut all: Vec<(&str, &Series)> = Vec::new();
        all.extend(path.as_ref().map(|series| ("path", series)));
        all.extend(light.as_ref().map(|series| ("light", series)));
        for variant in photons {
            all.extend(variant.series.iter().flat_map(|(a, b)| [(variant.name, a), (variant.name, b)]));
        }
        report.rows.push(pixels.sound(&all)?);
        for (_, series) in &all {
            for warning in series.shots.iter().flat_map(|shot| &shot.warnings) {
                // Those of other pictures differ by numbers.
                if !report.warnings.iter().any(|known| without_digits(known) == without_digits(warning)) {
                    report.warnings.push(warning.clone());
                }
            }
        }
        let lit = all.iter().any(|(_, series)| series.blocks().level() > 0.0);
        report.rows.push(match lit {
            _ if all.is_empty() => {
                Row::not_applicable("the picture is lit", "there was no time for a picture: allow more --time")
            }
            true => Row::new("the picture is lit", Outcome::Pass, "it is"),
            false => Row::new("the picture is lit", Outcome::Fail, "it is black by every estimator"),
        });
        let own = self.settings.render.method;
        for (method, series) in [(Method::Path, path), (Method::Light, light)] {
            if let Some(series) = series {
                report.rows.push(pixels.fireflies(method.name(), series, own == method)?);
            }
        }
        if let Some((series, _)) = &photons[0].series {
            report.rows.push(pixels.fireflies(photons[0].name, series, own == Method::Photon)?);
        }
        Ok(())
    }

    /// Estimators against each other.
    fn estimators(
        &self,
        report: &mut Report,
        path: &Option<Series>,
        light: &Option<Series>,
        photons: &[photons::Variant],
    ) {
        let rows = &mut report.rows;
        let time = "there was no time for enough pictures: allow more --time";
        let (path_lacks, light_lacks, photons_lack) = (self.path_lacks(), self.light_lacks(), self.photons_lack());
        let all = path.as_ref().map(Series::blocks);
        let spread = path.as_ref().map(Series::spread);
        let light = light.as_ref().map(Series::spread);
        let own = self.settings.render.method;
        let spoilt = |method: Method| rows.iter().any(|row| pixels::is_spoilt(row, method.name()));
        let spoilt = [Method::Path, Method::Light].map(|method| (method, spoilt(method)));
        let spoilt = |method| spoilt.contains(&(method, true));
        let side = |blocks, method: Method, misses| Side {
            name: method.name(),
            blocks,
            misses,
            is_rare: spoilt(method),
            is_own: method == own,
        };
        rows.push(match &all {
            Some(all) if all.seeds() >= 6 => {
                let [even, odd] = [0, 1].map(|half| all.some(|seed| seed % 2 == half));
                let half = |blocks, name| Side { is_rare: spoilt(Method::Path), ..Side::whole(name, blocks) };
                unbiased("path ↔ path", &half(&even, "every second seed"), &half(&odd, "every other seed"), true)
            }
            _ => Row::not_applicable("path ↔ path", time),
        });
        let judge = light.as_ref().map(|blocks| side(blocks, Method::Light, light_lacks));
        rows.push(match (&spread, &judge) {
            (Some(spread), Some(judge)) => {
                unbiased("path ↔ light", &side(spread, Method::Path, path_lacks), judge, true)
            }
            _ => Row::not_applicable("path ↔ light", time),
        });
        // Light paths tell what paths may lack.
        let path = all.as_ref().map(|blocks| side(blocks, Method::Path, path_lacks));
        let lacking = path_lacks.is_some() || path.is_none();
        let judges: Vec<(&Side<'_>, bool)> = path
            .iter()
            .map(|path| (path, false))
            .chain(judge.iter().filter(|_| lacking).map(|light| (light, true)))
            .collect();
        for variant in photons {
            rows.extend(photons::judged(variant, &judges, photons_lack));
        }
        rows.extend(photons::quality(&self.bench, self.settings, &photons[0]));
    }

    /// Why paths may lack light.
    fn path_lacks(&self) -> Option<&'static str> {
        let bends = self.scene.any_material(&Material::is_narrow);
        let small = self.scene.lights.iter().any(|light| !matches!(light, Light::Environment(_)));
        (bends && small).then_some(BY_CHANCE)
    }

    /// Why light paths may lack light, of that which is not seen in mirrors and through boundaries.
    fn light_lacks(&self) -> Option<&'static str> {
        let scene = self.scene;
        let coated = |material: &Material| match material {
            Material::Opaque(bsdf) => {
                bsdf.is_partly_specular() && bsdf.nature() != Nature::Specular || matches!(bsdf, Bsdf::Thin(_))
            }
            _ => false,
        };
        let camera = Camera::new(&scene.camera, &self.settings.film);
        let around = scene.medium(&scene.inside(camera.position)).map(|medium| &scene.media[medium as usize]);
        if camera.is_pinhole() && around.is_some_and(|medium| medium.scatters()) {
            return Some(PINHOLE);
        }
        if scene.any_material(&coated) {
            return Some(COATS);
        }
        if scene.media.iter().any(|medium| medium.scatters() && medium.phase.greatest_cosine() > PEAK) {
            return Some(PEAKED);
        }
        self.glows_without_end().then_some(ENDLESS)
    }

    /// Why photons may lack light.
    fn photons_lack(&self) -> Option<&'static str> {
        if self.settings.surface.indirect == Indirect::None {
            return Some(NOBODY);
        }
        self.glows_without_end().then_some(ENDLESS)
    }

    fn glows_without_end(&self) -> bool {
        let world = self.scene.world.map(|world| &self.scene.media[world as usize]);
        world.is_some_and(|medium| medium.glows() && medium.scatters() && !medium.density.support().size().is_finite())
    }
}

fn without_digits(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit()).collect()
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_string()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}
