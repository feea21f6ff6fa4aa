//! The photon pass: photons leave the lights, walk, and are stored at every collision in a medium that
//! scatters.

use std::ops::{ControlFlow, Range};

use rayon::prelude::*;

use super::Photon;
use super::emission::Sources;
use crate::math::random::Purpose;
use crate::math::{DVec3, Rgb, Stream};
use crate::medium::Medium;
use crate::scene::Scene;
use crate::scene::description::SingleScattering;
use crate::transport::{self, Crossing, Interaction, Reflection, Segment, Side, Stop, Tally, Visitor, Walk, survive};

/// What a photon pass should do.
#[derive(Clone, Copy, Debug)]
pub struct Pass {
    /// The user's seed.
    pub seed: u64,
    /// The number of the pass: each draws photons of its own.
    pub index: u64,
    /// About how many photons the map should hold.
    pub target: u64,
    /// At most this many are emitted.
    pub max_emitted: u64,
}

/// What a photon pass found.
#[derive(Debug, Default)]
pub struct Traced {
    /// The photons by region, powers divided by the number of emitted photons, times the albedo.
    pub regions: Vec<Vec<Photon>>,
    /// Photons emitted.
    pub emitted: u64,
    /// Whether first collisions were forced.
    pub forced: bool,
    /// Counts.
    pub tally: Tally,
}

impl Traced {
    /// Photons stored.
    pub fn stored(&self) -> u64 {
        self.regions.iter().map(|photons| photons.len() as u64).sum()
    }
}

/// Never fewer photons than this are emitted.
const FEWEST: u64 = 10_000;
/// Emissions of the pilot that tells the yield; more where they store fewer photons than `TELLING`.
const PILOTS: [u64; 3] = [1 << 12, 1 << 16, 1 << 20];
/// A pilot that stores so many photons tells enough.
const TELLING: usize = 64;
/// Emissions that one task traces.
const CHUNK: u64 = 1024;
/// Emissions are traced in so many parts at most,
const PARTS: u64 = 16;
/// and parts of no fewer, so that threads seldom wait for one another.
const LEAST_PART: u64 = 128 * CHUNK;
/// Where fewer emissions than this share collide, photons are aimed at what they may collide in.
const SELDOM: f64 = 0.2;
/// Where fewer emissions than this share collide, first collisions are forced.
const RARE: f64 = 0.01;
/// A map expected to hold more than this many times its target thins itself.
const CROWDED: f64 = 1.5;
/// Photons of one walk through a deep medium lie near one another, and many of them are hardly more than one. So more are
/// emitted, and about one is kept of each walk, as in solids of uneven density where walks leave more than this many each;
const MANY: f64 = 8.0;
/// but this takes no more than so many times the emissions,
const MOST_MORE: f64 = 8.0;
/// and no more than so many collisions for each photon kept: beyond, tracing would cost more than all the rest.
const MOST_COLLISIONS: f64 = 32.0;
/// An emission costs about as much as so many of them.
const EMISSION: f64 = 8.0;
/// Power that enters deep media goes in portions: no more than this many times the usual,
const HEAVY: f64 = 2.0;
/// and hardly less than this many times it;
const LIGHT: f64 = 0.25;
/// but one photon becomes so many at most.
const MOST_SPLIT: f64 = 256.0;
/// Near surfaces, the distance to them is asked for once in so many collisions: it saves more only where it is long.
const SELDOM_ASKED: u32 = 8;
/// Photons still on their way after so many events are dropped and counted.
const SAFETY_STOP: u64 = 1_000_000_000;

