//! The journey of a path: from vertex to vertex until it ends, written once.
//!
//! Eye paths, photons and pilots are [`Traveller`]s: they say what they do with a segment of medium, with a surface that
//! shines, and at a vertex. The way between is the [`Walk`]'s. Whoever splits pushes the other part onto [`Parts`], which
//! are followed one after the other.

use std::ops::ControlFlow;

use super::roulette::endures;
use super::segment::{Crossing, Segment};
use super::vertex::{Collision, Vertex};
use super::walk::{Stop, Visitor, Walk, pass_by_chance};
use crate::math::{DVec3, Ray, Rgb, Stream};
use crate::scene::Scene;
use crate::surface::Nature;

/// What a traveller carries from vertex to vertex.
#[derive(Clone, Debug)]
pub struct Luggage<S> {
    /// The weight: of a photon its power, of an eye path the part of the radiance found that the camera receives. It
    /// holds the true densities of all that was drawn.
    pub weight: Rgb,
    /// The events so far: scatterings in media and at surfaces.
    pub events: u64,
    /// The specular events in a row.
    turns: u32,
    /// What else the traveller remembers.
    pub own: S,
}

impl<S> Luggage<S> {
    /// At the start.
    pub fn new(weight: Rgb, own: S) -> Self {
        Luggage { weight, events: 0, turns: 0, own }
    }

    /// What a part takes that was split off with its share of the weight.
    pub fn part(&self, weight: Rgb, own: S) -> Self {
        Luggage { weight, events: self.events, turns: 0, own }
    }
}

/// A part of a journey that is yet to be followed.
pub struct Part<'s, S> {
    /// The way it takes.
    pub walk: Walk<'s>,
    /// What it carries.
    pub luggage: Luggage<S>,
    /// The parameter on its line and the medium with which it collides there, if that is decided already.
    pub collision: Option<(f64, u32)>,
}

/// Parts that wait to be followed: the last first, so that they are few.
pub type Parts<'s, S> = Vec<Part<'s, S>>;

/// Whither a traveller turns.
pub struct Heading {
    /// The unit direction of travel.
    pub direction: DVec3,
}

/// Walks that nothing ends are stopped after so many events, and counted.
pub const SAFETY_STOP: u64 = 1_000_000_000;

/// Every so many events a walk asks whether it is to be broken off: in milliseconds.
const PATIENCE: u64 = 1 << 14;

/// Who goes on a journey.
pub trait Traveller<'s> {
    /// What it remembers on its way beside weight and events.
    type Own;

    /// The scene it travels in.
    fn scene(&self) -> &'s Scene;

    /// Its random numbers.
    fn stream(&mut self) -> &mut Stream;

    /// Sets out, from its start or from a surface. Returns whether it goes at all.
    fn sets_out(
        &mut self,
        _walk: &Walk<'s>,
        _luggage: &mut Luggage<Self::Own>,
        _parts: &mut Parts<'s, Self::Own>,
    ) -> bool {
        true
    }

    /// How far it gets in a medium at most, if it knows: see [`Visitor::farthest`].
    fn farthest(&mut self, _medium: u32, _ray: &Ray, _luggage: &mut Luggage<Self::Own>) -> f64 {
        f64::INFINITY
    }

    /// Passes a segment of a medium, or breaks at the parameter where it collides.
    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Self::Own>,
        parts: &mut Parts<'s, Self::Own>,
    ) -> ControlFlow<f64>;

    /// Meets a surface that shines.
    fn crossing(&mut self, _crossing: &Crossing<'_>, _luggage: &mut Luggage<Self::Own>) {}

    /// Turns at a vertex, to which `walk` has come: asks, deposits, splits, and counts the event. `None` ends this part.
    fn turn(
        &mut self,
        at: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Self::Own>,
        parts: &mut Parts<'s, Self::Own>,
    ) -> Option<Heading>;

    /// Is asked at a collision, at this parameter of the walk's line in this medium, whether it is taken on from here by other means:
    /// then this part ends.
    fn is_taken_on(&mut self, _walk: &Walk<'s>, _collision: (f64, u32), _luggage: &Luggage<Self::Own>) -> bool {
        false
    }

    /// Leaves the scene.
    fn escapes(&mut self, _direction: DVec3, _luggage: &Luggage<Self::Own>) {}

    /// Is stopped after [`SAFETY_STOP`] events.
    fn stopped(&mut self);

    /// Whether it is to break off: what it has found is of no use then.
    fn breaks_off(&mut self) -> bool {
        false
    }
}

