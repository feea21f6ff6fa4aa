//! Walks by chance from the camera and from what shines: what they come to, and where the light's power goes.

use std::collections::HashSet;
use std::ops::ControlFlow;

use crate::math::random::Purpose;
use crate::math::{DVec3, Ray, Rgb, Stream};
use crate::photon::Sources;
use crate::render::Camera;
use crate::scene::{Inside, Scene, Settings};
use crate::surface::Side;
use crate::transport::{
    Crossing, Heading, Luggage, Part, Parts, Segment, Stop, Tally, Traveller, Vertex, Visitor, Walk, fly, survive,
    travel,
};

/// A walk is given up after so many events: what it carries then is left.
const MOST_EVENTS: u64 = 100_000;
/// Of walks from the camera so many places are kept, from which others are looked for.
const PLACES: usize = 512;

/// A side of a surface, or a medium, that light or an eye path came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Met {
    /// A shape, from outside or from inside.
    Shape(u32, bool),
    /// A collision in a medium, and the cell of the scene that it was in.
    Medium(u32, [i16; 3]),
}

/// What walks came to.
#[derive(Debug, Default)]
pub struct Seen {
    /// What they met.
    pub met: HashSet<Met>,
    /// Shapes that they met.
    pub shapes: HashSet<u32>,
    /// Media that they passed,
    pub media: HashSet<u32>,
    /// and solids that they were inside of meanwhile.
    pub solids: HashSet<u32>,
    /// Lights that they met by chance.
    pub lights: HashSet<u32>,
    /// Whether any left the scene.
    pub escaped: bool,
    /// Some of the places to which they came.
    pub places: Vec<(DVec3, Inside)>,
    /// Walks.
    pub walks: u64,
}

/// The power of light, all channels together, by what became of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Powers {
    /// What was emitted.
    pub emitted: f64,
    /// What surfaces and media absorbed.
    pub absorbed: f64,
    /// What left the scene.
    pub escaped: f64,
    /// What was still on its way when its walk was given up.
    pub left: f64,
    /// The sum of the absolute values of all that was added: roundings are shares of that.
    pub moved: f64,
}

/// A sum over walks, with that of its squares.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sum {
    sum: f64,
    squares: f64,
    now: f64,
}

impl Sum {
    fn end_walk(&mut self) {
        self.sum += self.now;
        self.squares += self.now * self.now;
        self.now = 0.0;
    }

    /// The mean over walks, and its standard error.
    pub fn mean(&self, walks: u64) -> (f64, f64) {
        let n = walks.max(2) as f64;
        let mean = self.sum / n;
        (mean, ((self.squares / n - mean * mean).max(0.0) / (n - 1.0)).sqrt())
    }
}

/// Where the power of light goes.
#[derive(Debug, Default)]
pub struct Ledger {
    /// All of it.
    pub powers: Powers,
    /// What each shape takes: less than nothing where it gives more than it gets.
    pub shapes: Vec<Sum>,
    /// What each shape gets.
    pub arriving: Vec<Sum>,
    /// What each medium scatters.
    pub scattered: Vec<Sum>,
    /// What sources emit.
    pub emitted: Sum,
    /// Walks.
    pub walks: u64,
}

impl Ledger {
    /// Of nothing yet.
    pub fn new(scene: &Scene) -> Self {
        let shapes = vec![Sum::default(); scene.surfaces.len()];
        let scattered = vec![Sum::default(); scene.media.len()];
        let (powers, emitted) = (Powers::default(), Sum::default());
        Ledger { powers, arriving: shapes.clone(), shapes, scattered, emitted, walks: 0 }
    }

    fn end_walk(&mut self) {
        self.walks += 1;
        self.emitted.end_walk();
        for sums in [&mut self.shapes, &mut self.arriving, &mut self.scattered] {
            sums.iter_mut().for_each(Sum::end_walk);
        }
    }
}

/// Walks in a scene.
pub struct Prober<'s> {
    scene: &'s Scene,
    seed: u64,
    /// The scene's lower corner, and what coordinates are multiplied by to count its cells.
    cells: (DVec3, DVec3),
}

impl<'s> Prober<'s> {
    /// In this scene.
    pub fn new(scene: &'s Scene, seed: u64) -> Self {
        const CELLS: f64 = 6.0;
        let bounds = scene.near_bounds();
        let scale = bounds.size().map(|size| if size > 0.0 { CELLS / size } else { 0.0 });
        Prober { scene, seed, cells: (bounds.min, scale) }
    }

