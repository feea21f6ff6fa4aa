//! Photons on their way: they leave the lights, travel, and are deposited where they collide with a medium that scatters, or,
//! where its density is uneven, along their flights.

use std::ops::{ControlFlow, Range};

use rayon::prelude::*;

use super::budget::{Bill, Budget};
use super::control::Tagged;
use super::emission::{Emission, Sources, Start};
use super::history::History;
use super::importance::{Importon, Origin};
use super::simd::Isa;
use super::sinks::{Place, VolumeQuota, VolumeSink};
use super::wander::{Dense, Host, Wander, Wanderer};
use crate::math::random::{Dimension, Purpose};
use crate::math::{Ray, Rgb, Stream};
use crate::scene::description::SingleScattering;
use crate::scene::{Inside, Scene};
use crate::surface::{Nature, Side};
use crate::transport::{
    self, Ahead, Collision, Event, Events, Heading, Interaction, Luggage, Part, Parts, Segment, Tally, Traveller,
    Vertex, Walk, balance, survive, travel,
};

/// What a photon pass should do.
#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    /// The user's seed.
    pub seed: u64,
    /// The number of the pass: each draws photons of its own.
    pub index: u64,
    /// About how many photons the map should hold.
    pub target: u64,
    /// At most this many are emitted.
    pub max_emitted: u64,
    /// How they are emitted.
    pub emission: Emission,
    /// How many events light may have on its way to the eye, with the one there that makes it turn to the eye.
    pub max_events: Events,
    /// Who finds light that a medium scatters straight from a light: what is asked for is not stored.
    pub single_scattering: SingleScattering,
    /// Where they count in the picture, if they are drawn and kept by that.
    pub importons: Option<&'a [Importon]>,
    /// Whether more photons are traced, and hand their power to neighbours where they lie closest; and whether only to those of as many
    /// events.
    pub control: Option<Tagged>,
}

/// Emissions that one task traces.
pub(super) const CHUNK: u64 = 1024;
/// Power that enters deep media goes in portions: no more than this many times the usual,
const HEAVY: f64 = 2.0;
/// and hardly less than this many times it;
const LIGHT: f64 = 0.25;
/// but one photon becomes so many at most.
const MOST_SPLIT: f64 = 256.0;

/// How photons set out into deep media.
#[derive(Clone, Copy, Debug)]
pub(super) enum Entry {
    /// With whatever power they bring.
    Free,
    /// With whatever power they bring, which is noted.
    Noted,
    /// In portions of about this power.
    Portioned(f64),
}

/// The least power with which photons enter deep media in portions of this power; what is weaker is left to roulette.
pub(super) fn least_to_enter(portion: f64) -> f64 {
    LIGHT * portion
}

/// How photons are emitted and traced: what the [pilots](super::pilot) find out.
pub(super) struct Tracer<'s> {
    pub scene: &'s Scene,
    pub pass: &'s Pass<'s>,
    /// Where photons start.
    pub sources: Sources<'s>,
    /// What the volume map stores.
    pub quota: VolumeQuota<'s>,
    /// The power of photons in the map, where photons are aimed at solids from diffuse surfaces, too.
    pub typical: Option<f64>,
    /// How photons set out into deep media.
    pub entry: Entry,
    /// Whether first collisions are forced.
    pub forced: bool,
    /// What that may cost.
    pub budget: Budget,
    /// By medium, those in which photons wander many at once.
    dense: Vec<Option<Dense>>,
}

/// Photons set out to wander when there are so many.
const MANY: usize = 256;

/// A photon that wanders, or is to.
struct Parked {
    wanderer: Wanderer,
    /// What it is inside,
    inside: Inside,
    /// the medium,
    medium: u32,
    /// and how it came there.
    luggage: Luggage<Remembered>,
    /// The emission that it is of, and where that started.
    emission: usize,
    origin: Origin,
}

/// Room for what a chunk's photons leave to be done.
#[derive(Default)]
struct Room<'s> {
    /// Parts of the photon that is followed.
    parts: Parts<'s, Remembered>,
    /// Photons that are to wander.
    parked: Vec<Parked>,
    /// Which emissions have stored a photon.
    storing: Vec<bool>,
}

