//! A camera path told event by event: the path that the film would draw, with the same random numbers.

use std::ops::ControlFlow;

use super::{Context, Eye, Looking, Path, Sample, claim};
use crate::math::{DVec3, Ray, Rgb, Stream};
use crate::scene::{Inside, Scene};
use crate::surface::Nature;
use crate::transport::{Crossing, Heading, Luggage, Parts, Segment, Traveller, Vertex, Walk, travel};

/// What happened to a path, and what came of it.
#[derive(Clone, Debug)]
pub struct Told {
    /// What happened.
    pub what: Happening,
    /// Where: for a segment, where it ends.
    pub place: DVec3,
    /// What was added to the sample: by lights that were asked for, or met.
    pub counted: Rgb,
    /// The path's weight afterwards: the part of the radiance found that the camera receives.
    pub throughput: Rgb,
    /// The path's events so far.
    pub events: u64,
    /// Whether this is the first of a part that was split off before.
    pub begins_part: bool,
}

/// What happens to a path. Shapes and media are given by their indices in the scene.
#[derive(Clone, Debug)]
pub enum Happening {
    /// It passed a medium, or a piece of it.
    Segment {
        /// The medium.
        medium: u32,
        /// How far it came there.
        length: f64,
    },
    /// It met a surface.
    Surface {
        /// What coincides there.
        shapes: Vec<u32>,
        /// How that spreads light.
        nature: Nature,
        /// The direction in which it goes on; `None` where it ends.
        onward: Option<DVec3>,
    },
    /// It collided in a medium.
    Collision {
        /// The medium.
        medium: u32,
        /// The direction in which it goes on; `None` where it ends.
        onward: Option<DVec3>,
    },
    /// It met what shines.
    Light {
        /// The light.
        light: u32,
        /// Its shape.
        shape: u32,
    },
    /// It left the scene.
    Escape,
}

impl<'s> Eye<'s> {
    /// What is seen along `ray`, as [`Eye::look`] has it, and how.
    pub(in crate::render) fn tell(
        &self,
        ray: Ray,
        inside: Inside,
        context: &mut Context<'_, 's>,
    ) -> (Sample, Vec<Told>) {
        let mut sample = Sample::default();
        let part = self.start(ray, inside);
        let mut parts = std::mem::take(context.parts);
        let looking = Looking { eye: self, sample: &mut sample, context };
        let mut telling = Telling { looking, told: Vec::new(), has_ended: false };
        travel(&mut telling, part, &mut parts);
        let told = telling.told;
        *context.parts = parts;
        claim::check(&mut sample.radiance, context.tally);
        (sample, told)
    }
}

/// An eye path that tells what it does. It draws nothing itself.
struct Telling<'e, 'c, 's> {
    looking: Looking<'e, 'c, 's>,
    told: Vec<Told>,
    /// Whether the part that was followed has come to its end.
    has_ended: bool,
}

impl<'s> Telling<'_, '_, 's> {
    fn found(&self) -> Rgb {
        self.looking.sample.radiance.iter().sum()
    }

    /// Notes what happened, given what had been found before.
    fn tell(&mut self, what: Happening, place: DVec3, before: Rgb, luggage: &Luggage<Path>) {
        let begins_part = std::mem::take(&mut self.has_ended);
        let counted = self.found() - before;
        let (throughput, events) = (luggage.weight, luggage.events);
        self.told.push(Told { what, place, counted, throughput, events, begins_part });
    }
}

impl<'s> Traveller<'s> for Telling<'_, '_, 's> {
    type Own = Path;

    fn scene(&self) -> &'s Scene {
        self.looking.scene()
    }

    fn stream(&mut self) -> &mut Stream {
        self.looking.stream()
    }

    fn farthest(&mut self, medium: u32, ray: &Ray, luggage: &mut Luggage<Path>) -> f64 {
        self.looking.farthest(medium, ray, luggage)
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> ControlFlow<f64> {
        let before = self.found();
        let flow = self.looking.segment(segment, luggage, parts);
        let end = match flow {
            ControlFlow::Break(t) => t,
            ControlFlow::Continue(()) => segment.b,
        };
        let what = Happening::Segment { medium: segment.medium, length: end - segment.a };
        self.tell(what, segment.ray.at(end), before, luggage);
        self.has_ended = luggage.weight.max_element() <= 0.0;
        flow
    }

    fn crossing(&mut self, crossing: &Crossing<'_>, luggage: &mut Luggage<Path>) {
        let before = self.found();
        self.looking.crossing(crossing, luggage);
        let what = Happening::Light { light: crossing.light, shape: crossing.hit.id };
        self.tell(what, crossing.ray.at(crossing.hit.t), before, luggage);
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> Option<Heading> {
        let before = self.found();
        let heading = self.looking.turn(at, walk, luggage, parts);
        let onward = heading.as_ref().map(|heading| heading.direction);
        let what = match at {
            Vertex::Medium(at) => Happening::Collision { medium: at.index, onward },
            Vertex::Surface(_) | Vertex::Guided(..) => {
                let shapes = walk.hits().iter().map(|hit| hit.id).collect();
                Happening::Surface { shapes, nature: at.nature(), onward }
            }
        };
        self.tell(what, at.point(), before, luggage);
        self.has_ended = heading.is_none();
        heading
    }

    fn escapes(&mut self, direction: DVec3, luggage: &Luggage<Path>) {
        let before = self.found();
        self.looking.escapes(direction, luggage);
        self.tell(Happening::Escape, direction, before, luggage);
        self.has_ended = true;
    }

    fn breaks_off(&mut self) -> bool {
        self.looking.breaks_off()
    }

    fn stopped(&mut self) {
        self.looking.stopped();
    }
}