    /// Walks from the camera through all of its film, until `stop`.
    pub fn eyes(&self, settings: &Settings, walks: u64, stop: &dyn Fn() -> bool) -> Seen {
        let camera = Camera::new(&self.scene.camera, &settings.film);
        let window = camera.window();
        let mut seen = Seen::default();
        for index in 0..walks {
            if stop() {
                break;
            }
            let mut stream = Stream::new(self.seed, Purpose::Pilot, index, u64::MAX - 8);
            // Spread evenly over the pixels, by the golden ratio.
            let pixel = ((index as f64 * 0.618_033_988_749_895).fract()
                * f64::from(window.width)
                * f64::from(window.height)) as u32;
            let (x, y) = (window.x + pixel % window.width, window.y + pixel / window.width);
            let ray = camera.ray(x, y, &mut stream);
            let start = Walk::start(self.scene, ray, self.scene.inside(ray.origin));
            self.walk(Side::Eye, start, Rgb::ONE, &mut stream, &mut seen, None);
        }
        seen
    }

    /// Walks from these sources, until `stop`; what becomes of their power is added to `ledger`.
    pub fn lights(
        &self,
        (sources, stream): (&Sources<'s>, u64),
        walks: u64,
        mut ledger: Option<&mut Ledger>,
        stop: &dyn Fn() -> bool,
    ) -> Seen {
        let mut seen = Seen::default();
        for index in 0..walks {
            if stop() {
                break;
            }
            let mut random = Stream::of_path(self.seed, Purpose::Pilot, index, u64::MAX - 16 - stream);
            if let Some(start) = sources.start(&mut random) {
                let walk = Walk::start(self.scene, start.ray, start.inside);
                self.walk(Side::Light, walk, start.power, &mut random, &mut seen, ledger.as_deref_mut());
            }
            if let Some(ledger) = &mut ledger {
                ledger.end_walk();
            }
        }
        seen
    }

    fn walk(
        &self,
        side: Side,
        walk: Walk<'s>,
        weight: Rgb,
        stream: &mut Stream,
        seen: &mut Seen,
        ledger: Option<&mut Ledger>,
    ) {
        seen.walks += 1;
        let mut probe = Probe { prober: self, side, stream, seen, ledger, last: weight };
        if let Some(ledger) = &mut probe.ledger {
            ledger.powers.emitted += weight.element_sum();
            ledger.emitted.now += weight.element_sum();
        }
        travel(&mut probe, Part { walk, luggage: Luggage::new(weight, ()), collision: None }, &mut Parts::new());
        // What roulette ended on its way to the next event.
        let lost = probe.last;
        probe.absorb(lost, Rgb::ZERO, None);
    }

    fn cell(&self, p: DVec3) -> [i16; 3] {
        let (corner, scale) = self.cells;
        ((p - corner) * scale).to_array().map(|x| x.clamp(-1e3, 1e3).floor() as i16)
    }

    /// Whether what is at `to` is met straight from one of the places that eyes came to: `met` is told of all that is met on a way, until
    /// it says yes or something opaque is in the way.
    pub fn finds(
        &self,
        seen: &Seen,
        mut to: impl FnMut(&mut Stream) -> DVec3,
        met: impl Fn(&Way<'_>) -> bool,
        tries: usize,
    ) -> bool {
        let mut stream = Stream::new(self.seed, Purpose::Pilot, 0, u64::MAX - 9);
        let camera = (self.scene.camera.position, self.scene.inside(self.scene.camera.position));
        (0..tries).any(|attempt| {
            let place = attempt.checked_sub(1).map(|_| (stream.uniform() * seen.places.len() as f64) as usize);
            let (from, inside) = place.and_then(|place| seen.places.get(place)).unwrap_or(&camera);
            let Some(direction) = (to(&mut stream) - *from).try_normalize() else { return false };
            let mut walk = Walk::new(self.scene, Ray::new(*from, direction), inside.clone());
            look(&mut walk, &met)
        })
    }
}

/// What is met on a straight way.
pub struct Way<'w> {
    /// The shapes that coincide where something is met.
    pub shapes: &'w [u32],
    /// The solids around a piece of a medium.
    pub solids: &'w [u32],
    /// The medium of that piece.
    pub medium: Option<u32>,
}

/// Looks along a walk's line, through all but what is opaque, for what `met` says yes to.
fn look(walk: &mut Walk<'_>, met: &impl Fn(&Way<'_>) -> bool) -> bool {
    let mut looking = Looking { met, found: false };
    loop {
        let stop = walk.advance(&mut looking);
        if looking.found {
            return true;
        }
        let Stop::Surface(at) = stop else { return false };
        let shapes: Vec<u32> = walk.hits().iter().map(|hit| hit.id).collect();
        if met(&Way { shapes: &shapes, solids: &[], medium: None }) {
            return true;
        }
        if at.bsdf.boundary(&at.incidence).is_none() && !at.bsdf.is_sheet() {
            return false;
        }
        let direction = walk.ray.direction;
        walk.leave(&at, direction);
    }
}

struct Looking<'m, F> {
    met: &'m F,
    found: bool,
}