/// What some emissions have left.
#[derive(Default)]
pub(super) struct Chunk {
    pub emitted: u64,
    /// Photons for the volume map.
    pub volume: VolumeSink,
    /// Emissions that collided.
    pub collided: u64,
    /// Emissions that stored a photon.
    pub storing: u64,
    /// Collisions of all of them.
    pub collisions: u64,
    /// Sources and powers of photons that enter deep media, while these are noted.
    pub entering: Vec<(u32, f64)>,
    /// Of each photon for the map, where it started, while that is noted.
    pub origins: Vec<Origin>,
    pub tally: Tally,
    bill: Bill,
    /// Room for the places on a flight where a weight changed, and the weights until there.
    steps: Vec<(f64, Rgb)>,
}

/// Traces a range of emissions in parallel, a chunk at a time, in their order: `emit` adds one to its chunk, with room that it may
/// use; `end` is told when a chunk is done, with that room, and how many emissions it is of. Chunks that `stop` ends are left empty.
pub(crate) fn in_chunks<C: Default + Send, R: Default>(
    range: Range<u64>,
    stop: &(impl Fn() -> bool + Sync),
    emit: impl Fn(u64, &mut C, &mut R) + Sync,
    end: impl Fn(&mut C, &mut R, u64) + Sync,
) -> Vec<C> {
    let chunks = (range.end - range.start).div_ceil(CHUNK);
    let trace = |index: u64| {
        let (mut chunk, mut room) = (C::default(), R::default());
        let first = range.start + index * CHUNK;
        let photons = first..(first + CHUNK).min(range.end);
        let count = photons.end - photons.start;
        for photon in photons {
            // To ask may mean to look at a clock.
            if photon % 16 == 0 && stop() {
                return C::default();
            }
            emit(photon, &mut chunk, &mut room);
        }
        // A walk may have been broken off.
        if stop() {
            return C::default();
        }
        end(&mut chunk, &mut room, count);
        chunk
    };
    (0..chunks).into_par_iter().map(trace).collect()
}

impl<'s> Tracer<'s> {
    /// Before any pilot.
    pub fn new(scene: &'s Scene, pass: &'s Pass<'s>) -> Self {
        Tracer {
            scene,
            pass,
            sources: Sources::new(scene),
            quota: VolumeQuota::new(scene, pass.single_scattering),
            typical: None,
            entry: Entry::Free,
            forced: false,
            budget: Budget::of_pilots(),
            dense: scene.media.iter().map(Dense::of).collect(),
        }
    }

    /// Whether a solid holds a medium of uneven density.
    pub fn has_uneven_solids(&self) -> bool {
        let mut media = self.scene.solids.iter().filter_map(|solid| solid.medium);
        media.any(|medium| !self.scene.media[medium as usize].density.is_even())
    }