/// Traces photons. `advance` is told as emissions are done, of [`Pass`]'s number once it is known; `stop` ends
/// the pass early: what it traced until then stands for all the light, except that it may have traced nothing.
pub fn trace(
    scene: &Scene,
    pass: &Pass,
    progress: &(impl Fn(u64, u64) + Sync),
    stop: &(impl Fn() -> bool + Sync),
) -> Traced {
    let sources = Sources::new(scene);
    let mut tracer =
        Tracer { scene, sources, deep: deep(scene), typical: None, portion: None, forced: false, keep: 1.0 };
    let empty = || Traced { regions: vec![Vec::new(); scene.regions as usize], ..Traced::default() };
    if tracer.sources.is_empty() || !scene.media.iter().any(|medium| medium.scatters()) {
        return empty();
    }

    let uneven = |medium: u32| !scene.media[medium as usize].density.is_even();
    let deep = tracer.deep.iter().any(Option::is_some);
    let many = if deep {
        0.0
    } else if scene.solids.iter().filter_map(|solid| solid.medium).any(uneven) {
        MANY
    } else {
        f64::INFINITY
    };

    // How many to emit is settled beforehand: a count that depends on the photons themselves is biased.
    let pilot = |tracer: &Tracer, count: u64| {
        let chunks = tracer.run(pass, Purpose::Pilot, (0..count, count), &|_, _| {}, stop);
        let collided: u64 = chunks.iter().map(|chunk| chunk.collided).sum();
        let stored: usize = chunks.iter().map(|chunk| chunk.photons.len()).sum();
        (collided as f64 / count as f64, stored, surplus(&chunks, count, many))
    };
    let mut piloted = PILOTS[0];
    let (mut collided, mut stored, mut surplus) = pilot(&tracer, piloted);
    if collided < SELDOM {
        tracer.sources.aim();
        let chunks = tracer.run(pass, Purpose::Pilot, (0..piloted, piloted), &|_, _| {}, stop);
        let powers = || chunks.iter().flat_map(|chunk| chunk.photons.iter().map(|(_, photon)| photon.power));
        tracer.typical = typical(powers().map(|power| f64::from(power.element_sum())).collect());
        (collided, stored, surplus) = pilot(&tracer, piloted);
    }
    if deep {
        let entering = |tracer: &Tracer| -> Vec<(u32, f64)> {
            let chunks = tracer.run(pass, Purpose::Pilot, (0..piloted, piloted), &|_, _| {}, stop);
            chunks.into_iter().flat_map(|chunk| chunk.entering).collect()
        };
        tracer.sources.even_out(&entering(&tracer));
        tracer.portion = portion(entering(&tracer).into_iter().map(|(_, power)| power).collect());
        // What is weaker would not enter.
        tracer.typical = tracer.typical.and(tracer.portion.map(|portion| LIGHT * portion).or(tracer.typical));
        (collided, stored, surplus) = pilot(&tracer, piloted);
    }
    if collided < RARE {
        tracer.forced = true;
        // Small media far from the light.
        for count in PILOTS {
            piloted = count;
            (collided, stored, surplus) = pilot(&tracer, count);
            if stored >= TELLING || stop() {
                break;
            }
        }
    }
    let single = scene.volume.single_scattering;
    if single != SingleScattering::Photons {
        // What is left to shadow rays may be nearly all.
        for count in PILOTS {
            if stored >= TELLING || count <= piloted || stop() {
                continue;
            }
            piloted = count;
            (collided, stored, surplus) = pilot(&tracer, count);
        }
    }
    if collided == 0.0 || (stored == 0 && single != SingleScattering::Photons) || stop() {
        return Traced { emitted: piloted, forced: tracer.forced, ..empty() };
    }
    let share = stored as f64 / piloted as f64;
    let crowded = if surplus > 1.0 { 1.0 } else { CROWDED };
    let wanted = (pass.target as f64 / share * surplus).ceil().max(1.0) as u64;
    let emitted = wanted.max(FEWEST).min(pass.max_emitted);
    let expected = emitted as f64 * share;
    if expected > crowded * pass.target as f64 {
        tracer.keep = pass.target as f64 / expected;
    }

    let mut traced = Traced { forced: tracer.forced, ..empty() };
    // A part at a time: photons need not be held twice.
    let part = emitted.div_ceil(PARTS).next_multiple_of(CHUNK).max(LEAST_PART);
    for first in (0..emitted).step_by(part as usize) {
        let range = first..(first + part).min(emitted);
        for chunk in tracer.run(pass, Purpose::Photon, (range, emitted), progress, stop) {
            traced.emitted += chunk.emitted;
            traced.tally = traced.tally.merge(chunk.tally);
            for (region, photon) in chunk.photons {
                traced.regions[region as usize].push(photon);
            }
        }
    }
    let scale = (1.0 / traced.emitted.max(1) as f64) as f32;
    for photons in &mut traced.regions {
        photons.par_iter_mut().for_each(|photon| photon.power *= scale);
        photons.shrink_to_fit();
    }
    traced
}