impl<F: Fn(&Way<'_>) -> bool> Visitor for Looking<'_, F> {
    type End = ();

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()> {
        self.found |= (self.met)(&Way { shapes: &[], solids: segment.inside.solids(), medium: Some(segment.medium) });
        if self.found { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn crossing(&mut self, crossing: &Crossing<'_>) {
        self.found |= (self.met)(&Way { shapes: &[crossing.hit.id], solids: &[], medium: None });
    }

    fn mixture(&mut self, _: f64, _: bool) -> Option<f64> {
        None
    }
}

/// A walk that notes what it meets.
struct Probe<'p, 's> {
    prober: &'p Prober<'s>,
    side: Side,
    stream: &'p mut Stream,
    seen: &'p mut Seen,
    ledger: Option<&'p mut Ledger>,
    /// What it carried when it was last heard of.
    last: Rgb,
}

impl Probe<'_, '_> {
    /// Notes what is gone of a weight, to whom.
    fn absorb(&mut self, before: Rgb, after: Rgb, shape: Option<u32>) {
        self.last = after;
        let Some(ledger) = &mut self.ledger else { return };
        let (gone, arriving) = ((before - after).element_sum(), before.element_sum());
        ledger.powers.absorbed += gone;
        ledger.powers.moved += arriving.abs();
        if let Some(shape) = shape {
            ledger.shapes[shape as usize].now += gone;
            ledger.arriving[shape as usize].now += arriving;
        }
    }
}

impl<'s> Traveller<'s> for Probe<'_, 's> {
    type Own = ();

    fn scene(&self) -> &'s Scene {
        self.prober.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    fn segment(&mut self, segment: &Segment<'_>, luggage: &mut Luggage<()>, _: &mut Parts<'s, ()>) -> ControlFlow<f64> {
        // Roulette may have changed the weight since.
        self.absorb(self.last, luggage.weight, None);
        let scene = self.prober.scene;
        let medium = &scene.media[segment.medium as usize];
        self.seen.media.insert(segment.medium);
        self.seen.solids.extend(segment.inside.solids());
        let (range, before, mut tally) = ((segment.a, segment.b), luggage.weight, Tally::default());
        let collision = fly(medium, segment.ray, range, &mut luggage.weight, self.stream, &mut tally, |_, _, _| {});
        self.absorb(before, luggage.weight, None);
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn crossing(&mut self, crossing: &Crossing<'_>, _: &mut Luggage<()>) {
        self.seen.lights.insert(crossing.light);
        self.seen.shapes.insert(crossing.hit.id);
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &mut Luggage<()>,
        _: &mut Parts<'s, ()>,
    ) -> Option<Heading> {
        self.absorb(self.last, luggage.weight, None);
        let before = luggage.weight;
        let (mut shape, around) = (None, walk.inside.clone());
        match at {
            Vertex::Surface(interaction) | Vertex::Guided(interaction, _) => {
                for hit in walk.hits() {
                    let outside = hit.normal.dot(interaction.incidence.direction) < 0.0;
                    self.seen.met.insert(Met::Shape(hit.id, outside));
                    self.seen.shapes.insert(hit.id);
                    shape.get_or_insert(hit.id);
                }
            }
            Vertex::Medium(collision) => {
                self.seen.met.insert(Met::Medium(collision.index, self.prober.cell(collision.point)));
                if let Some(ledger) = &mut self.ledger {
                    let scattered = (before * collision.medium.albedo_at(collision.point)).element_sum();
                    ledger.scattered[collision.index as usize].now += scattered;
                }
            }
        }
        if self.side == Side::Eye && self.seen.places.len() < PLACES {
            let (point, inside) = match at {
                Vertex::Surface(at) | Vertex::Guided(at, _) => {
                    let (ray, inside) = at.departure(at.incidence.normal);
                    (ray.origin, inside)
                }
                Vertex::Medium(at) => (at.point, around),
            };
            self.seen.places.push((point, inside));
        }
        let onward = at.onward(self.side, None, &mut luggage.weight, self.stream, survive);
        let Some(onward) = onward else {
            self.absorb(before, Rgb::ZERO, shape);
            return None;
        };
        self.absorb(before, luggage.weight, shape);
        luggage.events += 1;
        if luggage.events >= MOST_EVENTS {
            if let Some(ledger) = &mut self.ledger {
                ledger.powers.left += luggage.weight.element_sum();
            }
            self.last = Rgb::ZERO;
            return None;
        }
        Some(Heading { direction: onward.direction })
    }

    fn escapes(&mut self, _: DVec3, luggage: &Luggage<()>) {
        self.absorb(self.last, luggage.weight, None);
        self.seen.escaped = true;
        if let Some(ledger) = &mut self.ledger {
            ledger.powers.escaped += luggage.weight.element_sum();
        }
        self.last = Rgb::ZERO;
    }

    fn stopped(&mut self) {}
}