    /// Traces the emissions of a range, of those that there are in all.
    pub fn run(
        &self,
        purpose: Purpose,
        (range, emitted): (Range<u64>, u64),
        progress: &(impl Fn(u64, u64) + Sync),
        stop: &(impl Fn() -> bool + Sync),
    ) -> Vec<Chunk> {
        let stop = &|| stop() || self.budget.is_spent();
        let emit = |photon: u64, chunk: &mut Chunk, room: &mut Room<'s>| {
            let mut stream = self.pass.emission.stream(self.pass.seed, purpose, photon, self.pass.index);
            self.emit((photon % CHUNK) as usize, &mut stream, chunk, room, stop);
            self.wander(MANY, chunk, room, stop);
        };
        let end = |chunk: &mut Chunk, room: &mut Room<'s>, count| {
            self.wander(1, chunk, room, stop);
            chunk.storing = room.storing.iter().filter(|stores| **stores).count() as u64;
            chunk.emitted = count;
            chunk.bill.settle(&self.budget, chunk.volume.photons.len());
            chunk.volume.photons.shrink_to_fit();
            progress(count, emitted);
        };
        in_chunks(range, stop, emit, end)
    }

    /// Emits one photon, and follows it and all that is split off it, unless `stop` says so, or it is parked.
    fn emit(
        &self,
        emission: usize,
        stream: &mut Stream,
        chunk: &mut Chunk,
        room: &mut Room<'s>,
        stop: &(dyn Fn() -> bool + Sync),
    ) {
        let Some(Start { ray, power, inside, from_light, source, aim }) = self.sources.start(stream) else { return };
        if !power.is_finite() {
            chunk.tally.broken += 1;
            return;
        }
        let own = Remembered {
            history: History::new(from_light),
            forced: self.forced,
            ahead: Ahead::default(),
            portion: false,
        };
        let start =
            Part { walk: Walk::start(self.scene, ray, inside), luggage: Luggage::new(power, own), collision: None };
        chunk.collided += u64::from(self.follow(start, (emission, (source, aim)), stream, chunk, room, stop));
    }

    /// Follows a part of an emission, and all that is split off it. Returns whether any of that has collided.
    fn follow(
        &self,
        start: Part<'s, Remembered>,
        (emission, origin): (usize, Origin),
        stream: &mut Stream,
        chunk: &mut Chunk,
        Room { parts, parked, storing }: &mut Room<'s>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> bool {
        let stored = chunk.volume.stored;
        let mut flying = Flying { tracer: self, chunk, stream, stop, parked, emission, origin, collided: false };
        travel(&mut flying, start, parts);
        let collided = flying.collided;
        if self.quota.notes {
            chunk.origins.resize(chunk.volume.photons.len(), origin);
        }
        storing.resize(CHUNK as usize, false);
        storing[emission] |= chunk.volume.stored > stored;
        collided
    }

    /// Lets parked photons wander, and follows those that come back, as long as there are so many.
    fn wander(&self, many: usize, chunk: &mut Chunk, room: &mut Room<'s>, stop: &(dyn Fn() -> bool + Sync)) {
        while room.parked.len() >= many && !stop() {
            let mut parked = std::mem::take(&mut room.parked);
            let first = &parked[0];
            let (Some(dense), Some(extinction), Some(distances)) =
                (self.dense[first.medium as usize], self.quota.deep(first.medium), self.scene.distances(&first.inside))
            else {
                return;
            };
            // Those in the same solid.
            let (medium, inside) = (first.medium, first.inside.clone());
            let others = parked.extract_if(.., |parked| parked.medium != medium || parked.inside != inside);
            room.parked.extend(others);
            let wanderers = parked.iter().map(|parked| parked.wanderer.clone());
            let wanderers = (0..).zip(wanderers).map(|(number, wanderer)| Wanderer { number, ..wanderer }).collect();
            let region = self.scene.region(&inside);
            let (left, storing) = (Vec::new(), &mut room.storing);
            let mut host =
                Wandering { tracer: self, chunk, parked: &parked, region, dense, extinction, storing, left, stop };
            let (geometry, max_events) = (&self.scene.geometry, self.pass.max_events);
            Isa::best().run(Wander { dense, distances, geometry, max_events, wanderers, host: &mut host });
            for (wanderer, flight) in host.left {
                let Wanderer { point, direction, weight, events, number, mut stream, .. } = wanderer;
                let Parked { luggage, emission, origin, .. } = &parked[number as usize];
                let history = luggage.own.history.scattered();
                let own = Remembered { history, ahead: Ahead::of(flight), portion: true, ..luggage.own };
                let mut luggage = luggage.part(weight, own);
                luggage.events = events;
                let walk = Walk::new(self.scene, Ray::new(point, direction), inside.clone());
                let part = Part { walk, luggage, collision: None };
                self.follow(part, (*emission, *origin), &mut stream, chunk, room, stop);
            }
        }
    }
}

/// Photons of one solid that wander.
struct Wandering<'f, 's> {
    tracer: &'f Tracer<'s>,
    chunk: &'f mut Chunk,
    /// Those, by their numbers.
    parked: &'f [Parked],
    region: u32,
    dense: Dense,
    /// The extinction that tells how deep a length is.
    extinction: f64,
    storing: &'f mut [bool],
    /// Those that have left, and how far they fly.
    left: Vec<(Wanderer, f64)>,
    stop: &'f (dyn Fn() -> bool + Sync),
}

