//! The passes of a render: photons, maps, and samples through every pixel.

use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::camera::Camera;
use super::exact;
use super::eye::Mode;
use super::film::Film;
use super::limits::Limits;
use super::plan::{Plan, Points};
use crate::Result;
use crate::gather::{GatherStats, PointMaps, VolumeMaps};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::photon::{self, MapSettings, Photon, PhotonMap, PointMap, PointSettings, Radii, walls};
use crate::scene::description::Method;
use crate::scene::{Scene, Settings};
use crate::transport::Tally;

/// Hears how far a render has come.
pub trait Progress: Sync {
    /// A phase begins, of so many steps (0 if unknown).
    fn phase(&self, name: &'static str, steps: u64);
    /// Steps were done.
    fn advance(&self, steps: u64);
    /// The image is better than before: a pass has ended, or a round of samples of the first one. Told by the
    /// thread that renders, which goes on when this returns.
    fn refined(&self, _film: &Film, _stats: &Stats) {}
    /// How many samples of each pixel the first pass should take until [`Progress::refined`] is told of them, where
    /// it has taken `done`. Fewer at a time take longer.
    fn round(&self, done: u32) -> u32 {
        if done == 0 { 1 } else { u32::MAX }
    }
}

impl<T: Progress + ?Sized> Progress for &T {
    fn phase(&self, name: &'static str, steps: u64) {
        (**self).phase(name, steps);
    }

    fn advance(&self, steps: u64) {
        (**self).advance(steps);
    }

    fn refined(&self, film: &Film, stats: &Stats) {
        (**self).refined(film, stats);
    }

    fn round(&self, done: u32) -> u32 {
        (**self).round(done)
    }
}

/// Nobody listens.
pub struct Silent;

impl Progress for Silent {
    fn phase(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
}

/// A finished or interrupted render.
#[derive(Debug)]
pub struct Rendering {
    /// The image's sums.
    pub film: Film,
    /// What it cost.
    pub stats: Stats,
    /// Why it ended.
    pub end: End,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Why a render ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// All passes are done.
    Finished,
    /// The error is as small as was asked for.
    Precise,
    /// The time was up.
    TimeUp,
    /// It was told to stop.
    Interrupted,
}

/// What a render cost, in all passes together.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Stats {
    /// Seconds in the photon pass.
    pub photons_seconds: f64,
    /// Seconds for radii and hierarchies.
    pub build_seconds: f64,
    /// Seconds for the pixels.
    pub render_seconds: f64,
    /// Photons emitted.
    pub emitted: u64,
    /// Volume photons stored.
    pub volume: u64,
    /// The largest map, in bytes.
    pub map_bytes: u64,
    /// The discs' radii, of the last pass.
    #[serde(skip)]
    pub radii: Radii,
    /// Beam queries.
    pub gather: GatherStats,
    /// Passes done.
    pub passes: u64,
    /// Camera samples per pixel in the image.
    pub samples: u64,
    /// The relative standard error ([`Film::error`]), where there are several passes.
    pub error: Option<f64>,
    /// Counts of mishaps.
    pub tally: Tally,
}

impl Stats {
    /// Adds what other passes cost.
    pub fn merge(&mut self, other: &Stats) {
        self.photons_seconds += other.photons_seconds;
        self.build_seconds += other.build_seconds;
        self.render_seconds += other.render_seconds;
        self.emitted += other.emitted;
        self.volume += other.volume;
        self.map_bytes = self.map_bytes.max(other.map_bytes);
        self.gather += other.gather;
        self.passes += other.passes;
        self.samples += other.samples;
        self.tally = self.tally.merge(other.tally);
    }

