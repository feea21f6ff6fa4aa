//! The passes of a render: photons, maps, and samples through every pixel.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use super::camera::Camera;
use super::eye::Mode;
use super::film::{Film, Layers};
use super::plan::Plan;
use crate::gather::{GatherStats, VolumeMaps};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::photon::{self, MapSettings, Photon, PhotonMap, Radii, walls};
use crate::scene::Scene;
use crate::scene::description::{Method, SingleScattering};
use crate::transport::Tally;
use crate::{Error, Result};

/// Hears how far a render has come.
pub trait Progress: Sync {
    /// A phase begins, of so many steps (0 if unknown).
    fn phase(&self, name: &'static str, steps: u64);
    /// Steps were done.
    fn advance(&self, steps: u64);
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
    /// Whether it was interrupted before its end.
    pub interrupted: bool,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// What a render cost.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    /// Seconds in the photon pass.
    pub photons_seconds: f64,
    /// Seconds for radii and hierarchies.
    pub build_seconds: f64,
    /// Seconds for the pixels.
    pub render_seconds: f64,
    /// Photons emitted, in all passes.
    pub emitted: u64,
    /// Volume photons stored, in all passes.
    pub volume: u64,
    /// The largest map, in bytes.
    pub map_bytes: u64,
    /// The discs' radii, of the last pass.
    pub radii: Radii,
    /// Beam queries.
    pub gather: GatherStats,
    /// Passes done.
    pub passes: u32,
    /// Camera samples per pixel done.
    pub samples: u32,
    /// Counts of mishaps.
    pub tally: Tally,
}

/// Renders a scene on the current thread pool. `stop` ends it early, with what there is by then.
///
/// # Errors
/// [`Error::Scene`] where the scene has no steady state; [`Error::Limit`] if the film does not fit into memory.
pub fn render(scene: &Scene, progress: &impl Progress, stop: &AtomicBool) -> Result<Rendering> {
    let camera = Camera::new(&scene.camera, &scene.film);
    let film = film(scene)?;
    let plan = Plan::new(scene, &camera)?;
    let mut renderer =
        Renderer { scene, camera, plan, progress, stop, film, stats: Stats::default(), warnings: Vec::new() };
    for pass in 0..renderer.plan.passes {
        if !renderer.pass(pass) {
            break;
        }
    }
    let Renderer { film, stats, mut warnings, .. } = renderer;
    report(&stats, &mut warnings);
    Ok(Rendering { film, stats, interrupted: stop.load(Ordering::Relaxed), warnings })
}

/// A film larger than this is refused.
const MOST_FILM_BYTES: u64 = 16 << 30;

fn film(scene: &Scene) -> Result<Film> {
    let layers = Layers { components: scene.film.layers, standard_error: scene.film.standard_error };
    let (width, height) = (scene.film.width, scene.film.height);
    let bytes = Film::bytes(width, height, layers);
    if bytes > MOST_FILM_BYTES {
        let gib = |bytes: u64| bytes as f64 / (1u64 << 30) as f64;
        return Err(Error::Limit(format!(
            "a film of {width} × {height} pixels takes {:.1} GiB of memory, more than {:.0} GiB: render it in parts, or without film.layers",
            gib(bytes),
            gib(MOST_FILM_BYTES)
        )));
    }
    Ok(Film::new(width, height, layers))
}

/// A render under way.
pub(super) struct Renderer<'s, P> {
    pub(super) scene: &'s Scene,
    pub(super) camera: Camera,
    pub(super) plan: Plan,
    pub(super) progress: &'s P,
    pub(super) stop: &'s AtomicBool,
    pub(super) film: Film,
    pub(super) stats: Stats,
    warnings: Vec<String>,
}