impl Host for Wandering<'_, '_> {
    fn collide(&mut self, wanderer: &mut Wanderer) {
        let Wanderer { point, direction, weight, least, events, ref mut stream, number } = *wanderer;
        let (quota, volume) = (&self.tracer.quota, &mut self.chunk.volume);
        let stored = volume.stored;
        self.chunk.collisions += 1;
        let parked = &self.parked[number as usize];
        let came = parked.luggage.own.history;
        let history = if events == parked.luggage.events { came } else { came.scattered() };
        let power = if quota.wants(history) { weight * self.dense.albedo() } else { Rgb::ZERO };
        let place = Place { point, direction, region: self.region, events };
        volume.deposit_deep(quota, &place, self.extinction, || least, power, stream);
        if volume.stored > stored {
            self.storing[parked.emission] = true;
            if quota.notes {
                self.chunk.origins.resize(volume.photons.len(), parked.origin);
            }
        }
        self.chunk.bill.add(&self.tracer.budget, self.chunk.volume.photons.len());
    }

    fn leave(&mut self, wanderer: Wanderer, flight: f64) {
        self.left.push((wanderer, flight));
    }

    fn breaks_off(&mut self) -> bool {
        (self.stop)()
    }
}

/// What a photon remembers.
#[derive(Clone, Copy, Debug)]
struct Remembered {
    history: History,
    /// Whether its first collision is forced.
    forced: bool,
    /// How far it flies, once that is drawn.
    ahead: Ahead,
    /// Whether it is a portion that sets out already.
    portion: bool,
}

/// A photon on its way.
struct Flying<'f, 's> {
    tracer: &'f Tracer<'s>,
    chunk: &'f mut Chunk,
    stream: &'f mut Stream,
    /// Whether to break off.
    stop: &'f (dyn Fn() -> bool + Sync),
    /// Photons that are to wander.
    parked: &'f mut Vec<Parked>,
    /// The number of the emission that it is of in its chunk,
    emission: usize,
    /// and where it started.
    origin: Origin,
    /// Whether any part of it has collided.
    collided: bool,
}

impl<'s> Traveller<'s> for Flying<'_, 's> {
    type Own = Remembered;

    fn scene(&self) -> &'s Scene {
        self.tracer.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    /// Photons that set out into a deep medium get about the power of others there: strong ones are split, each part
    /// wandering by itself, and weak ones left to roulette. One with the power of hundreds would be seen as a blotch, and
    /// many weak ones take the room of others in the map.
    fn sets_out(
        &mut self,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Remembered>,
        parts: &mut Parts<'s, Remembered>,
    ) -> bool {
        if std::mem::take(&mut luggage.own.portion) {
            return true;
        }
        let medium = self.tracer.scene.medium(&walk.inside);
        if medium.is_none_or(|medium| !self.tracer.quota.is_deep(medium)) {
            return true;
        }
        let power = luggage.weight.element_sum();
        let portion = match self.tracer.entry {
            Entry::Free => return true,
            Entry::Noted => {
                if power > 0.0 && power.is_finite() {
                    self.chunk.entering.push((self.origin.0, power));
                }
                return true;
            }
            Entry::Portioned(portion) => portion,
        };
        let least = least_to_enter(portion);
        if power < least {
            luggage.weight *= least / power;
            return self.stream.uniform() * least < power;
        }
        if power > HEAVY * portion {
            let count = (power / portion).round().min(MOST_SPLIT);
            luggage.weight /= count;
            for _ in 1..count as usize {
                let luggage = luggage.part(luggage.weight, Remembered { portion: true, ..luggage.own });
                parts.push(Part { walk: walk.clone(), luggage, collision: None });
            }
        }
        true
    }

