//! Where photons start: lights and glowing media, each drawn in proportion to its power.

use std::f64::consts::PI;

use crate::light::{Departure, Light};
use crate::math::{Bounds, DVec3, Ray, Rgb, Stream, sampling};
use crate::scene::{Inside, Scene};

/// All sources of photons of a scene.
#[derive(Debug)]
pub struct Sources<'s> {
    scene: &'s Scene,
    sources: Vec<Source>,
    /// Running sums of the sources' shares of the power, ending in 1.
    cumulative: Vec<f64>,
}

#[derive(Debug)]
enum Source {
    /// A light, and the solids around it where they are the same for all of it.
    Light(u32, Option<Inside>),
    /// A glowing medium.
    Glow(Box<Glow>),
}

/// A glowing medium in a box: points are drawn from cells in proportion to what was found there.
#[derive(Debug)]
struct Glow {
    medium: u32,
    bounds: Bounds,
    /// Running sums over the cells, x fastest, ending in 1.
    cumulative: Vec<f64>,
    /// An estimate of its power.
    power: f64,
}

/// Cells along each edge of a glowing medium's box.
const CELLS: usize = 24;
/// Points tried in each cell.
const TRIES: usize = 4;
/// The share of points drawn evenly over the box, so that no place is missed.
const EVEN: f64 = 0.1;

/// A photon at its start, with the solids around it.
pub struct Start {
    /// The line it starts on.
    pub ray: Ray,
    /// Its power, if it were the only one.
    pub power: Rgb,
    /// The solids around.
    pub inside: Inside,
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
        for (index, medium) in scene.media.iter().enumerate() {
            if medium.glows()
                && let Some(glow) = Glow::new(scene, index as u32)
            {
                powers.push(glow.power);
                sources.push(Source::Glow(Box::new(glow)));
            }
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
            Source::Glow(glow) => glow.start(self.scene, stream)?,
        };
        start.power /= share;
        (start.power.max_element() > 0.0).then_some(start)
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
            return Some(Start { ray, power, inside: Inside::default() });
        }
        let inside = inside.cloned().unwrap_or_else(|| self.scene.inside(ray.origin));
        Some(Start { ray, power, inside })
    }
}

impl Glow {
    /// `None` where the medium is nowhere, or has no end.
    fn new(scene: &Scene, medium: u32) -> Option<Glow> {
        let support = scene.media[medium as usize].density.support();
        let mut bounds = Bounds::EMPTY;
        if scene.world == Some(medium) {
            bounds = support;
        }
        for solid in scene.solids.iter().filter(|solid| solid.medium == Some(medium)) {
            bounds = bounds.union(scene.geometry.bounds(solid.shape).intersection(support));
        }
        if bounds.is_empty() || !bounds.size().is_finite() {
            return None;
        }
        let mut glow = Glow { medium, bounds, cumulative: Vec::with_capacity(CELLS.pow(3)), power: 0.0 };
        let mut stream = Stream::new(0, crate::math::random::Purpose::Map, medium as u64, 0);
        let mut sum = 0.0;
        for cell in 0..CELLS.pow(3) {
            for _ in 0..TRIES {
                let p = glow.point_in(cell, std::array::from_fn(|_| stream.uniform()));
                sum += glow.radiated(scene, p).map_or(0.0, |(power, _)| power.element_sum());
            }
            glow.cumulative.push(sum);
        }
        if sum <= 0.0 {
            return None;
        }
        let cells = CELLS.pow(3) as f64;
        for (cell, share) in glow.cumulative.iter_mut().enumerate() {
            *share = (1.0 - EVEN) * *share / sum + EVEN * (cell + 1) as f64 / cells;
        }
        let size = glow.bounds.size();
        glow.power = sum / (cells * TRIES as f64) * size.x * size.y * size.z;
        Some(glow)
    }

    fn point_in(&self, cell: usize, u: [f64; 3]) -> DVec3 {
        let index = DVec3::new((cell % CELLS) as f64, (cell / CELLS % CELLS) as f64, (cell / CELLS / CELLS) as f64);
        self.bounds.min + (index + DVec3::from_array(u)) / CELLS as f64 * self.bounds.size()
    }

    /// 4π σ_a L_e per volume at `p` and the solids around; `None` outside of the medium.
    fn radiated(&self, scene: &Scene, p: DVec3) -> Option<(Rgb, Inside)> {
        let medium = &scene.media[self.medium as usize];
        let density = medium.density.at(p);
        if density <= 0.0 {
            return None;
        }
        let inside = scene.inside(p);
        (scene.medium(&inside) == Some(self.medium)).then(|| (medium.emitted(p) * (4.0 * PI * density), inside))
    }

    fn start(&self, scene: &Scene, stream: &mut Stream) -> Option<Start> {
        let u = stream.uniform();
        let cell = self.cumulative.partition_point(|&sum| sum <= u).min(self.cumulative.len() - 1);
        let share = self.cumulative[cell] - if cell == 0 { 0.0 } else { self.cumulative[cell - 1] };
        let p = self.point_in(cell, std::array::from_fn(|_| stream.uniform()));
        let (radiated, inside) = self.radiated(scene, p)?;
        let size = self.bounds.size() / CELLS as f64;
        let direction = sampling::sphere(stream.uniform2()).normalize();
        Some(Start { ray: Ray::new(p, direction), power: radiated * (size.x * size.y * size.z / share), inside })
    }
}