    /// Notes maps that were built for a pass.
    pub(super) fn built(&mut self, maps: &[(u32, Summary)]) {
        self.tally.broken += maps.iter().map(|(_, map)| map.rejected as u64).sum::<u64>();
        self.map_bytes = self.map_bytes.max(maps.iter().map(|(_, map)| map.bytes as u64).sum());
        self.radii = radii(maps);
    }
}

/// Renders a scene's own passes on the current thread pool. `stop` ends it early, with what there is by then.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) where the scene has no steady state; [`Error::Limit`](crate::Error::Limit)
/// if the film does not fit into memory.
pub fn render(scene: &Scene, settings: &Settings, progress: &impl Progress, stop: &AtomicBool) -> Result<Rendering> {
    refine(scene, settings, &Limits::default(), None, progress, stop)
}

/// Renders passes of a scene until a limit is reached, beginning from `before`: a film with finished passes of
/// the same scene, and what they cost. Those of the scene's seed that it holds are not repeated.
///
/// Pass k is the same whenever it is made, and the film sums exactly: the image depends on which passes it
/// holds and on nothing else.
///
/// # Errors
/// As [`render`].
pub fn refine(
    scene: &Scene,
    settings: &Settings,
    limits: &Limits,
    before: Option<(Film, Stats)>,
    progress: &impl Progress,
    stop: &AtomicBool,
) -> Result<Rendering> {
    let camera = Camera::new(&scene.camera, &settings.film);
    let plan = Plan::new(scene, settings, &camera, limits)?;
    run(scene, settings, (camera, plan), limits, (before, None), progress, stop)
}

/// Renders as planned, from maps that all passes share or from new ones each.
pub(super) fn run(
    scene: &Scene,
    settings: &Settings,
    (camera, plan): (Camera, Plan),
    limits: &Limits,
    (before, shared): (Option<(Film, Stats)>, Option<&Maps>),
    progress: &impl Progress,
    stop: &AtomicBool,
) -> Result<Rendering> {
    let (mut film, stats) = match before {
        Some(before) => before,
        None => (limits.film(settings, plan.parts)?, Stats::default()),
    };
    if let Some(components) = &limits.shown {
        film.show_only(components);
    }
    let clock = Clock::new(limits.time, film.has_samples());
    let mut warnings = Vec::new();
    if let Some(memory) = limits.memory
        && plan.parts > 1
    {
        let (parts, mib) = (plan.parts, memory as f64 / (1u64 << 20) as f64);
        warnings.push(format!("to stay within {mib:.0} MiB, each pass is made in {parts} parts"));
    }
    let mut renderer = Renderer { scene, camera, plan, shared, progress, stop, clock, film, stats, warnings };
    let end = renderer.run(limits.passes(settings), limits.target_error);
    let Renderer { film, stats, mut warnings, .. } = renderer;
    if let (Some(target), Some(error)) = (limits.target_error, stats.error)
        && error > target
    {
        warnings.push(format!(
            "the standard error is {:.2} % after {} passes, above the {:.2} % asked for",
            100.0 * error,
            stats.passes,
            100.0 * target
        ));
    }
    report(&stats, &mut warnings);
    Ok(Rendering { film, stats, end, warnings })
}

/// Passes that tell how far apart passes are, at least.
const TELLING: u64 = 4;

/// Whatever the limit of time, a first image may take so long for its photons,
const FIRST_PHOTONS: Duration = Duration::from_secs(1);
/// and so long for its first sample of each pixel.
const FIRST_SAMPLES: Duration = Duration::from_secs(3);

/// A pass that was expected to end in time may exceed the limit of time by this share of it.
const OVERTIME: f64 = 0.05;

/// When to stop.
pub(super) struct Clock {
    start: Instant,
    limit: Option<Duration>,
    /// Whether there is an image to show, so that what is under way may be given up.
    image: bool,
    /// How long the last pass took.
    pass: Duration,
    /// When the last pass came to its samples.
    samples: Instant,
}

impl Clock {
    fn new(limit: Option<Duration>, image: bool) -> Self {
        let start = Instant::now();
        Clock { start, limit, image, pass: Duration::ZERO, samples: start }
    }

    /// Whether a pass that takes as long as the one before would end in time.
    fn allows_a_pass(&self) -> bool {
        self.limit.is_none_or(|limit| self.start.elapsed() + self.pass <= limit)
    }

    /// Whether to trace no more photons.
    fn ends_photons(&self) -> bool {
        self.limit.is_some_and(|limit| {
            let end = if self.image { limit.mul_f64(1.0 + OVERTIME) } else { limit.max(FIRST_PHOTONS) };
            self.start.elapsed() >= end
        })
    }