    fn farthest(&mut self, medium: u32, _: &Ray, luggage: &mut Luggage<Remembered>) -> f64 {
        let medium = &self.tracer.scene.media[medium as usize];
        if luggage.own.forced { f64::INFINITY } else { luggage.own.ahead.draw(medium, luggage.weight, self.stream) }
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Remembered>,
        parts: &mut Parts<'s, Remembered>,
    ) -> ControlFlow<f64> {
        let medium = &self.tracer.scene.media[segment.medium as usize];
        let range = (segment.a, segment.b);

        // A forced collision: the part that collides is followed later.
        if luggage.own.forced {
            let force = |stream: &mut Stream| transport::force(medium, segment.ray, range, luggage.weight, stream);
            let forced = self.stream.draw(Dimension::Flight, force);
            if self.tracer.quota.is_uneven(segment.medium) {
                let depth = |t| medium.density.depth(segment.ray, segment.a, t);
                let arriving = luggage.weight;
                self.deposit_along((segment, segment.b), luggage, |t| arriving * medium.transmittance(depth(t)));
            }
            luggage.weight *= forced.passed;
            if let Some((t, weight)) = forced.collision {
                let luggage = luggage.part(weight, Remembered { forced: false, ..luggage.own });
                let walk = Walk::within(self.tracer.scene, segment);
                parts.push(Part { walk, luggage, collision: Some((t, segment.medium)) });
            }
            return ControlFlow::Continue(());
        }

        // A collision by chance.
        if self.tracer.quota.is_uneven(segment.medium) {
            return self.fly(segment, luggage);
        }
        let weight = &mut luggage.weight;
        let collision =
            luggage.own.ahead.collide(medium, segment.ray, range, weight, self.stream, &mut self.chunk.tally);
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Remembered>,
        parts: &mut Parts<'s, Remembered>,
    ) -> Option<Heading> {
        let heading = match at {
            Vertex::Surface(at) | Vertex::Guided(at, _) => self.reflect(at, walk, luggage, parts),
            Vertex::Medium(at) => self.collide(at, luggage),
        };
        luggage.events += 1;
        self.chunk.bill.add(&self.tracer.budget, self.chunk.volume.photons.len());
        // One more collision and the eye's own scattering must still be allowed.
        heading.filter(|_| self.may_store(luggage.events))
    }

    /// Photons far from the surface of a dense solid wander many at once.
    fn is_taken_on(&mut self, walk: &Walk<'s>, (t, medium): (f64, u32), luggage: &Luggage<Remembered>) -> bool {
        let scene = self.tracer.scene;
        let Some(dense) = self.tracer.dense[medium as usize] else { return false };
        let Some(distances) = scene.distances(&walk.inside) else { return false };
        let point = walk.ray.at(t);
        let least = distances.least(&scene.geometry, point);
        let may =
            dense.is_far(least) && self.tracer.quota.is_deep(medium) && scene.medium(&walk.inside) == Some(medium);
        if !may {
            return false;
        }
        self.collided = true;
        let (direction, weight, events, stream) =
            (walk.ray.direction, luggage.weight, luggage.events, self.stream.part());
        let wanderer = Wanderer { point, direction, weight, least, number: 0, events, stream };
        let (inside, luggage) = (walk.inside.clone(), luggage.clone());
        let (emission, origin) = (self.emission, self.origin);
        self.parked.push(Parked { wanderer, inside, medium, luggage, emission, origin });
        true
    }

    fn breaks_off(&mut self) -> bool {
        (self.stop)()
    }

    fn stopped(&mut self) {
        self.chunk.tally.stopped += 1;
    }
}

