//! One set of photons for several renders, so that they differ in how they gather and in nothing else.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::camera::Camera;
use super::film::Film;
use super::limits::Limits;
use super::maps::{Maps, VolumeMap, mean_extinctions};
use super::pass::{self, Rendering, order};
use super::plan::Plan;
use super::progress::{Progress, Silent};
use super::stats::Stats;
use crate::photon::{self, Photon};
use crate::scene::{Scene, Settings};
use crate::transport::Tally;
use crate::{Error, Result};

/// The photons of a scene's first pass.
#[derive(Clone, Debug)]
pub struct SharedPhotons {
    regions: Vec<Vec<Photon>>,
    /// Photons emitted.
    pub emitted: u64,
    /// Seconds it took to trace them.
    pub seconds: f64,
    tally: Tally,
}

/// A map of shared photons, as a scene's settings want it: of discs for beams, of points for marching.
#[derive(Debug)]
pub struct SharedMap {
    maps: Maps,
    stats: Stats,
}

impl SharedPhotons {
    /// Traces the photons of a scene's first pass on the current thread pool.
    ///
    /// # Errors
    /// As [`refine`](super::refine); [`Error::Interrupted`] if `stop` is set meanwhile.
    pub fn trace(
        scene: &Scene,
        settings: &Settings,
        progress: &impl Progress,
        stop: &AtomicBool,
    ) -> Result<SharedPhotons> {
        let camera = Camera::new(&scene.camera, &settings.film);
        let plan = Plan::new(scene, settings, &camera, &Limits::default())?;
        let start = Instant::now();
        let mut photons = SharedPhotons {
            regions: vec![Vec::new(); scene.regions as usize],
            emitted: 0,
            seconds: 0.0,
            tally: Tally::default(),
        };
        if plan.volume_photons > 0 {
            progress.phase("photons", 0);
            let advance = |done, _| progress.advance(done);
            let traced = photon::trace(scene, &order(&plan, 0), &advance, &|| stop.load(Ordering::Relaxed))?;
            if stop.load(Ordering::Relaxed) {
                return Err(Error::Interrupted);
            }
            (photons.regions, photons.emitted, photons.tally) = (traced.regions, traced.emitted, traced.tally);
        }
        photons.seconds = start.elapsed().as_secs_f64();
        Ok(photons)
    }

    /// The photons that lie in media, by region of the scene: as they were traced, around the scene's
    /// [`center`](Scene::center).
    pub fn regions(&self) -> &[Vec<Photon>] {
        &self.regions
    }

    /// Photons stored.
    pub fn stored(&self) -> u64 {
        self.regions.iter().map(|photons| photons.len() as u64).sum()
    }
}

impl SharedMap {
    /// Builds the map that `settings` want: with the radii of the first pass.
    ///
    /// # Errors
    /// As [`refine`](super::refine).
    pub fn build(scene: &Scene, settings: &Settings, photons: &SharedPhotons) -> Result<SharedMap> {
        let camera = Camera::new(&scene.camera, &settings.film);
        let plan = Plan::new(scene, settings, &camera, &Limits::default())?;
        let regions = photons.regions.clone();
        let start = Instant::now();
        let extinctions = mean_extinctions(scene, &regions);
        let mut maps = Maps::build(scene, &plan, 0, &extinctions, regions);
        let mut stats = Stats {
            emitted: photons.emitted,
            volume: photons.stored(),
            tally: photons.tally,
            build_seconds: start.elapsed().as_secs_f64(),
            ..Stats::default()
        };
        stats.built(&maps.summaries());
        maps.add_surfaces((scene, &plan, 0), (&mut stats, &Silent), &|| false)?;
        Ok(SharedMap { maps, stats })
    }

    /// What making it cost, and what it holds.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }
}

/// As [`refine`](super::refine), but that all passes gather from `map`, which was built for this scene (only how
/// rays are marched may have changed since): they differ in their camera samples alone. What the map cost is not
/// counted.
///
/// # Errors
/// As [`refine`](super::refine).
pub fn refine_shared(
    scene: &Scene,
    settings: &Settings,
    map: &mut SharedMap,
    limits: &Limits,
    before: Option<(Film, Stats)>,
    progress: &impl Progress,
    stop: &AtomicBool,
) -> Result<Rendering> {
    let camera = Camera::new(&scene.camera, &settings.film);
    let plan = Plan::new(scene, settings, &camera, limits)?;
    if let (Some(VolumeMap::Points(maps)), Some(points)) = (&mut map.maps.volume, &plan.points) {
        maps.march(&points.marchers);
    }
    pass::run(scene, settings, (camera, plan), limits, (before, Some(&map.maps)), progress, stop)
}
