//! Light that an eye path asks for at its vertices, and light that it meets on its way.

use std::ops::ControlFlow;

use super::component::Component;
use super::single::collision;
use super::{Context, Looking, Path, Seeks, Spread};
use crate::gather::{GlobalMap, IrradianceCache, Visibility};
use crate::light::{Arrival, Light, Receiver};
use crate::math::random::Dimension;
use crate::math::{DVec3, Ray, Rgb};
use crate::medium::phase::Peak;
use crate::surface::{Nature, Side};
use crate::transport::{
    self, Asked, Collision, Crossing, Flight, Interaction, Landing, Luggage, Segment, ShadowRay, Stop, Turn, Vertex,
    Visitor, Walk, equiangular, transmit, transmit_straight,
};

/// Points of glowing media that the first diffuse surface asks for light where photons are gathered: each costs
/// little beside the queries of a path.
const EMBERS: u32 = 4;

impl Looking<'_, '_, '_> {
    /// How many points of glowing media are asked for light where a path turns.
    pub(super) fn embers(&self, events: u64) -> u32 {
        if self.eye.has_photons() && events == 1 { EMBERS } else { 1 }
    }

    /// How many shadow rays ask for light at a surface where a path turns.
    pub(super) fn shadow_rays(&self, events: u64) -> u32 {
        if events == 1 { self.eye.settings.light_samples } else { 1 }
    }

    /// Asks for light where a path turns at a surface: of glowing media, where it turns diffusely, and straight from a light. `both`: it
    /// will follow both lobes of a boundary.
    pub(super) fn ask(&mut self, at: Vertex<'_>, luggage: &Luggage<Path>, both: bool) {
        if at.nature() == Nature::Diffuse {
            self.ask_glows(at, luggage);
        }
        let count = self.shadow_rays(luggage.events);
        if count > 1 {
            let mark = self.context.stream.mark();
            for number in 0..count {
                self.context.stream.again(mark, number);
                self.ask_light(at, luggage, both, None, count);
            }
        } else {
            self.ask_light(at, luggage, both, None, 1);
        }
    }

    /// Light of points of glowing media.
    pub(super) fn ask_glows(&mut self, at: Vertex<'_>, luggage: &Luggage<Path>) {
        let count = if matches!(at, Vertex::Medium(_)) { 1 } else { self.embers(luggage.events) };
        for _ in 0..count {
            self.ask_glow(at, luggage, count);
        }
    }

    /// Light of one of `count` points of a glowing medium.
    fn ask_glow(&mut self, at: Vertex<'_>, luggage: &Luggage<Path>, count: u32) {
        let stream = &mut *self.context.stream;
        let Some(ember) = self.eye.glows.draw(at.point(), stream) else { return };
        let mut weight = Rgb::ZERO;
        at.toward(ember.direction, Side::Eye, false, luggage.weight, stream, |arriving, sent| {
            weight += arriving * sent.value * ember.radiance * ember.weight(count, sent.ahead.x);
        });
        if weight.max_element() > 0.0 {
            let way = (ember.direction, ember.distance, -ember.direction);
            let most = self.eye.left_after(luggage.events);
            let sheets = at.transmit(self.eye.scene, way, most, &mut weight, stream);
            self.sample.radiance[luggage.own.component(luggage.events + sheets, false) as usize] += weight;
        }
    }

    /// Light straight from a light, by one of `count` shadow rays. `landing`: how the collision was drawn, in a medium.
    pub(super) fn ask_light(
        &mut self,
        at: Vertex<'_>,
        luggage: &Luggage<Path>,
        both: bool,
        landing: Option<&Landing>,
        count: u32,
    ) {
        let (scene, stream) = (self.eye.scene, &mut *self.context.stream);
        let Some(asked) = Asked::draw(scene, &at.receiver(), stream) else { return };
        let asked = asked.of(count);
        let Asked { emitter, arrival, .. } = asked;

        // Who else might have found it: the path by chance, and in media the equiangular draw of the collision.
        let straight_on = landing.is_some() && self.eye.straight_on();
        let others = landing.map_or(0.0, |landing| landing.rival(scene, emitter, &arrival));
        let mut weight = Rgb::ZERO;
        at.toward(arrival.direction, Side::Eye, both, luggage.weight, stream, |arriving, sent| {
            let met = if straight_on { Rgb::ZERO } else { sent.ahead };
            weight += arriving * sent.value * asked.over(met, others);
        });
        if weight.max_element() <= 0.0 {
            return;
        }

        // What is in its way.
        let most = self.eye.left_after(luggage.events);
        let Arrival { direction, distance, normal, .. } = arrival;
        let sheets = match at {
            Vertex::Medium(at) if straight_on => {
                let shadow = ShadowRay::new(at.point, at.point, direction, distance, normal);
                transmit_straight(scene, shadow, at.inside, most, &mut weight, stream)
            }
            Vertex::Surface(surface) | Vertex::Guided(surface, _) if !self.must_ask(surface, &asked, &mut weight) => 0,
            _ => at.transmit(scene, (direction, distance, normal), most, &mut weight, self.context.stream),
        };
        // It comes straight to here: a caustic if a narrow lobe sends it on, but not for what was mirrored before on the eye's side.
        let caustic = at.nature() == Nature::Narrow && luggage.own.spread == Spread::First;
        let component = Component::of(luggage.own.first, luggage.events + sheets, true, caustic);
        self.sample.radiance[component as usize] += weight;
    }

    /// Whether a shadow ray has to find out what of a light is seen: else `weight` is what is.
    fn must_ask(&mut self, at: &Interaction, asked: &Asked, weight: &mut Rgb) -> bool {
        let visibility = self.eye.settings.visibility.map_or(Visibility::Unknown, |map| {
            let normal = at.incidence.normal;
            let side = if asked.arrival.direction.dot(normal) < 0.0 { -normal } else { normal };
            map.visibility(asked.emitter.light, at.point, side)
        });
        let stats = &mut self.context.queue.stats;
        match visibility {
            Visibility::Unknown => stats.shadow_rays += 1,
            Visibility::Lit | Visibility::Dark => stats.spared_rays += 1,
        }
        if visibility == Visibility::Dark {
            *weight = Rgb::ZERO;
        }
        visibility == Visibility::Unknown
    }

    /// Light straight from a light, scattered at a collision, the last event of its path: asked for, and met by
    /// chance, which wide lights and sharp phase functions need.
    pub(super) fn light_once(&mut self, at: &Collision<'_>, mut luggage: Luggage<Path>, landing: Landing) {
        let scene = self.eye.scene;
        self.ask_light(Vertex::Medium(at), &luggage, false, Some(&landing), 1);
        if self.eye.straight_on() || !self.eye.lights_have_size {
            return;
        }
        let (direction, density) = at.sample(&mut luggage.weight, self.context.stream);
        luggage.weight *= at.albedo();
        luggage.own.turn = Turn::Medium { point: at.point, density, landing };
        self.meet_straight_on(Walk::new(scene, Ray::new(at.point, direction), at.inside.clone()), luggage);
    }

    /// Light that is met by chance without another turn, through sheets.
    fn meet_straight_on(&mut self, mut walk: Walk<'_>, mut luggage: Luggage<Path>) {
        let (max_events, direction) = (self.eye.settings.max_events, walk.ray.direction);
        let mut arriving = Arriving { looking: self, luggage: &mut luggage };
        loop {
            match walk.advance(&mut arriving) {
                Stop::Surface(at) => {
                    let passed = at.sheet().filter(|_| max_events.allows(arriving.luggage.events));
                    let Some(passed) = passed else { return };
                    arriving.luggage.weight *= passed;
                    arriving.luggage.events += 1;
                    walk.leave(&at, direction);
                }
                Stop::Escaped => return self.escape(direction, &luggage),
                Stop::Ended(()) => return,
            }
        }
    }

    /// Light straight from a light, scattered on a segment where an equiangular draw says: finds what collisions by chance find
    /// badly, close to small lights and in thin media. `by_flight` tells with what density collisions are drawn there otherwise, `peak` what
    /// part of the phase function counts.
    pub(super) fn light_equiangularly(
        &mut self,
        (segment, peak): (&Segment<'_>, Option<&Peak>),
        flight: &Flight,
        luggage: &Luggage<Path>,
        by_flight: impl Fn(f64) -> f64,
    ) {
        let (scene, stream) = (self.eye.scene, &mut *self.context.stream);
        let medium = &scene.media[segment.medium as usize];
        let draw = stream.draw(Dimension::Equiangular, |stream| equiangular::draw(scene, flight, stream));
        let Some(draw) = draw else { return };
        let at = collision((segment, medium), peak, draw.t);
        let (point, density) = (at.point, medium.density.at(at.point));
        if density <= 0.0 {
            return;
        }

        // Its part, where flights draw that collision, and the light is asked for or met from there.
        let (phase, met) = at.phase(draw.arrival.direction);
        let asked = scene.light_choice(draw.emitter, &Receiver::around(point)) * draw.arrival.density;
        let met = if self.eye.straight_on() { 0.0 } else { met };
        let scattering = medium.extinction * medium.albedo_at(point) * (density * phase);
        let mut weight = luggage.weight * scattering * draw.over(by_flight(draw.t), asked, met);

        // What passes from the light to the collision, and from there on.
        transport::pass(medium, segment.ray, (segment.a, draw.t), &mut weight, stream);
        if weight.max_element() <= 0.0 {
            return;
        }
        let events = luggage.events + 1;
        let Arrival { direction, distance, normal, .. } = draw.arrival;
        let shadow = ShadowRay::new(point, point, direction, distance, normal);
        let transmit = if self.eye.straight_on() { transmit_straight } else { transmit };
        let sheets = transmit(scene, shadow, segment.inside, self.eye.left_after(events), &mut weight, stream);
        self.sample.radiance[luggage.own.scattered().component(events + sheets, true) as usize] += weight;
    }

    /// Light of caustics, from photons.
    pub(super) fn read_caustics(&mut self, at: &Interaction, luggage: &Luggage<Path>) {
        let Some(map) = self.eye.settings.caustics.filter(|_| at.caustics.receives) else { return };
        let most = self.eye.left_after(luggage.events);
        let Context { stream, queue, .. } = &mut *self.context;
        let radiance = map.reflected(self.eye.scene, at, most, stream, &mut queue.around);
        let component = Component::of(luggage.own.first, luggage.events + 1, true, luggage.events == 1);
        self.sample.radiance[component as usize] += luggage.weight * radiance;
    }

    /// All light that a surface spreads, from photons: seen by the camera or through mirrors, or `rough`, by other surfaces.
    pub(super) fn read_global(&mut self, map: &GlobalMap, at: &Interaction, luggage: &Luggage<Path>, rough: bool) {
        let most = self.eye.left_after(luggage.events);
        let Context { stream, queue, .. } = &mut *self.context;
        let radiance = map.reflected(self.eye.scene, at, (most, rough), stream, &mut queue.global);
        let component = Component::of(luggage.own.first, luggage.events + 1, false, false);
        self.sample.radiance[component as usize] += luggage.weight * radiance;
    }

    /// Indirect light that a Lambertian surface reflects, from the irradiance cache. Returns whether that tells it.
    pub(super) fn read_cache(&mut self, cache: &IrradianceCache, at: &Interaction, luggage: &Luggage<Path>) -> bool {
        let Some(reflectance) = at.bsdf.lambertian() else { return false };
        let Some(irradiance) = cache.irradiance(at.point, at.incidence.shading_normal) else { return false };
        let component = Component::of(luggage.own.first, luggage.events + 1, false, false);
        self.sample.radiance[component as usize] += luggage.weight * reflectance * irradiance / std::f64::consts::PI;
        true
    }

    /// Whether the light of a light that a path meets does not count: photons bring it, or it is of a caustic that is left out.
    fn is_idle(&self, luggage: &Luggage<Path>) -> bool {
        let brought = self.eye.settings.caustics.is_some() || luggage.own.uncast;
        let found = luggage.own.glimpsed || luggage.own.asked || luggage.own.seeks == Seeks::Scattered;
        found || brought && luggage.own.meets_caustic()
    }

    /// Whether the light of lights that a surface sends on to where the path was spread is a caustic that photons bring, or that is left
    /// out.
    pub(super) fn is_known(&self, at: &Interaction, luggage: &Luggage<Path>) -> bool {
        let brought = self.eye.settings.caustics.is_some() || luggage.own.uncast || !at.caustics.casts;
        brought && at.bsdf.nature() == Nature::Narrow && luggage.own.spread != Spread::Other
    }

    /// Looks along the way that a coat or a sheet mirrors for what shines there, straight on. A path that may also go on by the base, or
    /// pass, draws that way rarely, and a lamp in the coat would make it count many times over. Returns whether that is known now, so that
    /// it does not count for the path that goes on there.
    pub(super) fn glimpse(&mut self, at: &Interaction, walk: &Walk<'_>, luggage: &Luggage<Path>) -> bool {
        if !self.eye.lights_have_size {
            return false;
        }
        let Some((direction, factor)) = at.bsdf.mirrored(&at.incidence) else { return false };
        let uncast = luggage.own.uncast || !at.caustics.casts;
        let own =
            Path { bent: true, uncast, asked: false, glimpsed: false, turn: Turn::Specular, ..luggage.own.clone() };
        let mirrored = luggage.part(luggage.weight * factor, own);
        if self.is_idle(&mirrored) {
            return false;
        }
        let mut walk = walk.clone();
        walk.leave(at, direction);
        self.meet_straight_on(walk, mirrored);
        true
    }

    /// Light that a path meets by chance on a shape that shines.
    pub(super) fn meet(&mut self, crossing: &Crossing<'_>, luggage: &Luggage<Path>) {
        if self.is_idle(luggage) {
            return;
        }
        let Light::Area(area) = &self.eye.scene.lights[crossing.light as usize] else { return };
        let radiance = area.radiance(crossing.hit.normal, -crossing.ray.direction);
        if radiance.max_element() > 0.0 {
            let share = luggage.own.turn.share_of_crossing(self.eye.scene, crossing);
            let component = luggage.own.component(luggage.events, true);
            self.sample.radiance[component as usize] += luggage.weight * radiance * share;
        }
    }

    /// Light from infinity, met by chance.
    pub(super) fn escape(&mut self, direction: DVec3, luggage: &Luggage<Path>) {
        if self.is_idle(luggage) {
            return;
        }
        let component = luggage.own.component(luggage.events, true) as usize;
        for &index in self.eye.scene.emitters.infinite() {
            let radiance = self.eye.scene.lights[index as usize].escaping(direction);
            if radiance.max_element() > 0.0 {
                let share = luggage.own.turn.share_of_escape(self.eye.scene, index, direction);
                self.sample.radiance[component] += luggage.weight * radiance * share;
            }
        }
    }
}

impl Path {
    /// The component of light that this path finds after so many events: `straight` from a light, or from a glowing medium.
    pub(super) fn component(&self, events: u64, straight: bool) -> Component {
        Component::of(self.first, events, straight, self.bent && self.spread == Spread::First)
    }
}

/// Light met by chance from a collision: no more is done to it than to pass.
struct Arriving<'a, 'e, 'c, 's> {
    looking: &'a mut Looking<'e, 'c, 's>,
    luggage: &'a mut Luggage<Path>,
}

impl Visitor for Arriving<'_, '_, '_, '_> {
    type End = ();

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()> {
        let medium = &self.looking.eye.scene.media[segment.medium as usize];
        let range = (segment.a, segment.b);
        transport::pass(medium, segment.ray, range, &mut self.luggage.weight, self.looking.context.stream);
        if self.luggage.weight.max_element() > 0.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }

    fn crossing(&mut self, crossing: &Crossing<'_>) {
        self.looking.meet(crossing, self.luggage);
    }

    fn mixture(&mut self, passes: f64, _: bool) -> Option<f64> {
        transport::pass_by_chance(passes, self.looking.context.stream)
    }
}
