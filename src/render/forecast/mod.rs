//! What a scene gets, and why: every pass and structure that a render may have, whether this one has it, and what it takes.
//!
//! `items` says which there are, by the decisions of the [`Plan`] and by whoever takes them; `sample` traces some of a pass's photons,
//! and builds maps of them, to tell what all of them will take. The samples are the first photons of the render itself, so their
//! maps differ from its own in size alone. `look` follows some camera paths through these maps, and counts what they do; `work` has what is counted, and what it
//! costs, which `calibrate` measures. Nothing here is told by a clock but that, and no decision depends on it.

mod calibrate;
mod items;
mod look;
mod sample;
mod work;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use work::Timed;
pub use work::{Costs, Unit, Work};

use super::camera::Camera;
use super::choice::Choice;
use super::limits::Limits;
use super::plan::Plan;
use crate::Result;
use crate::scene::{Scene, Settings};

/// What a render of a scene will be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Forecast {
    /// The method, as scene files call it.
    pub method: &'static str,
    /// Why that one.
    pub why: String,
    /// The seed of all random numbers.
    pub seed: u64,
    /// Pixels across and down.
    pub film: [u32; 2],
    /// Camera samples per pixel in a pass.
    pub samples: u64,
    /// Passes, each with fresh photons; `None` where time or error end them.
    pub passes: Option<u32>,
    /// Parts that each pass is made in.
    pub parts: u32,
    /// Passes and structures. In JSON an object with the names as keys.
    #[serde(serialize_with = "by_name")]
    pub items: Vec<Item>,
    /// What the largest of them take.
    pub bytes: Bytes,
    /// Seconds of one thread that all passes take, or one where time or error end them; without what comes before the first. `None` where no
    /// costs of this machine are known.
    pub seconds: Option<f64>,
}

/// A pass or a structure that a render may have.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Item {
    /// Its name, which stays the same from version to version.
    #[serde(skip)]
    pub name: &'static str,
    /// Whether this render has it because it needs it.
    pub needed: bool,
    /// Whether it has it only because it is forced ([`Limits::forced`]).
    pub forced: bool,
    /// Why, or why not.
    pub why: String,
    /// How many there are, in each part of a pass: photons of a map, rays, records, as the name says.
    pub count: Option<u64>,
    /// Photons that are emitted for it.
    pub emitted: Option<u64>,
    /// Events of these on their way: reflections, refractions and collisions.
    pub events: Option<u64>,
    /// The memory it takes, in bytes.
    pub bytes: Option<u64>,
    /// What it has to do in all passes, or in one where time or error end them.
    #[serde(skip_serializing_if = "Work::is_none")]
    pub work: Work,
    /// A part of such work that was done, where that was timed.
    #[serde(skip)]
    timed: Option<Timed>,
    /// The share of the time of all items that this takes, by [`Forecast::price`]; `None` where that is not told.
    pub share: Option<f64>,
    /// Seconds of one thread, where the costs are those of this machine.
    pub seconds: Option<f64>,
}

/// Memory in bytes, as `--stats` tells it of a finished render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Bytes {
    /// The most that the film takes.
    pub film: u64,
    /// The maps of photons in media.
    pub volume_map: u64,
    /// The maps of photons on surfaces.
    pub surface_maps: u64,
    /// Voxels.
    pub density: u64,
    /// The most that maps take together with photons as they were traced, which are there beside a map while it is built.
    pub building: u64,
    /// What the film takes while pixels are summed: all but the picture that is made of it.
    #[serde(skip)]
    sums: u64,
    /// Photons as they were traced, at most at one time.
    #[serde(skip)]
    traced: u64,
    /// The most that the process will hold; only where [`Bytes::foretell`] was told what it holds already.
    pub peak: Option<u64>,
}

impl Bytes {
    /// Foretells the most that a process will hold which has loaded the scene and will render on so many threads: that takes `resident` bytes now, and
    /// took `most` meanwhile.
    pub fn foretell(&mut self, (resident, most): (u64, u64), threads: usize) {
        // Threads beside the first get memory of their own for photons that they trace, of which the allocator keeps about so much each.
        const KEPT: u64 = 4 << 20;
        let kept = (self.traced / 2).min(KEPT * threads.saturating_sub(1) as u64);
        // What threads and pilots hold; found on the scenes of `scenes/`.
        const SCRATCH: u64 = 1 << 20;
        // Maps are gone before the picture is made.
        let rendering = (self.sums + self.building).max(self.film);
        self.peak = Some((resident + rendering + kept + SCRATCH).max(most));
    }
}

impl Forecast {
    /// What a render will be, and what it will take. Some of its photons are traced for that, and nothing is rendered. `choice` is
    /// what [`choose`](super::choose) said, if it was asked.
    ///
    /// # Errors
    /// As [`render`](super::render), for scenes and limits that it refuses.
    pub fn new(scene: &Scene, settings: &Settings, limits: &Limits, choice: Option<&Choice>) -> Result<Forecast> {
        Forecast::timed(scene, settings, limits, choice, &|| None)
    }

