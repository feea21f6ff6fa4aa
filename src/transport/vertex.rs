//! A vertex: where a path turns, and what is done with light there.

use super::events::Events;
use super::guide::DirectionGuide;
use super::shadow::{ShadowRay, transmit};
use super::surface::{Event, Interaction};
use crate::light::Receiver;
use crate::math::random::Dimension;
use crate::math::{DVec3, Rgb, Stream};
use crate::medium::Medium;
use crate::medium::phase::Peak;
use crate::scene::{Inside, Scene};
use crate::surface::{Lobe, Nature, Onward, Scattering, Side};

/// A collision with a medium.
#[derive(Clone, Copy, Debug)]
pub struct Collision<'w> {
    /// The point of the collision.
    pub point: DVec3,
    /// The unit direction of arrival.
    pub direction: DVec3,
    /// Its parameter on the ray that leads there.
    pub t: f64,
    /// The medium.
    pub medium: &'w Medium,
    /// The medium's index in [`Scene::media`].
    pub index: u32,
    /// The solids around.
    pub inside: &'w Inside,
    /// The part of the medium's phase function that counts here; `None`: all of it.
    pub peak: Option<&'w Peak>,
}

impl Collision<'_> {
    /// The share of light that goes on from here.
    pub fn albedo(&self) -> Rgb {
        let albedo = self.medium.albedo_at(self.point);
        self.peak.map_or(albedo, |peak| albedo * peak.share())
    }

    /// The phase function by channel for light that goes on along `o`, and the density per steradian with which [`Collision::sample`] draws that.
    pub fn phase(&self, o: DVec3) -> (Rgb, f64) {
        match self.peak {
            None => self.medium.phase.value(self.point, self.direction, o),
            Some(peak) => {
                let value = peak.value(self.direction, o);
                (Rgb::splat(value), value / peak.share())
            }
        }
    }

    /// A direction in which light goes on, with its density per steradian; weights `weight` for channels that are turned otherwise.
    pub fn sample(&self, weight: &mut Rgb, stream: &mut Stream) -> (DVec3, f64) {
        match self.peak {
            None => self.medium.phase.sample(self.point, self.direction, weight, stream),
            Some(peak) => peak.sample(self.direction, stream),
        }
    }
}

/// A view of where a path turns: two words, that only borrow.
#[derive(Clone, Copy, Debug)]
pub enum Vertex<'v> {
    /// On a surface.
    Surface(&'v Interaction),
    /// On a matte surface, from which paths go on as a guide says.
    Guided(&'v Interaction, &'v DirectionGuide<'v>),
    /// In a medium.
    Medium(&'v Collision<'v>),
}

impl Vertex<'_> {
    /// Its point.
    #[inline]
    pub fn point(&self) -> DVec3 {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => at.point,
            Vertex::Medium(at) => at.point,
        }
    }

    /// The surface, if it is on one.
    #[inline]
    pub fn surface(&self) -> Option<&Interaction> {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => Some(at),
            Vertex::Medium(_) => None,
        }
    }

    /// Who asks for light here: where a surface only reflects, it gets none from beyond.
    #[inline]
    pub fn receiver(&self) -> Receiver {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) if at.bsdf.boundary(&at.incidence).is_none() => {
                Receiver { point: at.point, normal: at.incidence.shading_normal }
            }
            _ => Receiver::around(self.point()),
        }
    }

    /// What happened to what went on so.
    #[inline]
    pub fn event(&self, onward: &Onward) -> Event {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => at.event(onward),
            Vertex::Medium(_) => Event::Scattered,
        }
    }

    /// Whether light that is mirrored or refracted here may become a caustic.
    #[inline]
    pub fn casts_caustics(&self) -> bool {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => at.caustics.casts,
            Vertex::Medium(_) => true,
        }
    }

    /// How it spreads light.
    #[inline]
    pub fn nature(&self) -> Nature {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => at.bsdf.nature(),
            Vertex::Medium(_) => Nature::Diffuse,
        }
    }

    /// The share of light that is not absorbed.
    #[inline]
    pub fn albedo(&self) -> Rgb {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => at.bsdf.albedo(&at.incidence),
            Vertex::Medium(at) => at.albedo(),
        }
    }

    /// Tells `part` what goes on along `o`, part by part: see [`Bsdf::toward`](crate::surface::Bsdf::toward). A medium
    /// sends one part: albedo times phase function, the density of which is the phase function.
    #[inline]
    pub fn toward(
        &self,
        o: DVec3,
        side: Side,
        both: bool,
        weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        match self {
            Vertex::Surface(at) => at.bsdf.toward(&at.incidence, o, side, both, weight, stream, part),
            Vertex::Guided(at, guide) => {
                let ahead = Rgb::splat(guide.density(o));
                let guided = |weight: Rgb, sent: Scattering| part(weight, Scattering { ahead, ..sent });
                at.bsdf.toward(&at.incidence, o, side, both, weight, stream, guided);
            }
            Vertex::Medium(at) => {
                let (phase, density) = at.phase(o);
                part(weight, Scattering { value: at.medium.albedo_at(at.point) * phase, ahead: Rgb::splat(density) });
            }
        }
    }

    /// Draws where light goes on, and weights `weight` for it: see [`Bsdf::onward`](crate::surface::Bsdf::onward). `survives`
    /// applies the factor that surface or medium leave, with roulette or without; in a medium before a direction is drawn.
    pub fn onward(
        &self,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
        survives: impl FnOnce(&mut Rgb, Rgb, &mut Stream) -> bool,
    ) -> Option<Onward> {
        match self {
            Vertex::Surface(at) => stream.draw(Dimension::Direction, |stream| {
                at.bsdf.onward(&at.incidence, side, lobe, weight, stream, survives)
            }),
            Vertex::Guided(at, guide) => {
                let direction = stream.draw(Dimension::Direction, |stream| guide.direction(stream.uniform2()));
                let (mut value, density) = (Rgb::ZERO, guide.density(direction));
                at.bsdf.toward(&at.incidence, direction, side, false, Rgb::ONE, stream, |weight, sent| {
                    value += weight * sent.value;
                });
                let goes_on = density > 0.0 && value.max_element() > 0.0 && survives(weight, value / density, stream);
                goes_on.then_some(Onward { direction, density })
            }
            Vertex::Medium(at) => {
                if !survives(weight, at.albedo(), stream) {
                    return None;
                }
                let (direction, density) = stream.draw(Dimension::Direction, |stream| at.sample(weight, stream));
                Some(Onward { direction, density })
            }
        }
    }

    /// Multiplies `weight` by an unbiased estimate of what passes to here from the point of a surface with this normal, or without
    /// one, that lies `distance` away along `o`, through `most` sheets. Returns their number: see [`transmit`].
    pub fn transmit(
        &self,
        scene: &Scene,
        (o, distance, normal): (DVec3, f64, DVec3),
        most: Events,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> u64 {
        match self {
            Vertex::Surface(at) | Vertex::Guided(at, _) => {
                let (ray, inside) = at.departure(o);
                let shadow = ShadowRay::new(ray.origin, at.point, o, distance, normal);
                transmit(scene, shadow, &inside, most, weight, stream)
            }
            Vertex::Medium(at) => {
                let shadow = ShadowRay::new(at.point, at.point, o, distance, normal);
                transmit(scene, shadow, at.inside, most, weight, stream)
            }
        }
    }
}
