//! Pilots: a few camera paths that tell what a scene is like, before it is rendered.

use std::convert::Infallible;
use std::ops::ControlFlow;

use super::camera::Camera;
use crate::math::random::Purpose;
use crate::math::{Bounds, DVec3, Ray, Rgb, Stream};
use crate::scene::Scene;
use crate::surface::{Nature, Side};
use crate::transport::{
    Heading, Luggage, Part, Parts, Segment, Stop, Tally, Traveller, Vertex, Visitor, Walk, fly, pass_by_chance,
    survive, travel,
};
use crate::{Error, Result};

/// Camera paths that tell how often paths collide.
const PILOT: u64 = 2000;
/// Where fewer paths than this share collide, they split.
const RARE: f64 = 0.01;

/// Of a path that looks for what the camera sees.
const MOST_EVENTS: u32 = 16;

/// A few paths that tell what a scene is like.
pub(super) struct Pilot<'s> {
    pub scene: &'s Scene,
    pub camera: &'s Camera,
    /// What all random numbers derive from.
    pub seed: u64,
}

/// How a walk of the pilot went.
enum Wandered {
    Ended {
        collided: bool,
    },
    /// It was given up here.
    TooLong(DVec3),
}

/// A path that walks by chance, and is only counted.
struct Wanderer<'s, 't> {
    scene: &'s Scene,
    stream: &'t mut Stream,
    /// It gives up after so many events.
    most: u64,
    collided: bool,
    /// Where it gave up.
    given_up: Option<DVec3>,
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
        let medium = &self.scene.media[segment.medium as usize];
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
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        luggage.events += 1;
        if luggage.events >= self.most {
            self.given_up = Some(at.point());
        }
        self.given_up.is_none().then_some(Heading { direction: onward.direction, clearance: None })
    }

    fn stopped(&mut self) {}
}

fn wander(scene: &Scene, ray: Ray, most: u64, stream: &mut Stream) -> Wandered {
    let walk = Walk::start(scene, ray, scene.inside(ray.origin));
    let mut wanderer = Wanderer { scene, stream, most, collided: false, given_up: None };
    let start = Part { walk, luggage: Luggage::new(Rgb::ONE, ()), collision: None };
    travel(&mut wanderer, start, &mut Parts::new());
    match wanderer {
        Wanderer { given_up: Some(point), .. } => Wandered::TooLong(point),
        Wanderer { collided, .. } => Wandered::Ended { collided },
    }
}

impl Pilot<'_> {
    /// A walk from a place of the film.
    fn walk(&self, most: u64, stream: &mut Stream) -> Wandered {
        wander(self.scene, self.ray(stream), most, stream)
    }

    /// A box around nearly all surfaces that camera paths meet first where light can be asked for; `None` if they meet none.
    pub fn seen(&self) -> Option<Bounds> {
        const OUTLIERS: usize = 100;
        let find = |index| self.first_surface(&mut Stream::new(self.seed, Purpose::Pilot, index, u64::MAX - 1));
        let points: Vec<DVec3> = (0..PILOT).filter_map(find).collect();
        let last = points.len().checked_sub(1)?;
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let mut sorted: Vec<f64> = points.iter().map(|point| point[axis]).collect();
            sorted.sort_by(f64::total_cmp);
            [sorted[last / OUTLIERS], sorted[last - last / OUTLIERS]]
        });
        let bounds = Bounds { min: DVec3::new(x[0], y[0], z[0]), max: DVec3::new(x[1], y[1], z[1]) };
        Some(bounds.grown(0.05 * bounds.diagonal()))
    }

    /// The first surface on which light can be asked for, seen from a place of the film straight or by specular events.
    fn first_surface(&self, stream: &mut Stream) -> Option<DVec3> {
        struct Through<'t>(&'t mut Stream);

        impl Visitor for Through<'_> {
            type End = Infallible;

            fn segment(&mut self, _: &Segment<'_>) -> ControlFlow<Infallible> {
                ControlFlow::Continue(())
            }

            fn mixture(&mut self, passes: f64, _: bool) -> Option<f64> {
                pass_by_chance(passes, self.0)
            }
        }

        let ray = self.ray(stream);
        let (mut walk, mut weight) = (Walk::start(self.scene, ray, self.scene.inside(ray.origin)), Rgb::ONE);
        for _ in 0..MOST_EVENTS {
            let Stop::Surface(at) = walk.advance(&mut Through(stream)) else { return None };
            if at.bsdf.nature() != Nature::Specular {
                return Some(at.point);
            }
            let onward = Vertex::Surface(&at).onward(Side::Eye, None, &mut weight, stream, survive)?;
            walk.leave(&at, onward.direction);
        }
        None
    }

    /// A ray from a place of the film.
    fn ray(&self, stream: &mut Stream) -> Ray {
        let x = (stream.uniform() * self.camera.size().0 as f64) as u32;
        let y = (stream.uniform() * self.camera.size().1 as f64) as u32;
        self.camera.ray(x, y, stream)
    }

    /// Whether so few paths collide that all of them should split.
    pub fn collisions_are_rare(&self, parts: u32) -> bool {
        const LONG_ENOUGH: u64 = 1000;
        let mut collided = 0;
        for index in 0..PILOT {
            let mut stream = Stream::new(self.seed, Purpose::Pilot, index, parts as u64);
            if !matches!(self.walk(LONG_ENOUGH, &mut stream), Wandered::Ended { collided: false }) {
                collided += 1;
            }
        }
        (collided as f64) < RARE * PILOT as f64
    }

    /// Where nothing absorbs, nothing escapes, and no limit ends a path, there is no steady state; and in a world's medium that has no
    /// end and absorbs nothing, what leaves the scene wanders for ever.
    pub fn refuse_eternity(&self) -> Result<()> {
        const WALKS: u64 = 32;
        const LONG: u64 = 100_000;
        let scene = self.scene;
        let walks = (0..WALKS).map(|index| {
            let mut stream = Stream::new(self.seed, Purpose::Pilot, index, u64::MAX);
            self.walk(LONG, &mut stream)
        });
        let endless = scene
            .world
            .map(|world| &scene.media[world as usize])
            .filter(|medium| medium.scatters() && medium.albedo.max_element() >= 1.0 && medium.density.is_endless());
        if let Some(medium) = endless {
            let bounds = scene.bounds();
            if walks.clone().any(|walk| matches!(walk, Wandered::TooLong(point) if !bounds.contains(point))) {
                return Err(Error::Scene(format!(
                    "medium {} fills the world without an end and absorbs nothing, so that light which leaves the scene wanders in it for ever: put it into a shape, give it a sigma_a, let it thin out, or limit render.max_depth",
                    medium.name
                )));
            }
        }
        let absorbs = |albedo: Rgb| albedo.min_element() < 1.0;
        let surfaces = scene.surfaces.iter().any(|surface| surface.material.absorbs());
        let media = scene.media.iter().any(|medium| !medium.is_clear() && absorbs(medium.albedo));
        if surfaces || media {
            return Ok(());
        }
        // Nothing absorbs: does anything escape?
        if walks.into_iter().any(|walk| matches!(walk, Wandered::Ended { .. })) {
            return Ok(());
        }
        Err(Error::Scene(
            "light in this scene neither escapes nor is absorbed, so it has no steady state: open the scene, lower a reflectance or an albedo below 1, or limit render.max_depth"
                .to_string(),
        ))
    }
}