impl<'s> Flying<'_, 's> {
    /// Whether a photon of so many events may still scatter towards the eye.
    fn may_store(&self, events: u64) -> bool {
        self.tracer.pass.max_events.allows(events)
    }

    /// Goes on from a surface.
    fn reflect(
        &mut self,
        at: &Interaction,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Remembered>,
        parts: &mut Parts<'s, Remembered>,
    ) -> Option<Heading> {
        let (arriving, vertex) = (luggage.weight, Vertex::Surface(at));
        let left_out = luggage.own.history.is_left_out(at);
        let onward = vertex.onward(Side::Light, None, &mut luggage.weight, self.stream, survive);
        let aimed = !left_out && self.aim(at, walk, (arriving, luggage), parts);
        let onward = onward?;
        let event = at.event(&onward);
        if left_out && event == Event::Scattered {
            return None;
        }
        if aimed && onward.density > 0.0 {
            // What is aimed at solids brings its part of the light to them, but for what mirrors in the surface send there.
            let rival = self.tracer.sources.density_towards_solids(at.point, onward.direction);
            luggage.weight *= balance(onward.density, rival);
        }
        luggage.own.history = luggage.own.history.after(event, &vertex);
        Some(Heading { direction: onward.direction })
    }

    /// Light that a diffuse surface sends to solids that photons are aimed at: few photons would come there by chance,
    /// each with the power of many. Photons of little power are left to roulette, and have a typical one then. Returns
    /// whether that light is taken care of.
    fn aim(
        &mut self,
        at: &Interaction,
        walk: &Walk<'s>,
        (arriving, luggage): (Rgb, &Luggage<Remembered>),
        parts: &mut Parts<'s, Remembered>,
    ) -> bool {
        let Some(typical) = self.tracer.typical.filter(|_| at.bsdf.nature() == Nature::Diffuse) else { return false };
        let sources = &self.tracer.sources;
        let Some(direction) = sources.towards_solids(at.point, self.stream) else { return false };
        let events = luggage.events + 1;
        if !self.may_store(events) {
            return true;
        }

        // Its part, of what goes there by chance and what is aimed.
        let rival = sources.density_towards_solids(at.point, direction);
        let mut weight = Rgb::ZERO;
        Vertex::Surface(at).toward(direction, Side::Light, false, arriving, self.stream, |arriving, sent| {
            weight += arriving * sent.value / (sent.ahead + rival);
        });
        let chance = weight.element_sum() / typical;
        if chance < 1.0 {
            if self.stream.uniform() >= chance {
                return true;
            }
            weight /= chance;
        }
        let history = luggage.own.history.after(Event::Scattered, &Vertex::Surface(at));
        let mut part = luggage.part(weight, Remembered { history, ..luggage.own });
        part.events = events;
        let mut walk = walk.clone();
        walk.leave(at, direction);
        parts.push(Part { walk, luggage: part, collision: None });
        true
    }

    /// Flies through a medium of uneven density, and leaves photons on the way.
    fn fly(&mut self, segment: &Segment<'_>, luggage: &mut Luggage<Remembered>) -> ControlFlow<f64> {
        let medium = &self.tracer.scene.media[segment.medium as usize];
        let grey = medium.extinction == Rgb::splat(medium.extinction.x);
        // Where it might have collided its weight has changed.
        let mut steps = std::mem::take(&mut self.chunk.steps);
        steps.clear();
        let (range, weight, tally) = ((segment.a, segment.b), &mut luggage.weight, &mut self.chunk.tally);
        let collision = self.stream.draw(Dimension::Flight, |stream| {
            transport::fly(medium, segment.ray, range, weight, stream, tally, |t, weight, _| {
                if !grey {
                    steps.push((t, weight));
                }
            })
        });
        let last = luggage.weight;
        let weight = |t| steps.get(steps.partition_point(|(end, _)| *end < t)).map_or(last, |(_, weight)| *weight);
        self.deposit_along((segment, collision.unwrap_or(segment.b)), luggage, weight);
        self.chunk.steps = steps;
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    /// Leaves photons along a flight, to which light comes with this weight.
    fn deposit_along(
        &mut self,
        flight: (&Segment<'_>, f64),
        luggage: &Luggage<Remembered>,
        weight: impl Fn(f64) -> Rgb,
    ) {
        let history = (luggage.events, luggage.own.history);
        self.chunk.volume.deposit_along(&self.tracer.quota, flight, history, weight, self.stream);
    }

    /// Leaves a photon where it collides in a medium of even density, and scatters.
    fn collide(&mut self, at: &Collision<'_>, luggage: &mut Luggage<Remembered>) -> Option<Heading> {
        self.collided = true;
        self.chunk.collisions += 1;
        let history = (luggage.events, luggage.own.history);
        let power = luggage.weight * at.medium.albedo_at(at.point);
        if !self.tracer.quota.is_uneven(at.index) {
            self.chunk.volume.deposit(&self.tracer.quota, at, history, power, self.stream);
        }
        let onward = Vertex::Medium(at).onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        luggage.own.history = luggage.own.history.after(Event::Scattered, &Vertex::Medium(at));
        Some(Heading { direction: onward.direction })
    }
}