/// The median of powers.
fn typical(mut powers: Vec<f64>) -> Option<f64> {
    let middle = powers.len() / 2;
    (!powers.is_empty()).then(|| *powers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// How many times more photons to emit than are needed to fill the map, if walks leave more than `many` each: see [`MANY`].
fn surplus(chunks: &[Chunk], emitted: u64, many: f64) -> f64 {
    let stored: usize = chunks.iter().map(|chunk| chunk.photons.len()).sum();
    let storing: u64 = chunks.iter().map(|chunk| chunk.storing).sum();
    let collisions: u64 = chunks.iter().map(|chunk| chunk.collisions).sum();
    let correlated = stored as f64 / storing.max(1) as f64;
    if correlated < many {
        return 1.0;
    }
    let affordable = MOST_COLLISIONS * stored as f64 / (collisions as f64 + EMISSION * emitted as f64);
    correlated.min(affordable).clamp(1.0, MOST_MORE)
}

/// The power up to which photons carry half of all.
fn portion(mut powers: Vec<f64>) -> Option<f64> {
    powers.sort_unstable_by(f64::total_cmp);
    let half = 0.5 * powers.iter().sum::<f64>();
    let mut sum = 0.0;
    powers.into_iter().find(|power| {
        sum += power;
        sum >= half
    })
}

/// The least extinction by medium, of those of one density that are many mean free paths thick.
fn deep(scene: &Scene) -> Vec<Option<f64>> {
    let extent = scene.bounds().diagonal();
    let least = |medium: &Medium| {
        let extinction = medium.extinction.min_element();
        (medium.density.is_even() && extinction * extent > THICK).then_some(extinction)
    };
    scene.media.iter().map(least).collect()
}

/// Scenes less thick than this many mean free paths need all their photons.
const THICK: f64 = 16.0;
/// Photons within this many mean free paths of where eye rays begin are all kept; deeper, as many as there is
/// transmittance.
const KEPT: f64 = 1.0;
/// No fewer than at this depth.
const DEEPEST: f64 = 8.0;

struct Tracer<'s> {
    scene: &'s Scene,
    sources: Sources<'s>,
    /// By medium, how deep a length is; `None` where all photons are kept.
    deep: Vec<Option<f64>>,
    /// The power of photons in the map, where photons are aimed at solids from diffuse surfaces, too.
    typical: Option<f64>,
    /// The power with which photons enter deep media, as a rule; unknown until it is piloted.
    portion: Option<f64>,
    forced: bool,
    /// The share of photons that are kept.
    keep: f64,
}

#[derive(Default)]
struct Chunk {
    emitted: u64,
    photons: Vec<(u32, Photon)>,
    collided: u64,
    /// Emissions that stored a photon.
    storing: u64,
    collisions: u64,
    /// Sources and powers of photons that enter deep media, while their usual power is unknown.
    entering: Vec<(u32, f64)>,
    tally: Tally,
}

impl Tracer<'_> {
    /// Traces the emissions of a range, of those that there are in all.
    fn run(
        &self,
        pass: &Pass,
        purpose: Purpose,
        (range, emitted): (Range<u64>, u64),
        progress: &(impl Fn(u64, u64) + Sync),
        stop: &(impl Fn() -> bool + Sync),
    ) -> Vec<Chunk> {
        let chunks = (range.end - range.start).div_ceil(CHUNK);
        (0..chunks)
            .into_par_iter()
            .map(|index| {
                let mut chunk = Chunk::default();
                let first = range.start + index * CHUNK;
                let part = first..(first + CHUNK).min(range.end);
                let count = part.end - part.start;
                for photon in part {
                    // To ask may mean to look at a clock.
                    if photon % 16 == 0 && stop() {
                        return Chunk::default();
                    }
                    let mut stream = Stream::new(pass.seed, purpose, photon, pass.index);
                    self.emit(&mut stream, &mut chunk);
                }
                chunk.emitted = count;
                chunk.photons.shrink_to_fit();
                progress(count, emitted);
                chunk
            })
            .collect()
    }

    fn emit(&self, stream: &mut Stream, chunk: &mut Chunk) {
        let Some(start) = self.sources.start(stream) else { return };
        if !start.power.is_finite() {
            chunk.tally.broken += 1;
            return;
        }
        let stored = chunk.photons.len();
        let mut flight = Flight {
            tracer: self,
            chunk,
            stream,
            source: start.source,
            split: Vec::new(),
            collided: false,
            unasked: 0,
        };
        let known = start.from_light && self.scene.volume.single_scattering != SingleScattering::Photons;
        flight.follow(Walk::start(self.scene, start.ray, start.inside), start.power, 0, self.forced, known);
        while let Some(Split { walk, weight, events, forced, known }) = flight.split.pop() {
            flight.follow(walk, weight, events, forced, known);
        }
        let collided = flight.collided;
        chunk.collided += u64::from(collided);
        chunk.storing += u64::from(chunk.photons.len() > stored);
    }
}