/// Follows a journey, and all that is split off it, to the ends. `parts` is room for what waits meanwhile.
pub fn travel<'s, T: Traveller<'s>>(traveller: &mut T, start: Part<'s, T::Own>, parts: &mut Parts<'s, T::Own>) {
    follow(traveller, start, parts);
    while let Some(part) = parts.pop() {
        follow(traveller, part, parts);
    }
}

/// Follows one part to its end.
fn follow<'s, T: Traveller<'s>>(traveller: &mut T, part: Part<'s, T::Own>, parts: &mut Parts<'s, T::Own>) {
    let Part { mut walk, mut luggage, mut collision } = part;
    let mut sets_out = collision.is_none();
    loop {
        if std::mem::take(&mut sets_out) && !traveller.sets_out(&walk, &mut luggage, parts) {
            return;
        }

        // To the next vertex.
        let stop = match collision.take() {
            Some(collision) => Stop::Ended(collision),
            None => walk.advance(&mut Passage { traveller, luggage: &mut luggage, parts }),
        };
        if luggage.weight.max_element() <= 0.0 {
            return;
        }

        // The turn there. An interaction is large: it stays where it is.
        match &stop {
            &Stop::Ended((t, index)) => {
                if traveller.is_taken_on(&walk, (t, index), &luggage) {
                    return;
                }
                let collision = Collision {
                    point: walk.ray.at(t),
                    direction: walk.ray.direction,
                    t,
                    medium: &traveller.scene().media[index as usize],
                    index,
                    inside: &walk.inside,
                    peak: None,
                };
                let heading = traveller.turn(Vertex::Medium(&collision), &walk, &mut luggage, parts);
                let Some(Heading { direction }) = heading else { return };
                walk.turn(t, direction);
                luggage.turns = 0;
            }
            Stop::Surface(at) => {
                let heading = traveller.turn(Vertex::Surface(at), &walk, &mut luggage, parts);
                let Some(Heading { direction }) = heading else { return };
                walk.leave(at, direction);
                sets_out = true;
                luggage.turns = if at.bsdf.nature() == Nature::Specular { luggage.turns + 1 } else { 0 };
                if !endures(luggage.turns, &mut luggage.weight, traveller.stream()) {
                    return;
                }
            }
            Stop::Escaped => {
                traveller.escapes(walk.ray.direction, &luggage);
                return;
            }
        }
        if luggage.events >= SAFETY_STOP {
            traveller.stopped();
            return;
        }
        if luggage.events.is_multiple_of(PATIENCE) && traveller.breaks_off() {
            parts.clear();
            return;
        }
    }
}

/// A traveller between two vertices.
struct Passage<'p, 's, T: Traveller<'s>> {
    traveller: &'p mut T,
    luggage: &'p mut Luggage<T::Own>,
    parts: &'p mut Parts<'s, T::Own>,
}

impl<'s, T: Traveller<'s>> Visitor for Passage<'_, 's, T> {
    /// The parameter and the medium of a collision.
    type End = (f64, u32);

    fn farthest(&mut self, medium: u32, ray: &Ray) -> f64 {
        self.traveller.farthest(medium, ray, self.luggage)
    }

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<(f64, u32)> {
        match self.traveller.segment(segment, self.luggage, self.parts) {
            ControlFlow::Break(t) => ControlFlow::Break((t, segment.medium)),
            ControlFlow::Continue(()) => ControlFlow::Continue(()),
        }
    }