    /// As [`Forecast::new`]; what is done to tell what a render will take is timed by a clock, if that tells seconds that were computed, on a pool of
    /// one thread. So [`Forecast::price`] knows what these shapes, densities and maps cost on this machine.
    ///
    /// # Errors
    /// As [`Forecast::new`].
    pub fn timed(
        scene: &Scene,
        settings: &Settings,
        limits: &Limits,
        choice: Option<&Choice>,
        clock: &dyn Fn() -> Option<f64>,
    ) -> Result<Forecast> {
        let camera = Camera::new(&scene.camera, &settings.film);
        let plan = Plan::new(scene, settings, &camera, limits)?;
        let samples = sample::Samples::take(scene, &plan, clock)?;
        let mut forecast = Forecast::of(scene, settings, limits, &plan, choice);
        forecast.items = items::of(scene, settings, limits, (&plan, choice), Some(&samples));
        forecast.set_work(look::work_of_all(scene, &camera, &plan, &samples, clock));
        forecast.bytes = Bytes {
            volume_map: samples.volume_bytes(),
            surface_maps: samples.surface_bytes(),
            building: samples.building_bytes(),
            traced: samples.traced_bytes(),
            ..forecast.bytes
        };
        Ok(forecast)
    }

    /// What a planned render will be, as far as the plan tells: without what its photons will come to.
    pub fn of(scene: &Scene, settings: &Settings, limits: &Limits, plan: &Plan, choice: Option<&Choice>) -> Forecast {
        let (width, height) = settings.film.size();
        let ends = limits.time.is_none() && limits.target_error.is_none();
        let passes = limits.passes(settings);
        let why = match choice {
            Some(Choice { why, .. }) => why.clone(),
            None => "as the scene says".to_string(),
        };
        Forecast {
            method: plan.method.name(),
            why,
            seed: plan.seed,
            film: [width, height],
            samples: u64::from(plan.samples) * u64::from(plan.parts),
            passes: (ends || limits.passes.is_some()).then(|| passes.end() + 1 - passes.start()),
            parts: plan.parts,
            items: items::of(scene, settings, limits, (plan, choice), None),
            bytes: Bytes {
                film: limits.film_bytes(settings, plan.parts),
                sums: limits.sums_bytes(settings, plan.parts),
                density: crate::medium::bytes(&scene.media),
                ..Bytes::default()
            },
            seconds: None,
        }
    }

    /// Tells what items have to do in one part of a pass.
    fn set_work(&mut self, works: Vec<look::Part>) {
        let parts = f64::from(self.passes.unwrap_or(1)) * f64::from(self.parts);
        for (name, work, timed) in works {
            if let Some(item) = self.items.iter_mut().find(|item| item.name == name) {
                (item.work, item.timed) = (work.times(parts), timed);
            }
        }
        self.price(&Costs::TYPICAL, false);
    }

    /// Tells what share of the time each item takes, and, if these costs are those of `this_machine`, how many seconds.
    pub fn price(&mut self, costs: &Costs, this_machine: bool) {
        let timed = |item: &Item| item.timed.filter(|_| this_machine);
        let seconds: Vec<f64> =
            self.items.iter().map(|item| costs.seconds_by(&item.work, timed(item).as_ref())).collect();
        let all: f64 = seconds.iter().sum();
        for (item, seconds) in self.items.iter_mut().zip(seconds).filter(|(_, seconds)| *seconds > 0.0) {
            item.share = Some(seconds / all);
            item.seconds = this_machine.then_some(seconds);
        }
        self.seconds = this_machine.then_some(all);
    }

    /// An item by its name.
    pub fn item(&self, name: &str) -> Option<&Item> {
        self.items.iter().find(|item| item.name == name)
    }

    /// The plan in one line: the method, the photons of each map, and why those are missing that are.
    pub fn line(&self) -> String {
        let mut parts = vec![format!("method {}, {}", self.method, self.why)];
        if self.method == crate::scene::description::Method::Photon.name() {
            for (name, what) in
                [("volume_photons", "volume"), ("caustic_photons", "caustic"), ("global_photons", "global")]
            {
                let Some(item) = self.item(name) else { continue };
                parts.push(match (item.needed, item.count) {
                    (true, Some(count)) => format!("{count} {what} photons"),
                    (true, None) => format!("{what} photons"),
                    (false, _) => format!("no {what} map, as {}", item.why),
                });
            }
        }
        parts.join("; ")
    }
}

fn by_name<S: Serializer>(items: &[Item], serializer: S) -> std::result::Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(items.len()))?;
    for item in items {
        map.serialize_entry(item.name, item)?;
    }
    map.end()
}
