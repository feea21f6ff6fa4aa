//! What an eye path does with a segment of a medium: collide by chance, split into a part that collides and one that does
//! not, or gather photons along all of it.

use std::ops::ControlFlow;

use super::component::{Component, First};
use super::{Claim, Context, Looking, Mode, Path, Seeks};
use crate::gather::{self, EyeSegment, PointMaps, VolumeMaps};
use crate::math::random::Dimension;
use crate::math::{Ray, Rgb};
use crate::medium::phase::Peak;
use crate::medium::{Emission, Medium};
use crate::photon::walls;
use crate::transport::{self, Events, Flight, Landing, Luggage, Part, Parts, Segment, Walk};

impl<'s> Looking<'_, '_, 's> {
    /// Passes a segment, or breaks at the parameter where the path collides.
    pub(super) fn pass(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> ControlFlow<f64> {
        let medium = &self.eye.scene.media[segment.medium as usize];
        match self.eye.settings.mode {
            Mode::Gather(maps) => {
                if luggage.own.scattered
                    && let Some(peak) = self.leaves(segment, luggage)
                    && medium.extinction == Rgb::splat(medium.extinction.x)
                {
                    return self.gather_by_chance(maps, (segment, peak), medium, luggage);
                }
                self.stray(segment, medium, luggage, parts);
                self.gather(maps, segment, medium, luggage);
            }
            Mode::March(maps) => {
                self.stray(segment, medium, luggage, parts);
                self.march(maps, segment, medium, luggage);
            }
            Mode::Pass => {
                self.light_itself(segment, medium, luggage);
                luggage.weight *= medium.transmittance(medium.density.depth(segment.ray, segment.a, segment.b));
            }
            Mode::Track | Mode::Split => return self.fly(segment, medium, luggage, parts),
        }
        ControlFlow::Continue(())
    }

    /// How far a path flies through a medium where light along the way is left to its collisions: it need not know then
    /// where the medium ends, which in dense media is far beyond.
    pub(super) fn draw_flight(&mut self, medium: &Medium, ray: &Ray, luggage: &mut Luggage<Path>) -> f64 {
        let tracks = matches!(self.eye.settings.mode, Mode::Track | Mode::Split) && !luggage.own.splits;
        let asks = medium.scatters() && self.eye.settings.max_events.allows(luggage.events);
        let alone = matches!(medium.emission, Emission::None) && medium.density.is_even();
        if !tracks || !alone || asks && transport::equiangular::matters(self.eye.scene, medium, ray) {
            return f64::INFINITY;
        }
        let weight = luggage.weight;
        let draw = |stream: &mut _| transport::draw(medium, weight, stream);
        *luggage.own.drawn.insert(self.context.stream.draw(Dimension::Flight, draw))
    }

    /// A path without photons.
    fn fly(
        &mut self,
        segment: &Segment<'_>,
        medium: &Medium,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> ControlFlow<f64> {
        let flight = Flight::new(segment, medium, luggage.weight);
        if let Some(target) = luggage.own.drawn.take() {
            let collision = transport::end(medium, segment.ray, (segment.a, segment.b), target, &mut luggage.weight);
            return collide(flight, medium, collision, luggage);
        }
        let splits = luggage.own.splits;
        if medium.scatters() && self.eye.settings.max_events.allows(luggage.events) {
            let by_flight = |t| {
                let certain = splits.then(|| flight.certain(medium));
                certain.as_ref().unwrap_or(&flight).flight_density(medium, t)
            };
            self.light_equiangularly((segment, None), &flight, luggage, by_flight);
        }
        if splits {
            self.split(segment, flight, medium, luggage, parts);
            return ControlFlow::Continue(());
        }
        self.track(segment, flight, medium, luggage)
    }

    /// A collision by chance.
    fn track(
        &mut self,
        segment: &Segment<'_>,
        flight: Flight,
        medium: &Medium,
        luggage: &mut Luggage<Path>,
    ) -> ControlFlow<f64> {
        let range = (segment.a, segment.b);
        let is_even = medium.even_glow().is_some();
        if is_even {
            self.glow(segment, medium, luggage);
        }

        // What voxels emit is met on the way.
        let rival = luggage.own.turn.rival(&self.eye.glows, segment.medium);
        let component = luggage.own.component(luggage.events, false) as usize;
        let glows = !is_even && !matches!(medium.emission, Emission::None);
        let Context { stream, tally, .. } = &mut *self.context;
        let radiance = &mut self.sample.radiance[component];
        let weight = &mut luggage.weight;
        let collision = stream.draw(Dimension::Flight, |stream| {
            transport::fly(medium, segment.ray, range, weight, stream, tally, |t, weight, length| {
                if glows {
                    let point = segment.ray.at(t);
                    let share = rival.map_or(1.0, |rival| rival.share(point));
                    *radiance += weight * length * medium.emitted(point) * share;
                }
            })
        });

        collide(flight, medium, collision, luggage)
    }

    /// One part collides, and is followed later; the other goes on.
    fn split(
        &mut self,
        segment: &Segment<'_>,
        mut flight: Flight,
        medium: &Medium,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) {
        self.glow(segment, medium, luggage);
        let (range, weight) = ((segment.a, segment.b), luggage.weight);
        let force = |stream: &mut _| transport::force(medium, segment.ray, range, weight, stream);
        let forced = self.context.stream.draw(Dimension::Flight, force);
        luggage.weight *= forced.passed;
        let Some((t, weight)) = forced.collision else { return };
        flight.chance = forced.chance;
        let landing = Some(Landing::new(flight, medium, t));
        let own = Path { splits: false, landing, ..luggage.own.clone() };
        parts.push(Part {
            walk: Walk::within(self.eye.scene, segment),
            luggage: luggage.part(weight, own),
            collision: Some((t, segment.medium)),
        });
    }

    /// The peak of a segment's phase function, where photons leave that to this path.
    fn leaves(&self, segment: &Segment<'_>, luggage: &Luggage<Path>) -> Option<&'s Peak> {
        let goes_on = self.eye.settings.max_events.allows(luggage.events) && luggage.own.seeks != Seeks::Emitted;
        self.eye.peak(segment.medium).filter(|_| goes_on)
    }

    /// Where photons leave the peak of a phase function to paths: by chance a part collides, and is followed later, while all of it goes on.
    fn stray(&mut self, segment: &Segment<'_>, medium: &Medium, luggage: &Luggage<Path>, parts: &mut Parts<'s, Path>) {
        let Some(peak) = self.leaves(segment, luggage) else { return };
        let mut part = luggage.clone();
        let Some(t) = self.fly_to_peak((segment, peak), medium, &mut part) else { return };

        // What goes on there carries this much: roulette comes before light is asked for.
        let mut carried = part.weight * medium.albedo_at(segment.ray.at(t)) * peak.share();
        let all = carried.max_element();
        if all <= 0.0 || !self.outlives(&mut carried, (part.own.share, true), segment.inside) {
            return;
        }
        part.weight *= carried.max_element() / all;
        parts.push(Part {
            walk: Walk::within(self.eye.scene, segment),
            luggage: part,
            collision: Some((t, segment.medium)),
        });
    }

    /// The flight to a collision that scatters by the peak of a phase function, if there is one by chance.
    fn fly_to_peak(
        &mut self,
        (segment, peak): (&Segment<'_>, &Peak),
        medium: &Medium,
        luggage: &mut Luggage<Path>,
    ) -> Option<f64> {
        let flight = Flight::new(segment, medium, luggage.weight);
        if !self.eye.settings.single_scattering.asks_lights() {
            self.light_equiangularly((segment, Some(peak)), &flight, luggage, |t| flight.flight_density(medium, t));
        }
        let (range, weight) = ((segment.a, segment.b), &mut luggage.weight);
        let Context { stream, tally, .. } = &mut *self.context;
        let t = stream.draw(Dimension::Flight, |stream| {
            transport::fly(medium, segment.ray, range, weight, stream, tally, |_, _, _| {})
        })?;
        luggage.own.landing = Some(Landing::new(flight, medium, t));
        Some(t)
    }

    /// Photons along a flight up to where it collides by chance: what passes a grey medium without collision has all of its weight, so what it
    /// gathers counts in full, and nothing is gathered from where little light arrives from.
    fn gather_by_chance(
        &mut self,
        maps: &VolumeMaps,
        (segment, peak): (&Segment<'_>, &Peak),
        medium: &Medium,
        luggage: &mut Luggage<Path>,
    ) -> ControlFlow<f64> {
        self.light_itself(segment, medium, luggage);
        let collision = self.fly_to_peak((segment, peak), medium, luggage);
        let (reach, counts) = self.reach(segment, luggage);
        if counts {
            let claim = Claim { pixel: self.context.pixel, weight: luggage.weight, components: luggage.own.gathered() };
            let flown = EyeSegment { b: collision.unwrap_or(segment.b), passed: true, ..reach };
            maps.gather(medium, flown, Some(claim), self.context.queue);
        }
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    /// What a medium emits, met by chance.
    fn glow(&mut self, segment: &Segment<'_>, medium: &Medium, luggage: &Luggage<Path>) {
        let (ray, range, weight) = (segment.ray, (segment.a, segment.b), luggage.weight);
        let rival = luggage.own.turn.rival(&self.eye.glows, segment.medium);
        let stream = &mut *self.context.stream;
        let radiance = match (medium.even_glow(), &rival) {
            _ if luggage.own.seeks == Seeks::Scattered => return,
            _ if matches!(medium.emission, Emission::None) => return,
            (Some(radiance), Some(rival)) => {
                // The share has no closed integral: one point, drawn as a collision.
                let collision = transport::force(medium, ray, range, weight, stream).collision;
                let Some((t, weight)) = collision else { return };
                let point = ray.at(t);
                weight * (1.0 - medium.albedo_at(point)) * radiance * rival.share(point)
            }
            _ => {
                let share = |p| rival.map_or(1.0, |rival| rival.share(p));
                weight * gather::emitted(medium, ray, range, || stream.uniform(), share)
            }
        };
        self.sample.radiance[luggage.own.component(luggage.events, false) as usize] += radiance;
    }

    /// Photons along a segment, by a beam query.
    fn gather(&mut self, maps: &VolumeMaps, segment: &Segment<'_>, medium: &Medium, luggage: &mut Luggage<Path>) {
        self.light_itself(segment, medium, luggage);
        let (reach, counts) = self.reach(segment, luggage);
        let claim = counts.then_some(Claim {
            pixel: self.context.pixel,
            weight: luggage.weight,
            components: luggage.own.gathered(),
        });
        luggage.weight *= maps.gather(medium, reach, claim, self.context.queue);
    }

    /// Photons along a segment, by point queries.
    fn march(&mut self, maps: &PointMaps, segment: &Segment<'_>, medium: &Medium, luggage: &mut Luggage<Path>) {
        self.light_itself(segment, medium, luggage);
        let (reach, counts) = self.reach(segment, luggage);
        if counts {
            let scene = self.eye.scene;
            let near = |position, radius, planes: &mut _| walls::near(scene, position, radius, false, planes);
            let Context { queue, stream, .. } = &mut *self.context;
            let marched = (medium, &reach, luggage.weight);
            let gathered = maps.gather(marched, &near, stream, &mut queue.marching, &mut queue.stats);
            for (component, radiance) in luggage.own.gathered().into_iter().zip(gathered) {
                self.sample.radiance[component as usize] += luggage.weight * radiance;
            }
        }
        luggage.weight *= medium.transmittance(medium.density.depth(segment.ray, segment.a, segment.b));
    }

    /// Light of a segment that no photon brings: what the medium emits and, if lights are asked for it, what is scattered once.
    fn light_itself(&mut self, segment: &Segment<'_>, medium: &Medium, luggage: &Luggage<Path>) {
        self.glow(segment, medium, luggage);
        let settings = &self.eye.settings;
        let asks = settings.single_scattering.asks_lights() && settings.max_events.allows(luggage.events);
        let asks = asks && luggage.own.seeks != Seeks::Emitted;
        if asks && medium.scatters() {
            let marcher = settings.marchers.map(|marchers| marchers[segment.medium as usize]);
            match marcher.zip(medium.density.support().clip(segment.ray, segment.a, segment.b)) {
                Some((marcher, (a, b))) if b.is_finite() => {
                    self.march_single(segment, medium, &marcher, (a, b), luggage);
                }
                _ => self.trace_single(segment, medium, luggage),
            }
        }
    }

    /// What is to be gathered along a segment, and whether any photon may count.
    fn reach(&self, segment: &Segment<'_>, luggage: &Luggage<Path>) -> (EyeSegment, bool) {
        // A photon's events, this scattering and those on the eye's side.
        let left = self.eye.settings.max_events.left_after(luggage.events + 1);
        let reach = EyeSegment {
            ray: *segment.ray,
            a: segment.a,
            b: segment.b,
            medium: segment.medium,
            region: self.eye.scene.region(segment.inside),
            solid: self.eye.scene.decisive_solid(segment.inside),
            max_events: left.map_or(0, Events::in_a_byte),
            from_camera: luggage.events == 0,
            passed: false,
            spread: luggage.own.diffuse,
        };
        (reach, left.is_some() && luggage.own.seeks != Seeks::Emitted)
    }
}

/// Ends a flight at its collision, if it has one.
fn collide(flight: Flight, medium: &Medium, collision: Option<f64>, luggage: &mut Luggage<Path>) -> ControlFlow<f64> {
    let Some(t) = collision else { return ControlFlow::Continue(()) };
    luggage.own.landing = Some(Landing::new(flight, medium, t));
    ControlFlow::Break(t)
}

impl Path {
    /// Where light goes that a medium scattered once on its way to the path, and all other.
    fn gathered(&self) -> [Component; 2] {
        match self.first {
            None => [Component::VolumeSingle, Component::VolumeMultiple],
            Some(First::Specular) => [Component::Specular; 2],
            Some(First::Diffuse) => [Component::Indirect; 2],
            Some(First::Medium) => [Component::VolumeMultiple; 2],
        }
    }
}