/// One photon, or the part of one.
struct Flight<'f, 's> {
    tracer: &'f Tracer<'s>,
    chunk: &'f mut Chunk,
    stream: &'f mut Stream,
    /// Where it comes from.
    source: u32,
    /// Parts yet to be followed.
    split: Vec<Split<'s>>,
    collided: bool,
    /// For so many collisions near surfaces the distance to these is not asked for.
    unasked: u32,
}

/// A part of a photon that was split.
struct Split<'s> {
    walk: Walk<'s>,
    weight: Rgb,
    events: u64,
    forced: bool,
    known: bool,
}

impl Tracer<'_> {
    /// Whether shadow rays go straight on through refracting boundaries.
    fn straight_on(&self) -> bool {
        self.scene.volume.single_scattering == SingleScattering::Approximate
    }
}

impl<'s> Flight<'_, 's> {
    /// `known`: shadow rays will find its light, if it collides next.
    fn follow(&mut self, mut walk: Walk<'s>, mut weight: Rgb, mut events: u64, forced: bool, mut known: bool) {
        let mut turns = 0;
        let mut entering = true;
        loop {
            if std::mem::take(&mut entering) && !self.enter(&walk, &mut weight, (events, forced, known)) {
                return;
            }
            let mut passage = Passage { flight: self, weight, events, forced, known, drawn: None, collision: None };
            let stop = walk.advance(&mut passage);
            weight = passage.weight;
            let collision = passage.collision;
            if weight.max_element() <= 0.0 {
                return;
            }
            // An interaction is large: it stays where it is.
            match &stop {
                Stop::Ended => {
                    let Some((t, medium)) = collision else { return };
                    if !self.collide(&mut walk, &mut weight, events, (t, medium), known) {
                        return;
                    }
                    known = false;
                    turns = 0;
                }
                Stop::Surface(at) => {
                    let arriving = weight;
                    let Some(direction) = at.scatter(Side::Light, &mut weight, self.stream) else {
                        self.aim(at, &walk, arriving, events, forced);
                        return;
                    };
                    if self.aim(at, &walk, arriving, events, forced)
                        && let Reflection::Lambert(lambert) = at.reflection
                    {
                        // What aims at solids brings its share of the light to them.
                        let own = lambert.density(at.shading_normal, direction);
                        let aimed = self.tracer.sources.density_towards_solids(at.point, direction);
                        weight *= own / (own + aimed);
                    }
                    let refracted =
                        matches!(at.reflection, Reflection::Dielectric(..)) && direction.dot(at.normal) < 0.0;
                    known &= refracted && self.tracer.straight_on();
                    walk.leave(at, direction);
                    entering = true;
                    let specular = matches!(at.reflection, Reflection::Dielectric(..) | Reflection::Mirror(_));
                    turns = if specular { turns + 1 } else { 0 };
                    if !transport::endures(turns, &mut weight, self.stream) {
                        return;
                    }
                }
                Stop::Escaped => return,
            }
            events += 1;
            if events >= SAFETY_STOP {
                self.chunk.tally.stopped += 1;
                return;
            }
            // One more collision and the eye's own scattering must still be allowed.
            if !self.may_store(events) {
                return;
            }
        }
    }

    /// Photons that set out into a deep medium get about the power of others there: strong ones are split, each part
    /// wandering by itself, and weak ones left to roulette. One with the power of hundreds would be seen as a blotch, and
    /// many weak ones take the room of others in the map. Returns whether this one goes on.
    fn enter(&mut self, walk: &Walk<'s>, weight: &mut Rgb, (events, forced, known): (u64, bool, bool)) -> bool {
        let medium = self.tracer.scene.medium(&walk.inside);
        if medium.is_none_or(|medium| self.tracer.deep[medium as usize].is_none()) {
            return true;
        }
        let power = weight.element_sum();
        let Some(portion) = self.tracer.portion else {
            if power > 0.0 && power.is_finite() {
                self.chunk.entering.push((self.source, power));
            }
            return true;
        };
        let least = LIGHT * portion;
        if power < least {
            *weight *= least / power;
            return self.stream.uniform() * least < power;
        }
        if power > HEAVY * portion {
            let parts = (power / portion).round().min(MOST_SPLIT);
            *weight /= parts;
            for _ in 1..parts as usize {
                self.split.push(Split { walk: walk.clone(), weight: *weight, events, forced, known });
            }
        }
        true
    }

    /// Light that a diffuse surface sends to solids that photons are aimed at: few photons would come there by chance,
    /// each with the power of many. Photons of little power are left to roulette, and have a typical one then. Returns
    /// whether that light is taken care of.
    fn aim(&mut self, at: &Interaction, walk: &Walk<'s>, weight: Rgb, events: u64, forced: bool) -> bool {
        let (Some(typical), Reflection::Lambert(lambert)) = (self.tracer.typical, at.reflection) else { return false };
        let sources = &self.tracer.sources;
        let Some(direction) = sources.towards_solids(at.point, self.stream) else { return false };
        let own = lambert.density(at.shading_normal, direction);
        if own <= 0.0 || direction.dot(at.normal) <= 0.0 || !self.may_store(events + 1) {
            return true;
        }
        let share = own / (own + sources.density_towards_solids(at.point, direction));
        let mut weight = weight * lambert.reflectance * (share * at.adjoint(Side::Light, at.shading_normal, direction));
        let chance = weight.element_sum() / typical;
        if chance < 1.0 {
            if self.stream.uniform() >= chance {
                return true;
            }
            weight /= chance;
        }
        let mut walk = walk.clone();
        walk.leave(at, direction);
        self.follow(walk, weight, events + 1, forced, false);
        true
    }

    /// Whether a photon of so many events may still scatter towards the eye.
    fn may_store(&self, events: u64) -> bool {
        let most = self.tracer.scene.render.max_depth as u64;
        most == 0 || events < most
    }

    /// Stores the photon, unless its light is `known` otherwise, and scatters it. Returns whether it goes on.
    fn collide(
        &mut self,
        walk: &mut Walk<'s>,
        weight: &mut Rgb,
        events: u64,
        (t, medium): (f64, u32),
        known: bool,
    ) -> bool {
        let scene = self.tracer.scene;
        let depth = self.tracer.deep[medium as usize];
        let medium = &scene.media[medium as usize];
        self.collided = true;
        self.chunk.collisions += 1;
        let power = *weight * medium.albedo;
        let mut clear = walk.clearance(t);
        let mut keep = self.tracer.keep;
        let mut stored = !known && power.max_element() > 0.0;
        match depth {
            None => stored = stored && (keep >= 1.0 || self.stream.uniform() < keep),
            Some(extinction) => {
                // To ask for the surface takes longer than all else: not for photons that would not be kept anyway,
                // and for the sake of the walk only where it may be far.
                let chance = self.stream.uniform();
                stored &= chance < keep;
                let near = clear * extinction < KEPT;
                if stored || near && self.unasked == 0 {
                    keep *= self.tracer.seen(walk.ray.at(t), extinction, &mut clear);
                    stored &= chance < keep;
                    self.unasked = if clear * extinction < KEPT { SELDOM_ASKED } else { 0 };
                } else if near {
                    self.unasked -= 1;
                }
            }
        }
        if stored {
            let photon = Photon {
                position: walk.ray.at(t).as_vec3(),
                direction: walk.ray.direction.as_vec3(),
                power: (power / keep).as_vec3(),
                events: events.min(255) as u8,
            };
            self.chunk.photons.push((scene.region(&walk.inside), photon));
        }
        if !survive(weight, medium.albedo, self.stream) {
            return false;
        }
        let (direction, _) = medium.phase.sample(walk.ray.direction, self.stream);
        walk.turn(t, direction);
        if depth.is_some() {
            walk.clear(clear);
        }
        true
    }
}