    /// Whether to take no more samples.
    pub(super) fn ends_samples(&self) -> bool {
        self.limit.is_some_and(|limit| match (self.image, self.pass.is_zero()) {
            (true, true) => self.start.elapsed() >= limit,
            (true, false) => self.start.elapsed() >= limit.mul_f64(1.0 + OVERTIME),
            (false, _) => self.start.elapsed() >= limit && self.samples.elapsed() >= limit.max(FIRST_SAMPLES),
        })
    }
}

/// A render under way.
pub(super) struct Renderer<'s, P> {
    pub(super) scene: &'s Scene,
    pub(super) camera: Camera,
    pub(super) plan: Plan,
    /// The maps of all passes, if there are such.
    shared: Option<&'s Maps>,
    pub(super) progress: &'s P,
    pub(super) stop: &'s AtomicBool,
    pub(super) clock: Clock,
    pub(super) film: Film,
    pub(super) stats: Stats,
    warnings: Vec<String>,
}

impl<P: Progress> Renderer<'_, P> {
    /// Makes passes until there is a reason to end.
    fn run(&mut self, passes: RangeInclusive<u32>, target_error: Option<f64>) -> End {
        let (seed, parts) = (self.plan.seed, self.plan.parts);
        let first = (passes.start() - 1).saturating_mul(parts).saturating_add(1);
        let last = passes.end().saturating_mul(parts).min(exact::MOST);
        let precise = |stats: &Stats| {
            let error = stats.error.filter(|_| stats.passes >= TELLING);
            target_error.is_some_and(|target| error.is_some_and(|error| error <= target))
        };
        self.stats.error = self.film.error();
        let missing = self.film.done().missing(seed, first..=last);
        for pass in missing {
            if precise(&self.stats) {
                return End::Precise;
            }
            if !self.clock.allows_a_pass() {
                return End::TimeUp;
            }
            let start = Instant::now();
            let (samples, before) = (self.plan.samples, self.stats.clone());
            if !self.pass(pass - 1) {
                let interrupted = self.stop.load(Ordering::Relaxed);
                if self.stats.passes > 0 {
                    // What is not in the image is not counted.
                    self.stats = before;
                } else {
                    self.stats.samples = self.film.samples_in_pass() as u64;
                    if !interrupted {
                        self.warnings.push(format!(
                            "the time was up within the first pass: {} of {samples} samples per pixel are done",
                            self.stats.samples
                        ));
                    }
                }
                return if interrupted { End::Interrupted } else { End::TimeUp };
            }
            self.film.end_pass(seed, pass);
            self.clock.pass = start.elapsed();
            self.clock.image = true;
            self.stats.passes += 1;
            self.stats.samples += self.plan.samples as u64;
            self.stats.error = self.film.error();
            self.progress.refined(&self.film, &self.stats);
        }
        if precise(&self.stats) { End::Precise } else { End::Finished }
    }

    /// Whether the pass is to be left as it is.
    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.clock.ends_samples()
    }

    /// All pixels have the same number of samples.
    pub(super) fn end_round(&mut self) {
        if self.stopped() || self.stats.passes > 0 {
            return;
        }
        self.clock.image = true;
        self.progress.refined(&self.film, &self.stats);
    }

    /// One pass. Returns whether it came to its end.
    fn pass(&mut self, pass: u32) -> bool {
        let own;
        let maps = match (self.plan.method, self.shared) {
            (Method::Path, _) => None,
            (Method::Photon, Some(shared)) => Some(shared),
            (Method::Photon, None) => {
                own = self.maps(pass);
                Some(&own)
            }
        };
        let mode = match maps {
            Some(Maps::Beams(maps)) => Mode::Gather(maps),
            Some(Maps::Points(maps)) => Mode::March(maps),
            None if self.plan.split => Mode::Split,
            None => Mode::Track,
        };
        let start = Instant::now();
        self.clock.samples = start;
        self.expose(mode, pass);
        self.stats.render_seconds += start.elapsed().as_secs_f64();
        !self.stopped()
    }

    /// The photon maps of a pass, one for each region.
    fn maps(&mut self, pass: u32) -> Maps {
        let (scene, progress) = (self.scene, self.progress);
        let empty = || Maps::Beams(VolumeMaps::new((0..scene.regions).map(|_| None).collect(), &scene.media));
        if self.plan.volume_photons == 0 {
            return empty();
        }
        let start = Instant::now();
        let announced = AtomicU64::new(0);
        progress.phase("photons", 0);
        let order = order(&self.plan, pass);
        let advance = |done, all| {
            if announced.swap(all, Ordering::Relaxed) != all {
                progress.phase("photons", all);
            }
            progress.advance(done);
        };
        let stop = || self.stop.load(Ordering::Relaxed) || self.clock.ends_photons();
        let traced = photon::trace(scene, &order, &advance, &stop);
        let late = self.clock.ends_photons();
        self.stats.photons_seconds += start.elapsed().as_secs_f64();
        self.stats.emitted += traced.emitted;
        self.stats.volume += traced.stored();
        self.stats.tally = self.stats.tally.merge(traced.tally);
        if self.stop.load(Ordering::Relaxed) || (late && self.clock.image) {
            return empty();
        }
        if late {
            // The only image there will be.
            self.plan.samples = 1;
            self.warnings.push(format!(
                "the time was up when {} of {} photons were traced: the image shows these",
                traced.stored(),
                self.plan.volume_photons
            ));
        }
        let first = self.stats.passes == 0;
        let asks = self.plan.single_scattering.asks_lights();
        // All light may have been traced.
        if first && !late && !(asks && traced.stored() == 0) {
            self.warnings.extend(sparse_map(&self.plan, &traced));
        }
        if first {
            self.warnings.extend(endless_glow(scene));
        }

        let extinctions = mean_extinctions(scene, &traced.regions);
        let start = Instant::now();
        progress.phase("build", 0);
        let scale = narrowing(pass / self.plan.parts, self.plan.dimension) as f32;
        let maps = Maps::build(scene, &self.plan, scale, &extinctions, traced.regions);
        let summaries = maps.summaries();
        if first {
            let wide = |(region, map): &(u32, Summary)| {
                let leans = self.plan.points.is_none() && *region != scene.world_region;
                wide_discs(scene, *region, map.radii, extinctions[*region as usize], leans)
            };
            self.warnings.extend(summaries.iter().filter_map(wide));
        }
        self.stats.built(&summaries);
        self.stats.build_seconds += start.elapsed().as_secs_f64();
        maps
    }
}

