//! The walk of light or of an eye path, from one surface to the next, through the media between.

use std::ops::ControlFlow;

use super::roulette::survive;
use crate::geometry::{Cluster, Hit};
use crate::math::{DVec3, Ray, Rgb, Stream, error_bound};
use crate::scene::{Inside, Scene};
use crate::surface::{Dielectric, Facet, Lambert, Lobe, Material, Mirror, Rough, reflectance};

/// A photon or an eye path on its way.
#[derive(Clone)]
pub struct Walk<'s> {
    scene: &'s Scene,
    /// The line it is on.
    pub ray: Ray,
    /// How far along that line it has come.
    pub t: f64,
    /// Crossings up to here have been taken.
    crossed: f64,
    /// Nothing beyond is of interest.
    limit: f64,
    /// There is no surface so near to the ray's origin.
    clear: f64,
    /// Whether it has yet to find out on which side of a boundary it starts.
    starts: bool,
    /// The solids around it.
    pub inside: Inside,
    cluster: Cluster,
}

/// A stretch of a ray in one medium.
pub struct Segment<'a> {
    /// The ray.
    pub ray: &'a Ray,
    /// Where on it the stretch begins.
    pub a: f64,
    /// Where it ends; perhaps at infinity.
    pub b: f64,
    /// The medium: an index into [`Scene::media`].
    pub medium: u32,
    /// The solids around.
    pub inside: &'a Inside,
}

/// A surface that a ray meets and that shines.
pub struct Crossing<'a> {
    /// The ray.
    pub ray: &'a Ray,
    /// Where.
    pub hit: &'a Hit,
    /// The light: an index into [`Scene::lights`].
    pub light: u32,
}

/// What wants to know what a walk passes.
pub trait Visitor {
    /// How far light gets from here at most in a medium (an index into [`Scene::media`]), if that is known beforehand: surfaces
    /// beyond are not looked for. Where it is finite, the next segment begins here, and light does not pass that point on it.
    fn farthest(&mut self, _medium: u32) -> f64 {
        f64::INFINITY
    }
    /// Passes through a medium; may end the walk inside.
    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()>;
    /// Meets a surface that shines.
    fn crossing(&mut self, crossing: &Crossing<'_>);
}

/// Why a walk pauses.
#[allow(clippy::large_enum_variant, reason = "lives for one step on the stack; a box would allocate at every surface")]
pub enum Stop {
    /// The visitor ended it.
    Ended,
    /// At a surface that does something.
    Surface(Interaction),
    /// There is nothing more on the line.
    Escaped,
}

/// A surface that does something to light, and what is around it.
#[derive(Clone, Debug)]
pub struct Interaction {
    /// Where.
    pub point: DVec3,
    /// The direction of arrival.
    pub direction: DVec3,
    /// The unit geometric normal on the side of arrival.
    pub normal: DVec3,
    /// The unit shading normal on the side of arrival.
    pub shading_normal: DVec3,
    /// How far along the ray.
    pub t: f64,
    /// The placed shape.
    pub shape: u32,
    /// What it does.
    pub reflection: Reflection,
    offset: f64,
    before: Inside,
    after: Inside,
}

/// What a surface does.
#[derive(Clone, Copy, Debug)]
pub enum Reflection {
    /// Reflects diffusely.
    Lambert(Lambert),
    /// Reflects specularly.
    Mirror(Mirror),
    /// Reflects and refracts: the indices on this side and beyond.
    Dielectric(Rgb, Rgb),
    /// The same, by facets.
    Rough(Rough),
}

/// Where light goes on from a surface.
#[derive(Clone, Copy, Debug)]
pub struct Onward {
    /// The unit direction of travel.
    pub direction: DVec3,
    /// Its density per steradian; 0 where light from there cannot be asked for.
    pub density: f64,
}

/// Whether a walk carries the power of photons or the importance of an eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Power, which refraction leaves alone.
    Light,
    /// Radiance, which refraction from index η₁ into η₂ multiplies by (η₁/η₂)².
    Eye,
}

