//! Light that a medium scatters once, straight from lights, where all other light in media comes from photons.

use super::component::Component;
use super::{Context, Looking, Path, Sample};
use crate::gather::march::Marcher;
use crate::math::{Rgb, Stream, shares};
use crate::medium::Medium;
use crate::medium::phase::Peak;
use crate::transport::{self, Collision, Flight, Landing, Luggage, Parts, Segment};

impl Looking<'_, '_, '_> {
    /// Along a segment as the path tracer finds it: its first collision and no more.
    pub(super) fn trace_single(&mut self, segment: &Segment<'_>, medium: &Medium, luggage: &Luggage<Path>) {
        let mut flight = Flight::new(segment, medium, luggage.weight);
        let by_flight = |t| flight.certain(medium).flight_density(medium, t);
        self.light_equiangularly((segment, None), &flight, luggage, by_flight);

        // A collision in proportion to what arrives from there, and light asked for at it.
        let (ray, range, weight) = (segment.ray, (segment.a, segment.b), luggage.weight);
        let forced = transport::force(medium, ray, range, weight, self.context.stream);
        let Some((t, weight)) = forced.collision else { return };
        flight.chance = forced.chance;
        let landing = Landing::new(flight, medium, t);
        self.light_once(&collision((segment, medium), None, t), luggage.scattered(weight), landing);
    }

    /// At every place of a march from `a` to `b`.
    pub(super) fn march_single(
        &mut self,
        segment: &Segment<'_>,
        medium: &Medium,
        marcher: &Marcher,
        (a, b): (f64, f64),
        luggage: &Luggage<Path>,
    ) {
        let (ray, weight) = (segment.ray, luggage.weight);
        let flight = Flight::new(segment, medium, weight);
        let places = |t: f64| {
            let passed = medium.transmittance(medium.density.depth(ray, segment.a, t));
            marcher.places(medium, (shares(weight) * passed).element_sum()).max(f64::MIN_POSITIVE)
        };
        self.light_equiangularly((segment, None), &flight, luggage, places);

        // What the places' own light needs of the context is lent to the march.
        let mut march = std::mem::take(&mut self.context.queue.marching.march);
        let (eye, context) = (self.eye, &mut *self.context);
        let mut stream = context.stream.clone();
        let mut source = |t: f64, stream: &mut Stream| {
            let at = collision((segment, medium), None, t);
            let landing = Landing { flight: flight.clone(), t, density: places(t) };
            let mut sample = Sample::default();
            let weight = medium.extinction * medium.density.at(at.point);
            if weight.max_element() > 0.0 {
                let Context { queue, pixel, tally, .. } = &mut *context;
                let mut context = Context { stream, queue, pixel: *pixel, tally, parts: &mut Parts::new() };
                let mut looking = Looking { eye, sample: &mut sample, context: &mut context };
                looking.light_once(&at, luggage.scattered(weight), landing);
            }
            // All of it guides adaptive steps.
            let mut parts = [Rgb::ZERO; 1 + Component::ALL.len()];
            parts[0] = sample.radiance.iter().sum();
            parts[1..].copy_from_slice(&sample.radiance);
            parts
        };
        let line = (ray, segment.a, a, b);
        let [_, parts @ ..] = march.along(marcher, line, (medium, weight), &mut stream, &mut source);
        *self.context.stream = stream;
        self.context.queue.marching.march = march;
        for (radiance, part) in self.sample.radiance.iter_mut().zip(parts) {
            *radiance += weight * part;
        }
    }
}

/// A collision on a segment, by a part of its medium's phase function.
pub(super) fn collision<'w>(
    (segment, medium): (&'w Segment<'_>, &'w Medium),
    peak: Option<&'w Peak>,
    t: f64,
) -> Collision<'w> {
    Collision {
        point: segment.ray.at(t),
        direction: segment.ray.direction,
        t,
        medium,
        index: segment.medium,
        inside: segment.inside,
        peak,
    }
}

impl Luggage<Path> {
    /// This path with a collision behind it.
    fn scattered(&self, weight: Rgb) -> Luggage<Path> {
        let mut luggage = self.part(weight, self.own.scattered());
        luggage.events += 1;
        luggage
    }
}
