//! Where photons start: lights and glowing media, each drawn in proportion to its power.

use std::f64::consts::PI;

use crate::light::{Departure, Light};
use crate::math::{Bounds, Ray, Rgb, Stream, sampling};
use crate::scene::{Glow, Inside, Scene};

/// All sources of photons of a scene.
#[derive(Debug)]
pub struct Sources<'s> {
    scene: &'s Scene,
    sources: Vec<Source<'s>>,
    /// Running sums of the sources' shares of the power, ending in 1.
    cumulative: Vec<f64>,
}

#[derive(Debug)]
enum Source<'s> {
    /// A light, and the solids around it where they are the same for all of it.
    Light(u32, Option<Inside>),
    /// A glowing medium.
    Glow(&'s Glow),
}

/// A photon at its start, with the solids around it.
pub struct Start {
    /// The line it starts on.
    pub ray: Ray,
    /// Its power, if it were the only one.
    pub power: Rgb,
    /// The solids around.
    pub inside: Inside,
    /// Whether it comes from a light, not from a glowing medium.
    pub from_light: bool,
}

impl<'s> Sources<'s> {
    /// All sources with a power.
    pub fn new(scene: &'s Scene) -> Self {
        let mut sources = Vec::new();
        let mut powers = Vec::new();
        let boxes: Vec<Bounds> = scene.solids.iter().map(|solid| scene.geometry.bounds(solid.shape)).collect();
        for (index, light) in scene.lights.iter().enumerate() {
            let inside = match light {
                Light::Point(point) => Some(scene.inside(point.position)),
                Light::Spot(spot) => Some(scene.inside(spot.position)),
                Light::Area(area) if !boxes.iter().any(|solid| solid.overlaps(&area.bounds)) => Some(Inside::default()),
                _ => scene.solids.is_empty().then(Inside::default),
            };
            sources.push(Source::Light(index as u32, inside));
            powers.push(light.power(&scene.surroundings).element_sum());
        }
        for glow in &scene.glows {
            powers.push(glow.power());
            sources.push(Source::Glow(glow));
        }
        let total: f64 = powers.iter().sum();
        let mut sum = 0.0;
        let cumulative = powers
            .iter()
            .map(|power| {
                sum += power / total;
                sum
            })
            .collect();
        Sources { scene, sources: if total > 0.0 { sources } else { Vec::new() }, cumulative }
    }

    /// Whether nothing shines.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Draws a photon.
    pub fn start(&self, stream: &mut Stream) -> Option<Start> {
        let u = stream.uniform();
        let index = self.cumulative.partition_point(|&sum| sum <= u).min(self.sources.len().checked_sub(1)?);
        let share = self.cumulative[index] - if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let mut start = match &self.sources[index] {
            Source::Light(light, inside) => self.start_at_light(*light, inside.as_ref(), stream)?,
            Source::Glow(glow) => self.start_in(glow, stream)?,
        };
        start.power /= share;
        (start.power.max_element() > 0.0).then_some(start)
    }

    fn start_in(&self, glow: &Glow, stream: &mut Stream) -> Option<Start> {
        let (point, density) = glow.draw(stream);
        let (radiated, inside) = glow.radiated(self.scene, point)?;
        let direction = sampling::sphere(stream.uniform2()).normalize();
        Some(Start {
            ray: Ray::new(point, direction),
            power: radiated * (4.0 * PI / density),
            inside,
            from_light: false,
        })
    }

    fn start_at_light(&self, index: u32, inside: Option<&Inside>, stream: &mut Stream) -> Option<Start> {
        let light = &self.scene.lights[index as usize];
        let Departure { ray, mut power } = light.depart(&self.scene.geometry, &self.scene.surroundings, stream)?;
        if light.is_infinite() {
            // What it lost in the world's medium before it came near.
            if let Some(world) = self.scene.world {
                let medium = &self.scene.media[world as usize];
                let back = Ray::new(ray.origin, -ray.direction);
                power *= medium.transmittance(medium.density.depth(&back, 0.0, f64::INFINITY));
            }
            return Some(Start { ray, power, inside: Inside::default(), from_light: true });
        }
        let inside = inside.cloned().unwrap_or_else(|| self.scene.inside(ray.origin));
        Some(Start { ray, power, inside, from_light: true })
    }
}