    fn crossing(&mut self, crossing: &Crossing<'_>) {
        self.traveller.crossing(crossing, self.luggage);
    }

    fn mixture(&mut self, passes: f64, _: bool) -> Option<f64> {
        pass_by_chance(passes, self.traveller.stream())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use crate::math::random::Purpose;
    use crate::scene;

    /// Splits in two at each of its first events, and ends at the next, or goes on for ever.
    struct Splitting<'s> {
        scene: &'s Scene,
        stream: Stream,
        splits: u64,
        ends: bool,
        /// The weight that came to an end, and in how many parts.
        ended: (f64, u64),
        /// Parts that waited at one time, at most.
        waiting: usize,
        /// Events of all parts.
        events: u64,
        /// How often it was asked whether to break off: the third time it does.
        asked: u64,
    }

    impl<'s> Traveller<'s> for Splitting<'s> {
        type Own = ();

        fn scene(&self) -> &'s Scene {
            self.scene
        }

        fn stream(&mut self) -> &mut Stream {
            &mut self.stream
        }

        fn segment(&mut self, segment: &Segment<'_>, _: &mut Luggage<()>, _: &mut Parts<'s, ()>) -> ControlFlow<f64> {
            ControlFlow::Break(segment.a + 1.0)
        }

        fn turn(
            &mut self,
            at: Vertex<'_>,
            walk: &Walk<'s>,
            luggage: &mut Luggage<()>,
            parts: &mut Parts<'s, ()>,
        ) -> Option<Heading> {
            let Vertex::Medium(at) = at else { panic!("there is no surface") };
            assert_eq!(at.point, walk.ray.at(at.t));
            luggage.events += 1;
            self.events += 1;
            if luggage.events <= self.splits {
                luggage.weight *= 0.5;
                let mut walk = walk.clone();
                walk.turn(at.t, -at.direction);
                parts.push(Part { walk, luggage: luggage.clone(), collision: None });
                self.waiting = self.waiting.max(parts.len());
            } else if self.ends {
                self.ended = (self.ended.0 + luggage.weight.x, self.ended.1 + 1);
                return None;
            }
            // To and fro.
            let direction = if self.ends { at.direction } else { -at.direction };
            Some(Heading { direction })
        }

        fn stopped(&mut self) {
            panic!("it ends by itself, or breaks off before");
        }

        fn breaks_off(&mut self) -> bool {
            self.asked += 1;
            self.asked > 2
        }
    }

    /// Sends it out.
    fn sent(splits: u64, ends: bool, check: impl FnOnce(&Splitting<'_>, &Parts<'_, ()>)) {
        let (scene, _) = scene::from_text(
            "[camera]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n[world]\nmedium = \"air\"\n[media.air]\nsigma_s = 1\n",
        );
        let stream = Stream::new(1, Purpose::Test, 0, 0);
        let (ended, waiting, events, asked) = ((0.0, 0), 0, 0, 0);
        let mut splitting = Splitting { scene: &scene, stream, splits, ends, ended, waiting, events, asked };
        let walk = Walk::new(&scene, crate::math::Ray::new(DVec3::ZERO, DVec3::X), scene.inside(DVec3::ZERO));
        let start = Part { walk, luggage: Luggage::new(Rgb::ONE, ()), collision: Some((0.5, 0)) };
        let mut parts = Parts::new();
        travel(&mut splitting, start, &mut parts);
        check(&splitting, &parts);
    }

    /// All parts are followed, each once, and no more of them wait than there are splits on one way.
    #[test]
    fn all_parts_are_followed() {
        sent(10, true, |splitting, _| assert_eq!((splitting.ended, splitting.waiting), ((1.0, 1 << 10), 10)));
    }

    /// Who is told to break off does so soon, and what waits is not followed.
    #[test]
    fn a_journey_breaks_off() {
        sent(1, false, |endless, parts| {
            assert_eq!((endless.asked, endless.events, endless.waiting), (3, 3 * PATIENCE, 1));
            assert!(parts.is_empty());
        });
    }
}