impl<'s> Walk<'s> {
    /// A walk that starts with `ray`, inside these solids.
    pub fn new(scene: &'s Scene, ray: Ray, inside: Inside) -> Self {
        let cluster = Cluster::default();
        Walk { scene, ray, t: 0.0, crossed: 0.0, limit: f64::INFINITY, clear: 0.0, starts: false, inside, cluster }
    }

    /// The same from a light or a camera, which may stand on a boundary of `inside`: then the direction
    /// decides on which side the walk starts.
    pub fn start(scene: &'s Scene, ray: Ray, inside: Inside) -> Self {
        let starts = !scene.solids.is_empty();
        let crossed = if starts { -error_bound(&ray, 0.0) } else { 0.0 };
        Walk { starts, crossed, ..Walk::new(scene, ray, inside) }
    }

    /// The same, ending at parameter `limit`: what lies beyond is escape.
    pub fn until(self, limit: f64) -> Self {
        Walk { limit, ..self }
    }

    /// Goes on to the next surface that does something, through boundaries that do not.
    pub fn advance(&mut self, visitor: &mut impl Visitor) -> Stop {
        if self.t < self.clear
            && let Some(medium) = self.scene.medium(&self.inside)
        {
            let segment = Segment { ray: &self.ray, a: self.t, b: self.clear, medium, inside: &self.inside };
            if visitor.segment(&segment).is_break() {
                return Stop::Ended;
            }
            (self.t, self.crossed) = (self.clear, self.clear);
        }
        loop {
            let medium = self.scene.medium(&self.inside).filter(|&m| !self.scene.media[m as usize].is_clear());
            let farthest = medium.filter(|_| !self.starts).map_or(f64::INFINITY, |medium| visitor.farthest(medium));
            let reached = self.t + farthest;
            // Surfaces that coincide with one within reach are looked for, too.
            let limit = self.limit.min(reached + 2.0 * error_bound(&self.ray, reached));
            self.scene.geometry.intersect(&self.ray, self.crossed, limit, &mut self.cluster);
            if std::mem::take(&mut self.starts) {
                self.crossed = 0.0;
                let here = error_bound(&self.ray, 0.0);
                if self.cluster.nearest().is_some_and(|hit| hit.t <= here) {
                    self.inside = self.scene.cross(&self.inside, &self.cluster, self.ray.direction);
                    self.crossed = self.cluster.hits().last().map_or(0.0, |hit| hit.t) + here;
                    continue;
                }
            }
            let met = self.cluster.nearest().map(|hit| hit.t);
            let end = met.map_or(limit, |t| t.max(self.t));
            if let Some(medium) = medium {
                let segment = Segment { ray: &self.ray, a: self.t, b: end, medium, inside: &self.inside };
                if visitor.segment(&segment).is_break() {
                    return Stop::Ended;
                }
            }
            if met.is_none() {
                if limit >= self.limit {
                    return Stop::Escaped;
                }
                // By rounding only.
                (self.t, self.crossed) = (end, end.next_down());
                continue;
            }
            for hit in self.cluster.hits() {
                if let Some(light) = self.scene.surfaces[hit.id as usize].light {
                    visitor.crossing(&Crossing { ray: &self.ray, hit, light });
                }
            }
            self.t = end;
            let after = self.scene.cross(&self.inside, &self.cluster, self.ray.direction);
            if let Some((hit, reflection)) = self.reflection(&after) {
                return Stop::Surface(self.interaction(hit, reflection, after));
            }
            self.crossed = self.cluster.hits().last().map_or(end, |hit| hit.t) + error_bound(&self.ray, end);
            self.inside = after;
        }
    }

    /// What the surfaces at one place do together: an opaque one decides; else a change of index.
    fn reflection(&self, after: &Inside) -> Option<(Hit, Reflection)> {
        let mut boundary = None;
        for hit in self.cluster.hits() {
            match self.scene.surfaces[hit.id as usize].material {
                Material::Lambert(lambert) => return Some((*hit, Reflection::Lambert(lambert))),
                Material::Mirror(mirror) => return Some((*hit, Reflection::Mirror(mirror))),
                Material::Dielectric(dielectric) if boundary.is_none() => boundary = Some((*hit, dielectric.roughness)),
                Material::Dielectric(_) | Material::None => {}
            }
        }
        let (hit, alpha) = boundary?;
        let (from, to) = (self.scene.index(&self.inside), self.scene.index(after));
        let reflection =
            if alpha > 0.0 { Reflection::Rough(Rough { from, to, alpha }) } else { Reflection::Dielectric(from, to) };
        (from != to).then_some((hit, reflection))
    }

