//! Light without an end: scenes that have no steady state are refused before anything is rendered.

use std::ops::ControlFlow;

use super::pilot::Pilot;
use crate::math::random::Purpose;
use crate::math::{Ray, Rgb, Stream};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::photon::Sources;
use crate::scene::Scene;
use crate::scene::description::Method;
use crate::surface::Side;
use crate::transport::{
    Events, Heading, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex, Walk, fly, survive, travel,
};
use crate::{Error, Result};

/// Walks from the camera, and as many from what shines.
const WALKS: u64 = 32;
/// As many where an atmosphere absorbs nothing: of light that enters it, about one walk in 100 is long, and all have no mean length.
const WALKS_IN_AIR: u64 = 1000;
/// A walk of so many events is long.
const LONG: u64 = 10_000;
/// Walks from where a long one was given up that tell whether there is a way out,
const ATTEMPTS: u64 = 8;
/// and take so many events.
const VERY_LONG: u64 = 100_000;
/// They meet no more than about so many particles on their way across the scene: where there is a way out, it is there however thin
/// a medium is.
const THIN: f64 = 4.0;
/// A share that is lost to rounding in a long walk.
const ROUNDING: f64 = 1e-9;

/// Why nobody need look whether light comes to an end; `None` where someone must.
pub(super) fn why_no_pilot(method: Method, max_events: Events) -> Option<&'static str> {
    match method {
        Method::Whitted => Some("Whitted's rays end at the first surface that spreads light"),
        Method::Photon | Method::Path | Method::Light => {
            max_events.is_limited().then_some("render.max_depth limits events")
        }
    }
}

/// How a walk of a pilot went.
pub(super) enum Wandered {
    Ended { collided: bool },
    TooLong(GivenUp),
}

/// Where a walk was given up.
#[derive(Clone, Copy)]
pub(super) struct GivenUp {
    /// The way it would have gone on.
    ray: Ray,
    /// Whether nothing was absorbed on its way, in one channel at least.
    lossless: bool,
}

/// A path that walks by chance, and is only counted.
struct Wanderer<'s, 't> {
    scene: &'s Scene,
    /// The scene's media, or others as thin as it takes.
    media: &'t [Medium],
    stream: &'t mut Stream,
    /// It gives up after so many events.
    most: u64,
    collided: bool,
    /// What is left of light that walks as it did.
    left: Rgb,
    given_up: Option<GivenUp>,
}

impl<'s> Traveller<'s> for Wanderer<'s, '_> {
    type Own = ();

    fn scene(&self) -> &'s Scene {
        self.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    fn segment(&mut self, segment: &Segment<'_>, luggage: &mut Luggage<()>, _: &mut Parts<'s, ()>) -> ControlFlow<f64> {
        let medium = &self.media[segment.medium as usize];
        let (range, mut tally) = ((segment.a, segment.b), Tally::default());
        let collision = fly(medium, segment.ray, range, &mut luggage.weight, self.stream, &mut tally, |_, _, _| {});
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        _: &Walk<'s>,
        luggage: &mut Luggage<()>,
        _: &mut Parts<'s, ()>,
    ) -> Option<Heading> {
        self.collided |= matches!(at, Vertex::Medium(_));
        let left = &mut self.left;
        let survives = |weight: &mut Rgb, factor, stream: &mut Stream| {
            *left *= factor;
            survive(weight, factor, stream)
        };
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survives)?;
        luggage.events += 1;
        if luggage.events >= self.most {
            let ray = match at {
                Vertex::Surface(at) | Vertex::Guided(at, _) => at.departure(onward.direction).0,
                Vertex::Medium(at) => Ray::new(at.point, onward.direction),
            };
            self.given_up = Some(GivenUp { ray, lossless: self.left.max_element() >= 1.0 - ROUNDING });
        }
        self.given_up.is_none().then_some(Heading { direction: onward.direction })
    }

    fn stopped(&mut self) {}
}

