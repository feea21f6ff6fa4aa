//! The passes of a render: photons, maps, and samples through every pixel.

use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use super::air;
use super::camera::Camera;
use super::clock::Clock;
use super::film::Film;
use super::limits::Limits;
use super::maps::{Maps, mean_extinctions};
use super::plan::Plan;
use super::progress::Progress;
use super::stats::Stats;
use super::tile::mode;
use super::warnings;
use crate::Result;
use crate::photon;
use crate::scene::description::Method;
use crate::scene::{Scene, Settings};

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
    let plan = Plan::new(scene, settings, &Camera::new(&scene.camera, &settings.film), limits)?;
    refine_planned(scene, settings, plan, limits, before, progress, stop)
}

/// [`refine`] by a plan that was made for this scene, settings and limits.
///
/// # Errors
/// As [`render`].
pub fn refine_planned(
    scene: &Scene,
    settings: &Settings,
    plan: Plan,
    limits: &Limits,
    before: Option<(Film, Stats)>,
    progress: &impl Progress,
    stop: &AtomicBool,
) -> Result<Rendering> {
    let camera = Camera::new(&scene.camera, &settings.film);
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
    let clock = &Clock::new(limits.time, film.has_samples());
    let mut warnings = Vec::new();
    if let Some(memory) = limits.memory
        && plan.parts > limits.parts_for_error(settings)
    {
        let (parts, mib) = (plan.parts, memory as f64 / (1u64 << 20) as f64);
        warnings.push(format!("to stay within {mib:.0} MiB, each pass is made in {parts} parts"));
    }
    if plan.method == Method::Light {
        warnings.extend(warnings::pinhole_in_medium(scene, &camera));
        warnings.extend(warnings::endless_glow(scene, Method::Light));
        warnings.extend(air::warning(scene, &camera, Method::Light));
    }
    let mut renderer = Renderer { scene, camera, plan, shared, progress, stop, clock, film, stats, warnings };
    let passes = limits.counted(settings, renderer.plan.parts);
    let end = renderer.run(passes, limits.target_error)?;
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
    warnings.extend(warnings::of_tally(&stats.tally));
    Ok(Rendering { film, stats, end, warnings })
}

/// Passes that tell how far apart passes are, at least.
const TELLING: u64 = 4;

/// A render under way.
pub(super) struct Renderer<'s, P> {
    pub(super) scene: &'s Scene,
    pub(super) camera: Camera,
    pub(super) plan: Plan,
    /// The maps of all passes, if there are such.
    shared: Option<&'s Maps>,
    pub(super) progress: &'s P,
    pub(super) stop: &'s AtomicBool,
    pub(super) clock: &'s Clock,
    pub(super) film: Film,
    pub(super) stats: Stats,
    pub(super) warnings: Vec<String>,
}