    fn interaction(&self, hit: Hit, reflection: Reflection, after: Inside) -> Interaction {
        let direction = self.ray.direction;
        let facing = if hit.normal.dot(direction) <= 0.0 { 1.0 } else { -1.0 };
        let mut shading_normal = facing * hit.shading_normal;
        if shading_normal.dot(direction) >= 0.0 {
            shading_normal = facing * hit.normal;
        }
        Interaction {
            point: self.ray.at(hit.t),
            direction,
            normal: facing * hit.normal,
            shading_normal,
            t: hit.t,
            shape: hit.id,
            reflection,
            offset: 4.0 * error_bound(&self.ray, hit.t),
            before: self.inside.clone(),
            after,
        }
    }

    /// Turns into `direction` at parameter `t` of its line, in the open.
    pub fn turn(&mut self, t: f64, direction: DVec3) {
        self.ray = Ray::new(self.ray.at(t), direction);
        self.t = 0.0;
        self.crossed = 0.0;
        self.clear = (self.clear - t).max(0.0);
    }

    /// How far the nearest surface is from parameter `t` of the line, at least.
    pub fn clearance(&self, t: f64) -> f64 {
        (self.clear - t).max(0.0)
    }

    /// Tells that there is no surface within `clear` of the ray's origin: it need not be looked for so near.
    /// Segments end there, too.
    pub fn clear(&mut self, clear: f64) {
        // Distances are exact to roundings of the coordinates.
        self.clear = (clear * (1.0 - 1e-6) - error_bound(&self.ray, clear)).max(0.0);
    }

    /// Leaves a surface along `direction`, on the side that points to.
    pub fn leave(&mut self, at: &Interaction, direction: DVec3) {
        let (ray, inside) = at.departure(direction);
        self.ray = ray;
        self.inside = inside;
        self.t = 0.0;
        self.crossed = 0.0;
        self.clear = 0.0;
    }
}

impl Interaction {
    /// A ray that leaves along `direction`, and the solids around its start.
    pub fn departure(&self, direction: DVec3) -> (Ray, Inside) {
        let outward = direction.dot(self.normal) >= 0.0;
        let (offset, inside) = if outward { (self.offset, &self.before) } else { (-self.offset, &self.after) };
        (Ray::new(self.point + offset * self.normal, direction), inside.clone())
    }

    /// Draws where light goes on from a surface; weights `weight` for it, with roulette. `None` ends the walk.
    pub fn scatter(&self, side: Side, weight: &mut Rgb, stream: &mut Stream) -> Option<DVec3> {
        self.scatter_and(side, None, weight, stream, survive).map(|onward| onward.direction)
    }

