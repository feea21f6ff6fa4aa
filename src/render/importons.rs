//! Importons: paths from the eye that tell, before photons are traced, where these count in the picture.

use std::ops::ControlFlow;

use super::pilot::Pilot;
use crate::math::random::Purpose;
use crate::math::{DVec3, Rgb, Stream};
use crate::photon::{Importon, Importons, in_chunks};
use crate::scene::Scene;
use crate::scene::description::Indirect;
use crate::surface::{Nature, Side};
use crate::transport::{Heading, Luggage, Part, Parts, Segment, Traveller, Vertex, Walk, force, survive, travel};

/// Paths that are traced: where a thousandth of the picture's light is looked for, thirty tell it.
const PATHS: u64 = 1 << 15;
/// Mirrored and refracted ones end after so many events.
const MOST_EVENTS: u64 = 64;

/// Traces importons from all of the film: to the first surface that spreads light, and, where light is gathered there, to the next.
pub(super) fn trace<'s>(pilot: &Pilot<'s>, indirect: Indirect) -> Importons {
    let scene = pilot.scene;
    let emit = |path, found: &mut Importons, parts: &mut Parts<'s, Spread>| {
        let mut stream = Stream::new(pilot.seed, Purpose::Importon, path, 0);
        let ray = pilot.ray(&mut stream);
        let walk = Walk::start(scene, ray, scene.inside(ray.origin));
        let start = Part { walk, luggage: Luggage::new(Rgb::ONE, Spread::Not), collision: None };
        travel(&mut Looking { scene, stream: &mut stream, indirect, found }, start, parts);
    };
    let mut all = Importons::default();
    for chunk in in_chunks(0..PATHS, &|| false, emit, |_, _, _| {}) {
        all.media.extend(chunk.media);
        all.caustic.extend(chunk.caustic);
        all.global.extend(chunk.global);
    }
    all
}

/// Whether a path was spread by a surface yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Spread {
    Not,
    Once,
}

struct Looking<'s, 't> {
    scene: &'s Scene,
    stream: &'t mut Stream,
    indirect: Indirect,
    found: &'t mut Importons,
}

impl<'s> Traveller<'s> for Looking<'s, '_> {
    type Own = Spread;

    fn scene(&self) -> &'s Scene {
        self.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    /// Light is looked for all along: where it would come from is drawn as a forced collision.
    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Spread>,
        _: &mut Parts<'s, Spread>,
    ) -> ControlFlow<f64> {
        let medium = &self.scene.media[segment.medium as usize];
        let range = (segment.a, segment.b);
        let forced = force(medium, segment.ray, range, luggage.weight, self.stream);
        if let Some((t, weight)) = forced.collision {
            let point = segment.ray.at(t);
            self.found.media.extend(importon(point, weight * medium.albedo_at(point)));
        }
        luggage.weight *= forced.passed;
        ControlFlow::Continue(())
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        _: &Walk<'s>,
        luggage: &mut Luggage<Spread>,
        _: &mut Parts<'s, Spread>,
    ) -> Option<Heading> {
        if at.nature() == Nature::Diffuse {
            let place = importon(at.point(), luggage.weight * at.albedo());
            let first = luggage.own == Spread::Not;
            if first {
                self.found.caustic.extend(place);
            }
            if first == (self.indirect == Indirect::Map) {
                self.found.global.extend(place);
            }
            if !first || matches!(self.indirect, Indirect::Map | Indirect::None) {
                return None;
            }
            luggage.own = Spread::Once;
        }
        let onward = at.onward(Side::Eye, None, &mut luggage.weight, self.stream, survive)?;
        luggage.events += 1;
        (luggage.events < MOST_EVENTS).then_some(Heading { direction: onward.direction })
    }

    fn stopped(&mut self) {}
}

/// What counts so much here, if it does.
fn importon(position: DVec3, weight: Rgb) -> Option<Importon> {
    let weight = weight.element_sum() as f32;
    (weight > 0.0 && weight.is_finite()).then(|| Importon { position: position.as_vec3(), weight })
}
