//! How the irradiance cache of a pass is filled: wherever pixels see a Lambertian surface that no record tells enough about.
//!
//! Which places get a record depends on the pass alone, never on threads: pixels are looked at from coarse to fine, those whose
//! place is not covered are taken in batches, in a shuffled order, and after each batch it is found out anew which of the others are
//! left. So the image is the same for any number of threads, resumed or merged.

use std::ops::ControlFlow;

use rayon::prelude::*;

use super::camera::Camera;
use super::eye::{Context, Eye, Mode, Path};
use super::plan::{CacheSettings, Plan};
use crate::gather::{GatherStats, Gathering, IrradianceCache, Limits, Queue, Record};
use crate::math::random::{Purpose, mix};
use crate::math::{Frame, Rgb, Stream};
use crate::photon::PointMemory;
use crate::scene::Scene;
use crate::surface::{Nature, Side};
use crate::transport::{
    Event, Heading, Interaction, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex, Walk, travel,
};

/// What a pass's cache is filled from.
pub(super) struct Filler<'r, 's> {
    pub scene: &'s Scene,
    pub camera: &'r Camera,
    pub plan: &'r Plan,
    pub settings: CacheSettings,
    /// Gathers without a cache.
    pub eye: &'r Eye<'s>,
    pub pass: u32,
    /// By how much radii are narrowed.
    pub scale: f64,
}

/// A filled cache, and what it cost.
#[derive(Debug, Default)]
pub(super) struct Filled {
    pub cache: IrradianceCache,
    pub gathered: GatherStats,
    pub tally: Tally,
}

/// Of how many pixels along each axis one is looked at, from round to round.
const STRIDES: [u32; 5] = [16, 8, 4, 2, 1];
/// So often all pixels are looked at again in the end: records that yield to others leave places behind that were covered, which are grainy islands
/// in large pictures.
const LAST_LOOKS: usize = 8;
/// Records that are made before it is found out which others are still wanted. Fewer leave processors idle, more make records that
/// others would have told.
pub(super) const BATCH: usize = 128;
/// Records take no more gather rays than so many times those that there would be without a cache.
const MOST_RAYS: u64 = 4;
/// A path that sees less than this of a surface asks for no record there,
const FAINTEST: f64 = 0.02;
/// nor one with more events than this before.
const MOST_EVENTS: u64 = 8;

/// Records that a film of this size has at most, with so many samples a pixel: on what is rough all over, a cache finds no rest.
pub(super) fn most_records((width, height): (u32, u32), samples: u32, settings: &CacheSettings) -> u64 {
    let rays = MOST_RAYS * u64::from(width) * u64::from(height) * u64::from(samples);
    rays.div_ceil(settings.rays() as u64)
}