/// What a pass asks the photon pass for.
pub(super) fn order(plan: &Plan, pass: u32) -> photon::Pass {
    photon::Pass {
        seed: plan.seed,
        index: pass as u64,
        target: plan.volume_photons,
        max_emitted: plan.max_emitted,
        max_events: plan.max_events,
        single_scattering: plan.single_scattering,
    }
}

/// Photon maps, one for each region.
#[derive(Debug)]
pub(super) enum Maps {
    Beams(VolumeMaps),
    Points(PointMaps),
}

/// What is reported of a map.
pub(super) struct Summary {
    photons: usize,
    rejected: usize,
    bytes: usize,
    radii: Radii,
}

impl Maps {
    /// From the photons of all regions, with radii multiplied by `scale`, and the extinction around them.
    pub(super) fn build(
        scene: &Scene,
        plan: &Plan,
        scale: f32,
        extinctions: &[f64],
        regions: Vec<Vec<Photon>>,
    ) -> Maps {
        match &plan.points {
            None => Maps::Beams(beam_maps(scene, plan, scale, extinctions, regions)),
            Some(points) => Maps::Points(point_maps(scene, points, scale, regions)),
        }
    }

    /// Of each map that holds photons, with its region.
    pub(super) fn summaries(&self) -> Vec<(u32, Summary)> {
        let of_beams = |map: &PhotonMap| Summary {
            photons: map.len(),
            rejected: map.rejected(),
            bytes: map.bytes(),
            radii: map.radii(),
        };
        let of_points = |map: &PointMap| Summary {
            photons: map.len(),
            rejected: map.rejected(),
            bytes: map.bytes(),
            radii: map.radii(),
        };
        match self {
            Maps::Beams(maps) => maps.by_region().map(|(region, map)| (region, of_beams(map))).collect(),
            Maps::Points(maps) => maps.by_region().map(|(region, map)| (region, of_points(map))).collect(),
        }
    }
}