impl<P: Progress> Renderer<'_, P> {
    /// One pass. Returns whether it came to its end.
    fn pass(&mut self, pass: u32) -> bool {
        let maps = match self.plan.method {
            Method::Photon => Some(self.maps(pass)),
            Method::Path => None,
        };
        if self.stopped() {
            return false;
        }
        let mode = match &maps {
            Some(maps) => Mode::Gather(maps),
            None if self.plan.split => Mode::Split,
            None => Mode::Track,
        };
        let start = Instant::now();
        self.expose(mode, pass);
        self.stats.render_seconds += start.elapsed().as_secs_f64();
        if self.stopped() {
            return false;
        }
        self.film.end_pass();
        self.stats.passes += 1;
        self.stats.samples += self.plan.samples;
        true
    }

    /// The photon maps of a pass, one for each region.
    fn maps(&mut self, pass: u32) -> VolumeMaps {
        let (scene, progress) = (self.scene, self.progress);
        let empty = || VolumeMaps::new((0..scene.regions).map(|_| None).collect(), &scene.media);
        if self.plan.volume_photons == 0 {
            return empty();
        }
        let start = Instant::now();
        let announced = AtomicU64::new(0);
        progress.phase("photons", 0);
        let order = photon::Pass {
            seed: scene.render.seed,
            index: pass as u64,
            target: self.plan.volume_photons,
            max_emitted: scene.photons.max_emitted,
        };
        let advance = |done, all| {
            if announced.swap(all, Ordering::Relaxed) != all {
                progress.phase("photons", all);
            }
            progress.advance(done);
        };
        let traced = photon::trace(scene, &order, &advance, &|| self.stopped());
        self.stats.photons_seconds += start.elapsed().as_secs_f64();
        self.stats.emitted += traced.emitted;
        self.stats.volume += traced.stored();
        self.stats.tally = self.stats.tally.merge(traced.tally);
        if self.stopped() {
            return empty();
        }
        if pass == 0 {
            if scene.volume.single_scattering == SingleScattering::Photons || traced.stored() > 0 {
                self.warnings.extend(sparse_map(&self.plan, &traced));
            }
            self.warnings.extend(endless_glow(scene));
        }

        let extinctions: Vec<f64> =
            (0..).zip(&traced.regions).map(|(i, photons)| mean_extinction(scene, i, photons)).collect();
        let start = Instant::now();
        progress.phase("build", 0);
        let settings = MapSettings { tagged: self.plan.tagged, ..MapSettings::new(self.plan.radius) };
        // The disc is drawn around a foot point that may be a radius away from the photon.
        let near = |position, radius, planes: &mut _| walls::near(scene, position, 2.0 * radius, planes);
        let build = |photons: Vec<Photon>| (!photons.is_empty()).then(|| PhotonMap::build(photons, &settings, &near));
        let maps = VolumeMaps::new(traced.regions.into_iter().map(build).collect(), &scene.media);
        if pass == 0 {
            let wide =
                |(region, map): (u32, &PhotonMap)| wide_discs(scene, region, map.radii(), extinctions[region as usize]);
            self.warnings.extend(maps.by_region().filter_map(wide));
        }
        self.stats.tally.broken += maps.maps().map(|map| map.rejected() as u64).sum::<u64>();
        self.stats.map_bytes = self.stats.map_bytes.max(maps.maps().map(|map| map.bytes() as u64).sum());
        self.stats.radii = radii(&maps);
        self.stats.build_seconds += start.elapsed().as_secs_f64();
        maps
    }
}

/// The radii of all maps together.
fn radii(maps: &VolumeMaps) -> Radii {
    let photons: usize = maps.maps().map(PhotonMap::len).sum();
    maps.maps().fold(Radii { min: f32::INFINITY, mean: 0.0, max: 0.0 }, |all, map| {
        let Radii { min, mean, max } = map.radii();
        let share = map.len() as f32 / photons as f32;
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

/// The largest channel's extinction where a region's photons are, on average.
fn mean_extinction(scene: &Scene, region: u32, photons: &[Photon]) -> f64 {
    let Some(medium) = medium_of(scene, region).filter(|_| !photons.is_empty()) else { return 0.0 };
    let density: f64 = match medium.density {
        Density::Uniform => 1.0,
        _ => {
            // A few thousand tell enough.
            let step = photons.len().div_ceil(4096);
            let some: Vec<f64> =
                photons.iter().step_by(step).map(|photon| medium.density.at(photon.position.as_dvec3())).collect();
            some.iter().sum::<f64>() / some.len() as f64
        }
    };
    medium.extinction.max_element() * density
}

/// Where discs are wider than this many mean free paths, light is blurred across the layer it enters by.
const WIDE: f64 = 0.3;

fn wide_discs(scene: &Scene, region: u32, radii: Radii, extinction: f64) -> Option<String> {
    let share = radii.mean as f64 * extinction;
    medium_of(scene, region).filter(|_| share > WIDE).map(|medium| {
        format!(
            "medium {}: photons are spread over {:.3e} on average, which is {share:.2} mean free paths; above {WIDE} its lit surface is blurred and too dark: raise photons.volume, lower volume.neighbours, or use method \"path\"",
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