impl<'s> Filler<'_, 's> {
    /// Fills the cache, until all is covered or `stop` says so.
    pub fn fill(&self, stop: &(impl Fn() -> bool + Sync)) -> Filled {
        let (width, height) = self.camera.size();
        let most = most_records((width, height), self.plan.samples, &self.settings) as usize;
        let mut filled = Filled::default();
        let coarse_to_fine = STRIDES.into_iter().zip(std::iter::once(true).chain(std::iter::repeat(false)));
        for (stride, all) in coarse_to_fine.chain(std::iter::repeat_n((1, true), LAST_LOOKS)) {
            let is_old = |x: u32| x.is_multiple_of(2 * stride);
            let is_new = |x: u32, y: u32| all || !(is_old(x) && is_old(y));
            let rows = (0..height).into_par_iter().step_by(stride as usize);
            let cache = &filled.cache;
            let is_wanted = |&(x, y): &(u32, u32)| self.find(x, y).is_some_and(|found| !found.is_covered(cache));
            let new = |y: u32| (0..width).step_by(stride as usize).map(move |x| (x, y)).filter(|&(x, y)| is_new(x, y));
            let mut wanted: Vec<(u32, u32)> = rows.flat_map_iter(|y| new(y).filter(is_wanted)).collect();
            if stride == 1 && all && wanted.is_empty() {
                break;
            }
            wanted.sort_by_key(|&(x, y)| (mix(u64::from(y) << 32 | u64::from(x)), x, y));
            while !wanted.is_empty() && filled.cache.len() < most && !stop() {
                let rest = wanted.split_off(wanted.len().min(BATCH).min(most - filled.cache.len()));
                let made: Vec<_> =
                    wanted.par_iter().map_init(Room::default, |room, &at| self.record(at, room)).collect();
                let records = made.into_iter().filter_map(|(record, gathered, tally)| {
                    filled.gathered += gathered;
                    filled.tally = filled.tally.merge(tally);
                    record
                });
                filled.cache.extend(records, self.settings.error);
                let cache = &filled.cache;
                let is_wanted = |&(x, y): &(u32, u32)| self.find(x, y).is_some_and(|found| !found.is_covered(cache));
                wanted = rest.into_par_iter().filter(is_wanted).collect();
            }
        }
        filled
    }

    /// The surface that a pixel sees, straight or by specular events.
    fn find(&self, x: u32, y: u32) -> Option<Found<'s>> {
        let pixel = u64::from(y) * u64::from(self.camera.size().0) + u64::from(x);
        let mut stream = Stream::new(self.plan.seed, Purpose::Irradiance, 2 * pixel, self.pass.into());
        let ray = self.camera.ray(x, y, &mut stream);
        let inside = self.plan.inside.clone().unwrap_or_else(|| self.scene.inside(ray.origin));
        let start =
            Part { walk: Walk::start(self.scene, ray, inside), luggage: Luggage::new(Rgb::ONE, 0.0), collision: None };
        let mut finder = Finder { scene: self.scene, stream, found: None };
        travel(&mut finder, start, &mut Parts::new());
        finder.found
    }

    /// A record of the place that a pixel sees.
    fn record(&self, (x, y): (u32, u32), room: &mut Room<'s>) -> (Option<Record>, GatherStats, Tally) {
        let mut tally = Tally::default();
        let Some(Found { at, walk, distance }) = self.find(x, y) else { return (None, GatherStats::default(), tally) };
        let CacheSettings { cells, spacing, max_radius, min_pixels, .. } = self.settings;
        let pixel = u64::from(y) * u64::from(self.camera.size().0) + u64::from(x);
        let mut stream = Stream::new(self.plan.seed, Purpose::Irradiance, 2 * pixel + 1, self.pass.into());

        // Rays through all cells, of which those that a shading normal leads below the surface find nothing.
        let frame = Frame::around(at.incidence.shading_normal);
        let rays = self.rays(&at, &frame, &mut room.flux);
        let mut found: Vec<Gathering> = Vec::with_capacity(rays.iter().sum::<u32>() as usize);
        let mut start = [0.0; 2];
        for (cell, number, of) in rays.iter().enumerate().flat_map(|(cell, &of)| (0..of).map(move |i| (cell, i, of))) {
            if number == 0 {
                start = stream.uniform2();
            }
            let direction = cells.direction(cell, &frame, spread(start, number, of));
            let mut context = Context {
                stream: &mut stream,
                queue: &mut room.queue,
                pixel: found.len() as u32,
                tally: &mut tally,
                parts: &mut room.parts,
            };
            let above = direction.dot(at.incidence.normal) > 0.0;
            let (radiance, distance) =
                if above { self.eye.gather(&at, &walk, direction, &mut context) } else { (Rgb::ZERO, f64::INFINITY) };
            found.push(Gathering { direction, radiance, distance, cell, of });
        }
        if let Mode::Gather(maps) = self.eye.mode() {
            maps.gather_streams(&mut room.queue);
            for (claim, gathered) in room.queue.done.drain(..) {
                let due = claim.settle(&gathered, &mut tally);
                found[claim.pixel as usize].radiance += due[0].1 + due[1].1;
            }
        }
        let [pixel, growth] = self.camera.cone();
        let least = min_pixels * (pixel + growth * distance);
        let limits = Limits::seen(least, frame.z, walk.ray.direction, max_radius);
        let record = Record::new(at.point, &frame, cells, &found, spacing, &limits);
        (Some(record.scaled(self.scale)), std::mem::take(&mut room.queue.stats), tally)
    }

    /// How many rays go through each cell of a record: more where photons say that much light comes from, or evenly where they say nothing.
    fn rays(&self, at: &Interaction, frame: &Frame, memory: &mut PointMemory) -> Vec<u32> {
        let CacheSettings { cells, by_flux, .. } = self.settings;
        let mut flux = vec![0.0; cells.count()];
        if let Some(map) = self.eye.flux() {
            map.around((at.point, at.incidence.normal), memory, |from, power| {
                cells.add(frame.to_local(from), power, &mut flux)
            });
        }
        cells.rays(&flux, by_flux)
    }
}

/// Number `number` of so many places in the unit square, spread evenly from `start` on: as a lattice.
fn spread([u, v]: [f64; 2], number: u32, of: u32) -> [f64; 2] {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    [(u + f64::from(number)) / f64::from(of), (v + GOLDEN * f64::from(number)).fract()]
}

/// What a thread keeps from record to record: memory.
#[derive(Default)]
struct Room<'s> {
    queue: Queue<super::eye::Claim>,
    parts: Parts<'s, Path>,
    flux: PointMemory,
}

/// A surface that a pixel sees.
struct Found<'s> {
    at: Interaction,
    /// The way to it.
    walk: Walk<'s>,
    /// How long that is.
    distance: f64,
}

impl Found<'_> {
    fn is_covered(&self, cache: &IrradianceCache) -> bool {
        cache.covers(self.at.point, self.at.incidence.shading_normal)
    }
}

/// Looks for the first Lambertian surface on the way of a camera ray. It carries the length of its way until it turned
/// last.
struct Finder<'s> {
    scene: &'s Scene,
    stream: Stream,
    found: Option<Found<'s>>,
}

impl<'s> Traveller<'s> for Finder<'s> {
    type Own = f64;

    fn scene(&self) -> &'s Scene {
        self.scene
    }

    fn stream(&mut self) -> &mut Stream {
        &mut self.stream
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<f64>,
        _: &mut Parts<'s, f64>,
    ) -> ControlFlow<f64> {
        let medium = &self.scene.media[segment.medium as usize];
        luggage.weight *= medium.transmittance(medium.density.depth(segment.ray, segment.a, segment.b));
        ControlFlow::Continue(())
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &mut Luggage<f64>,
        _: &mut Parts<'s, f64>,
    ) -> Option<Heading> {
        let Vertex::Surface(surface) = at else { return None };
        let distance = luggage.own + surface.t;
        luggage.events += 1;
        if luggage.weight.max_element() < FAINTEST || luggage.events > MOST_EVENTS {
            return None;
        }
        if surface.bsdf.nature() == Nature::Diffuse {
            if surface.bsdf.lambertian().is_some_and(|reflectance| reflectance.max_element() > 0.0) {
                self.found = Some(Found { at: surface.clone(), walk: walk.clone(), distance });
            }
            return None;
        }
        let always = |weight: &mut Rgb, factor: Rgb, _: &mut Stream| {
            *weight *= factor;
            true
        };
        let onward = at.onward(Side::Eye, None, &mut luggage.weight, &mut self.stream, always)?;
        if at.event(&onward) != Event::Passed {
            luggage.own = distance;
        }
        Some(Heading { direction: onward.direction })
    }

    fn stopped(&mut self) {}
}