fn beam_maps(scene: &Scene, plan: &Plan, scale: f32, extinctions: &[f64], regions: Vec<Vec<Photon>>) -> VolumeMaps {
    let build = |(photons, extinction): (Vec<Photon>, &f64)| {
        let settings =
            MapSettings { tagged: plan.tagged, scale, profile: plan.profile, ..MapSettings::new(plan.radius) };
        let near = |position, radius, mean, planes: &mut _| {
            walls::of_disc(scene, *extinction as f32, (position, radius, mean), planes);
        };
        (!photons.is_empty()).then(|| PhotonMap::build(photons, &settings, &near))
    };
    let mut maps: Vec<Option<PhotonMap>> = regions.into_iter().zip(extinctions).map(build).collect();
    for (region, map) in (0..).zip(&mut maps) {
        // Maps without leaning discs are for bundles, which spread light evenly.
        if let (Some(map), Some(density)) = (map, uneven_density(scene, region))
            && map.leans()
        {
            map.follow_density(&|p| density.at(p));
        }
    }
    VolumeMaps::new(maps, &scene.media)
}

/// The density of a region that is filled with one medium, if it is voxels.
fn uneven_density(scene: &Scene, region: u32) -> Option<&Density> {
    let mut media = scene.solids.iter().filter(|solid| solid.region == region).map(|solid| solid.medium);
    let first = media.next().filter(|_| region != scene.world_region)??;
    let density = &scene.media[first as usize].density;
    (density.voxels().is_some() && media.all(|medium| medium == Some(first))).then_some(density)
}

fn point_maps(scene: &Scene, points: &Points, scale: f32, regions: Vec<Vec<Photon>>) -> PointMaps {
    let settings = PointSettings { scale, ..points.settings };
    let clearance = |position, limit| walls::clearance(scene, position, limit);
    let build = |photons: Vec<Photon>| (!photons.is_empty()).then(|| PointMap::build(photons, &settings, &clearance));
    PointMaps::new(regions.into_iter().map(build).collect(), &scene.media, points.marchers.clone())
}

/// What the radii of a pass are multiplied by that comes after `before` others, in `dimension` dimensions: r_{k+1}^d =
/// r_k^d (k + α)/(k + 1) with α = 4/(4 + d), which lets noise and blur vanish alike, RMSE ∝ N^{−2/(4+d)} (after
/// Knaus and Zwicker 2011, "Progressive Photon Mapping: A Probabilistic Approach").
pub fn narrowing(before: u32, dimension: u32) -> f64 {
    let d = dimension as f64;
    let alpha = 4.0 / (4.0 + d);
    let shrunk: f64 = (1..=before).map(|k| (k as f64 + alpha) / (k as f64 + 1.0)).product();
    shrunk.powf(1.0 / d)
}

/// The radii of all maps together.
fn radii(maps: &[(u32, Summary)]) -> Radii {
    let photons: usize = maps.iter().map(|(_, map)| map.photons).sum();
    maps.iter().fold(Radii { min: f32::INFINITY, mean: 0.0, max: 0.0 }, |all, (_, map)| {
        let Radii { min, mean, max } = map.radii;
        let share = map.photons as f32 / photons as f32;
        Radii { min: all.min.min(min), mean: all.mean + share * mean, max: all.max.max(max) }
    })
}

/// Whether the map is too thin to be trusted.
fn sparse_map(plan: &Plan, traced: &photon::Traced) -> Option<String> {
    let (stored, emitted, wanted) = (traced.stored(), traced.emitted, plan.volume_photons);
    if emitted == 0 {
        // Without a source there is nothing to say about photons.
        None
    } else if stored == 0 {
        Some(format!("none of {emitted} photons met a medium that scatters: media stay dark"))
    } else if stored < wanted / 2 {
        Some(format!(
            "the volume map holds {stored} of {wanted} photons after {emitted} emissions: raise photons.max_emitted, or aim the lights at the media"
        ))
    } else if emitted < 1000 {
        Some(format!("the volume map stems from only {emitted} emissions: raise photons.max_emitted"))
    } else {
        None
    }
}

/// Photons of a glow start in a box around it.
fn endless_glow(scene: &Scene) -> Option<String> {
    let medium = &scene.media[scene.world? as usize];
    let endless = medium.glows() && medium.scatters() && !medium.density.support().size().is_finite();
    endless.then(|| {
        format!(
            "medium {} glows and has no end: of its light, method \"photon\" leaves out what is scattered; put it into a shape, or use method \"path\"",
            medium.name
        )
    })
}