impl<P: Progress> Renderer<'_, P> {
    /// Makes passes until there is a reason to end.
    fn run(&mut self, passes: RangeInclusive<u32>, target_error: Option<f64>) -> Result<End> {
        let seed = self.plan.seed;
        let precise = |stats: &Stats| {
            let error = stats.error.filter(|_| stats.passes >= TELLING);
            target_error.is_some_and(|target| error.is_some_and(|error| error <= target))
        };
        self.stats.error = self.film.error();
        let missing = self.film.done().missing(seed, passes);
        for pass in missing {
            if precise(&self.stats) {
                return Ok(End::Precise);
            }
            if !self.clock.allows_a_pass() {
                return Ok(End::TimeUp);
            }
            let start = Instant::now();
            let (samples, before) = (self.plan.samples, self.stats.clone());
            if !self.pass(pass - 1)? {
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
                return Ok(if interrupted { End::Interrupted } else { End::TimeUp });
            }
            self.film.end_pass(seed, pass);
            self.clock.end_pass(start.elapsed());
            self.stats.passes += 1;
            self.stats.samples += self.plan.samples as u64;
            self.stats.error = self.film.error();
            self.progress.refined(&self.film, &self.stats);
        }
        Ok(if precise(&self.stats) { End::Precise } else { End::Finished })
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
        self.clock.shows_image();
        self.progress.refined(&self.film, &self.stats);
    }

    /// One pass. Returns whether it came to its end.
    fn pass(&mut self, pass: u32) -> Result<bool> {
        let unread = self.unread_maps(pass)?;
        let own;
        let maps = match (self.plan.method, self.shared) {
            (Method::Path | Method::Light | Method::Whitted, _) => None,
            (Method::Photon, Some(shared)) => Some(shared),
            (Method::Photon, None) => {
                own = self.maps(pass)?;
                Some(&own)
            }
        };
        if self.plan.unread.is_some() {
            let bytes = maps.map_or(0, Maps::surface_bytes) + unread.surface_bytes();
            self.stats.surface_bytes = self.stats.surface_bytes.max(bytes as u64);
        }
        let mode = mode(&self.plan, maps);
        let start = Instant::now();
        self.clock.begin_samples();
        self.expose(mode, maps, pass);
        self.stats.render_seconds += start.elapsed().as_secs_f64();
        // They take memory for as long as those do that are read.
        drop(unread);
        Ok(!self.stopped())
    }

    /// The maps of photons that are forced, which are for no one.
    fn unread_maps(&mut self, pass: u32) -> Result<Maps> {
        let Some(unread) = self.plan.unread.as_deref().cloned() else { return Ok(Maps::default()) };
        let warnings = self.warnings.len();
        let plan = std::mem::replace(&mut self.plan, unread);
        let maps = self.maps(pass);
        self.plan = plan;
        // No one sees what they lack.
        self.warnings.truncate(warnings);
        maps
    }

    /// The photon maps of a pass.
    fn maps(&mut self, pass: u32) -> Result<Maps> {
        let mut maps = self.volume_map(pass)?;
        let stop = || self.stop.load(Ordering::Relaxed) || self.clock.ends_photons();
        maps.add_surfaces((self.scene, &self.plan, pass), (&mut self.stats, self.progress), &stop)?;
        Ok(maps)
    }

    /// Those of photons in media.
    fn volume_map(&mut self, pass: u32) -> Result<Maps> {
        let (scene, progress) = (self.scene, self.progress);
        if self.plan.volume_photons == 0 {
            return Ok(Maps::default());
        }

        // Photons.
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
        let traced = photon::trace(scene, &order, &advance, &stop)?;
        let late = self.clock.ends_photons();

        // What they cost, and whether they are enough.
        self.stats.photons_seconds += start.elapsed().as_secs_f64();
        self.stats.emitted += traced.emitted;
        self.stats.volume += traced.stored();
        self.stats.tally = self.stats.tally.merge(traced.tally);
        if self.stop.load(Ordering::Relaxed) || (late && self.clock.has_image()) {
            return Ok(Maps::default());
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
            self.warnings.extend(warnings::sparse_map(&self.plan, &traced));
        }
        if first {
            self.warnings.extend(warnings::endless_glow(scene, Method::Photon));
            self.warnings.extend(air::warning(scene, &self.camera, Method::Photon));
        }

        // Their maps.
        let extinctions = mean_extinctions(scene, &traced.regions);
        let start = Instant::now();
        progress.phase("build", 0);
        let maps = Maps::build(scene, &self.plan, pass / self.plan.parts, &extinctions, traced.regions);
        let summaries = maps.summaries();
        if first {
            let beams = self.plan.points.is_none();
            self.warnings.extend(warnings::wide_discs(scene, &summaries, &extinctions, beams));
            self.warnings.extend(warnings::small_solids(scene, &summaries));
        }
        self.stats.built(&summaries);
        self.stats.build_seconds += start.elapsed().as_secs_f64();
        Ok(maps)
    }
}

/// What a pass asks the photon pass for.
pub(super) fn order(plan: &Plan, pass: u32) -> photon::Pass<'_> {
    photon::Pass {
        seed: plan.seed,
        index: pass as u64,
        target: plan.volume_photons,
        max_emitted: plan.max_emitted,
        emission: plan.emission,
        max_events: plan.max_events,
        single_scattering: plan.single_scattering,
        importons: plan.importons.as_ref().map(|importons| importons.media.as_slice()),
        control: plan.control().filter(|_| plan.controls_media),
    }
}