/// Walks by chance, through these media in place of the scene's own, for `most` events.
pub(super) fn wander(scene: &Scene, media: &[Medium], ray: Ray, most: u64, stream: &mut Stream) -> Wandered {
    let walk = Walk::start(scene, ray, scene.inside(ray.origin));
    let mut wanderer = Wanderer { scene, media, stream, most, collided: false, left: Rgb::ONE, given_up: None };
    let start = Part { walk, luggage: Luggage::new(Rgb::ONE, ()), collision: None };
    travel(&mut wanderer, start, &mut Parts::new());
    match wanderer {
        Wanderer { given_up: Some(given_up), .. } => Wandered::TooLong(given_up),
        Wanderer { collided, .. } => Wandered::Ended { collided },
    }
}

impl Pilot<'_> {
    /// Refuses scenes where light or an eye path may come to a place from which there is no way out, where nothing absorbs: there is no
    /// steady state. And those where the world's medium absorbs nothing and is dense without an end: what leaves the scene wanders
    /// there for ever, or for a time without a mean.
    pub fn refuse_eternity(&self) -> Result<()> {
        let scene = self.scene;
        let white = |medium: &&Medium| medium.scatters() && medium.albedo.range().0.max_element() >= 1.0;
        let world = scene.world.map(|world| &scene.media[world as usize]).filter(white);
        let air = world.filter(|medium| matches!(medium.density, Density::Exponential(_)));
        let walks = if air.is_some() { WALKS_IN_AIR } else { WALKS };
        let sources = Sources::new(scene);
        let given_up: Vec<GivenUp> = (0..2 * walks)
            .filter_map(|index| {
                let mut stream = Stream::new(self.seed, Purpose::Pilot, index, u64::MAX);
                let ray = match index % 2 {
                    0 => self.ray(&mut stream),
                    _ => sources.start(&mut stream)?.ray,
                };
                match wander(scene, &scene.media, ray, LONG, &mut stream) {
                    Wandered::TooLong(given_up) if given_up.lossless => Some(given_up),
                    _ => None,
                }
            })
            .collect();

        // The world.
        let bounds = scene.bounds();
        let outside = given_up.iter().any(|given_up| !bounds.contains(given_up.ray.origin));
        let is_endless = |medium: &&Medium| outside && (medium.density.is_endless() || air.is_some());
        if let Some(medium) = world.filter(is_endless) {
            let why = if air.is_some() { " (its density has no end below its origin)" } else { "" };
            return Err(Error::Scene(format!(
                "medium {} fills the world without an end and absorbs nothing, so that light which leaves the scene wanders in it for ever{why}: put it into a shape, give it a sigma_a, let it thin out, or limit render.max_depth",
                medium.name
            )));
        }

        // Closed places.
        let thin = |medium: &Medium| {
            let depth = medium.max_extinction() * bounds.diagonal();
            Medium { extinction: medium.extinction * (THIN / depth).min(1.0), ..medium.clone() }
        };
        let media: Vec<Medium> = if given_up.is_empty() { Vec::new() } else { scene.media.iter().map(thin).collect() };
        let has_no_way_out = |(index, from): (u64, &GivenUp)| {
            (0..ATTEMPTS).all(|attempt| {
                let mut stream = Stream::new(self.seed, Purpose::Pilot, index * ATTEMPTS + attempt, u64::MAX - 2);
                let wandered = wander(scene, &media, from.ray, VERY_LONG, &mut stream);
                matches!(wandered, Wandered::TooLong(given_up) if given_up.lossless)
            })
        };
        if (0..).zip(&given_up).any(has_no_way_out) {
            return Err(Error::Scene(
                "light in this scene neither escapes nor is absorbed, so it has no steady state: open the scene, lower a reflectance or an albedo below 1, or limit render.max_depth"
                    .to_string(),
            ));
        }
        Ok(())
    }
}