/// The medium of a region.
fn medium_of(scene: &Scene, region: u32) -> Option<&Medium> {
    let solid = scene.solids.iter().find(|solid| solid.region == region);
    let medium = solid.map_or(scene.world, |solid| solid.medium)?;
    Some(&scene.media[medium as usize])
}

/// Of each region, by [`mean_extinction`].
pub(super) fn mean_extinctions(scene: &Scene, regions: &[Vec<Photon>]) -> Vec<f64> {
    (0..).zip(regions).map(|(region, photons)| mean_extinction(scene, region, photons)).collect()
}

/// The largest channel's extinction where a region's photons are, on average.
fn mean_extinction(scene: &Scene, region: u32, photons: &[Photon]) -> f64 {
    let Some(medium) = medium_of(scene, region).filter(|_| !photons.is_empty()) else { return 0.0 };
    let density: f64 = if medium.density.is_even() {
        1.0
    } else {
        // A few thousand tell enough.
        let step = photons.len().div_ceil(4096);
        let some: Vec<f64> =
            photons.iter().step_by(step).map(|photon| medium.density.at(photon.position.as_dvec3())).collect();
        some.iter().sum::<f64>() / some.len() as f64
    };
    medium.extinction.max_element() * density
}

/// Where discs are wider than this many mean free paths, light is blurred across the layer it enters by.
const WIDE: f64 = 0.3;

/// Discs that lean on boundaries blend no depths, but near edges and along the surface they do blur.
const WIDE_LEANING: f64 = 100.0;

fn wide_discs(scene: &Scene, region: u32, radii: Radii, extinction: f64, leans: bool) -> Option<String> {
    let share = radii.mean as f64 * extinction;
    let (most, wrong) =
        if leans { (WIDE_LEANING, "blurred, and wrong near edges") } else { (WIDE, "blurred and too dark") };
    medium_of(scene, region).filter(|_| share > most).map(|medium| {
        format!(
            "medium {}: photons are spread over {:.3e} on average, which is {share:.2} mean free paths; above {most} its lit surface is {wrong}: raise photons.volume, lower volume.neighbours or volume.radius, or use method \"path\"",
            medium.name, radii.mean
        )
    })
}

fn report(stats: &Stats, warnings: &mut Vec<String>) {
    let Tally { violations, stopped, broken } = stats.tally;
    if violations > 0 {
        warnings.push(format!("{violations} look-ups exceeded their majorant"));
    }
    if stopped > 0 {
        warnings.push(format!("{stopped} walks were cut off after 10⁹ events"));
    }
    if broken > 0 {
        warnings.push(format!("{broken} samples or photons were dropped because a number was not finite or above 10³⁰: the light is too strong for images of 32-bit numbers"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_follow_the_law() {
        // ∏ (k + α)/(k + 1) = Γ(n + 1 + α)/(Γ(1 + α) Γ(n + 2)), n passes later, by Stirling's series.
        let ln_gamma = |x: f64| {
            let shift: f64 = (0..20).map(|i| (x + i as f64).ln()).sum();
            let y = x + 20.0;
            (y - 0.5) * y.ln() - y + 0.5 * (2.0 * std::f64::consts::PI).ln() + 1.0 / (12.0 * y)
                - 1.0 / (360.0 * y.powi(3))
                - shift
        };
        for (dimension, alpha) in [(2u32, 2.0 / 3.0), (3, 4.0 / 7.0)] {
            assert_eq!(narrowing(0, dimension), 1.0);
            let mut power = 1.0;
            for before in 0..200u32 {
                let n = before as f64;
                let found = narrowing(before, dimension).powi(dimension as i32);
                let closed = (ln_gamma(n + 1.0 + alpha) - ln_gamma(1.0 + alpha) - ln_gamma(n + 2.0)).exp();
                assert!((found / power - 1.0).abs() < 1e-12, "{dimension} {before}: {found} {power}");
                assert!((found / closed - 1.0).abs() < 1e-9, "{dimension} {before}: {found} {closed}");
                power *= (n + 1.0 + alpha) / (n + 2.0);
            }
            // Blur falls with the radius squared as fast as noise with r^{−d/2} N^{−1/2}.
            let slope = (narrowing(1 << 20, dimension) / narrowing(1 << 16, dimension)).log2() / 4.0;
            assert!((slope + 1.0 / (4.0 + dimension as f64)).abs() < 1e-4, "{dimension}: {slope}");
        }
    }
}