impl Tracer<'_> {
    /// The share of photons at `p` to keep: rays that gather light begin at surfaces and at the camera, and what is
    /// deeper than a mean free path below these is seen by its transmittance. Photons kept carry the power of the
    /// others. `clear` is how far the nearest surface is, at least, before and afterwards.
    fn seen(&self, p: DVec3, extinction: f64, clear: &mut f64) -> f64 {
        let deepest = DEEPEST / extinction;
        if *clear < deepest {
            // Twice as far, so that this need not be asked soon again.
            *clear = self.scene.geometry.clearance(p, 2.0 * deepest);
        }
        let camera = &self.scene.camera;
        let from_camera = p.distance(camera.position) - camera.aperture;
        let depth = extinction * clear.min(from_camera).clamp(0.0, deepest);
        (KEPT - depth).min(0.0).exp()
    }
}

/// What a photon does on its way to the next surface.
struct Passage<'p, 'f, 's> {
    flight: &'p mut Flight<'f, 's>,
    weight: Rgb,
    events: u64,
    forced: bool,
    known: bool,
    /// How far it flies, once that is drawn.
    drawn: Option<f64>,
    collision: Option<(f64, u32)>,
}

impl Visitor for Passage<'_, '_, '_> {
    /// Flights through dense media end long before the far side of a solid: they are drawn first.
    fn farthest(&mut self, medium: u32) -> f64 {
        let medium = &self.flight.tracer.scene.media[medium as usize];
        if self.forced || !medium.density.is_even() {
            return f64::INFINITY;
        }
        *self.drawn.insert(transport::draw(medium, self.weight, self.flight.stream))
    }

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()> {
        let scene = self.flight.tracer.scene;
        let medium = &scene.media[segment.medium as usize];
        let range = (segment.a, segment.b);
        if self.forced {
            let forced = transport::force(medium, segment.ray, range, self.weight, self.flight.stream);
            self.weight *= forced.passed;
            if let Some((t, mut weight)) = forced.collision {
                let mut walk = Walk::new(scene, *segment.ray, segment.inside.clone());
                if self.flight.collide(&mut walk, &mut weight, self.events, (t, segment.medium), self.known)
                    && self.flight.may_store(self.events + 1)
                {
                    self.flight.follow(walk, weight, self.events + 1, false, false);
                }
            }
            return ControlFlow::Continue(());
        }
        let Flight { stream, chunk, .. } = &mut *self.flight;
        let collision = match self.drawn.take() {
            Some(target) => transport::end(medium, segment.ray, range, target, &mut self.weight),
            None => transport::fly(medium, segment.ray, range, &mut self.weight, stream, &mut chunk.tally, |_, _| {}),
        };
        match collision {
            Some(t) => {
                self.collision = Some((t, segment.medium));
                ControlFlow::Break(())
            }
            None => ControlFlow::Continue(()),
        }
    }

    fn crossing(&mut self, _: &Crossing<'_>) {}
}