    /// As [`Interaction::scatter`], the roulette left to the caller. What a refracting boundary does is left to chance, or
    /// given as `lobe`.
    pub fn scatter_always(
        &self,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<Onward> {
        self.scatter_and(side, lobe, weight, stream, |weight, factor, _| {
            *weight *= factor;
            true
        })
    }

    fn scatter_and(
        &self,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
        survive: impl Fn(&mut Rgb, Rgb, &mut Stream) -> bool,
    ) -> Option<Onward> {
        let specular = |direction| Onward { direction, density: 0.0 };
        match self.reflection {
            Reflection::Lambert(lambert) => {
                let direction = lambert.sample(self.shading_normal, stream);
                if direction.dot(self.normal) <= 0.0 {
                    return None;
                }
                let factor = lambert.reflectance * self.adjoint(side, self.shading_normal, direction);
                let density = lambert.density(self.shading_normal, direction);
                survive(weight, factor, stream).then_some(Onward { direction, density })
            }
            Reflection::Mirror(mirror) => {
                let normal = self.specular_normal(|normal| Some(Mirror::reflect(self.direction, normal)), true);
                let direction = Mirror::reflect(self.direction, normal);
                let factor = mirror.reflectance * self.adjoint(side, normal, direction);
                survive(weight, factor, stream).then_some(specular(direction))
            }
            Reflection::Dielectric(from, to) => self.refract((from, to), side, lobe, weight, stream).map(specular),
            Reflection::Rough(rough) => {
                let leaving = rough.sample(self.direction, self.shading_normal, lobe, weight, stream)?;
                let direction = leaving.direction;
                let scale = self.radiance_scale(&rough, direction)?;
                *weight *= self.adjoint(side, self.shading_normal, direction);
                if side == Side::Eye {
                    *weight *= scale;
                }
                Some(Onward { direction, density: leaving.density })
            }
        }
    }

    /// By what the radiance of an eye path is multiplied that a rough boundary sends along `direction`: (η₁/η₂)² if that is
    /// through it. `None` where the normals do not agree which side that is.
    fn radiance_scale(&self, rough: &Rough, direction: DVec3) -> Option<Rgb> {
        let through = direction.dot(self.shading_normal) < 0.0;
        let ratio = if through { rough.from / rough.to } else { Rgb::ONE };
        (through == (direction.dot(self.normal) < 0.0)).then_some(ratio * ratio)
    }

    /// What the facets of a rough boundary send to an eye of light from `direction`, f |cos θ|, with weights and densities: see
    /// [`Rough::facets`].
    pub fn facets(
        &self,
        rough: &Rough,
        direction: DVec3,
        both: bool,
        weight: Rgb,
        stream: &mut Stream,
        mut sent: impl FnMut(Rgb, Facet),
    ) {
        let Some(scale) = self.radiance_scale(rough, direction) else { return };
        rough.facets((self.direction, self.shading_normal), direction, both, weight, stream, |weight, facet| {
            sent(weight, Facet { value: scale * facet.value, ..facet });
        });
    }

    /// Shading normals break the symmetry of light and eye: |i·s| |o·g| / (|i·g| |o·s|) for photons that arrive
    /// along i and leave along o, with the normal g and the shading normal s (Veach 1996).
    pub fn adjoint(&self, side: Side, shading_normal: DVec3, direction: DVec3) -> f64 {
        if side == Side::Eye || shading_normal == self.normal {
            return 1.0;
        }
        let arriving = self.direction.dot(shading_normal) / self.direction.dot(self.normal);
        let leaving = direction.dot(self.normal) / direction.dot(shading_normal);
        (arriving * leaving).abs()
    }

    /// The shading normal where its outcome lies on the right side of the surface, else the geometric one.
    fn specular_normal(&self, outcome: impl Fn(DVec3) -> Option<DVec3>, reflected: bool) -> DVec3 {
        let right = outcome(self.shading_normal).is_none_or(|d| (d.dot(self.normal) > 0.0) == reflected);
        if right { self.shading_normal } else { self.normal }
    }

    /// The part of each channel that a smooth boundary between these indices reflects, and about which normal.
    pub fn reflected(&self, (from, to): (Rgb, Rgb)) -> (DVec3, Rgb) {
        let normal = self.specular_normal(|normal| Some(Mirror::reflect(self.direction, normal)), true);
        let cos = -self.direction.dot(normal);
        (normal, reflectance(cos, from, to))
    }

    fn refract(
        &self,
        (from, to): (Rgb, Rgb),
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<DVec3> {
        let (normal, reflected) = self.reflected((from, to));
        if Lobe::take(lobe, reflected, weight, stream) == Lobe::Reflected {
            let direction = Mirror::reflect(self.direction, normal);
            *weight *= self.adjoint(side, normal, direction);
            return Some(direction);
        }
        let channel = Dielectric::channel(from, to, weight, stream)?;
        let (from, to) = (from[channel], to[channel]);
        let bend = |normal| Dielectric::refract(self.direction, normal, from, to);
        let normal = self.specular_normal(bend, false);
        let direction = bend(normal)?;
        *weight *= self.adjoint(side, normal, direction);
        if side == Side::Eye {
            *weight *= (from / to).powi(2);
        }
        Some(direction)
    }
}
