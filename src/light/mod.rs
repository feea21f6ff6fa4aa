//! Where light comes from: one file a light.
//!
//! Lights of no size, and lights at infinity, are not part of the geometry. Everything else that
//! shines is a shape that rays can meet: emissive shapes, spheres for point lights with a radius, and
//! discs, which emit but block nothing, for spot lights and bounded beams with a size.
//!
//! Which of them is asked for light is a choice by what each may bring: one by one where they are few, by a tree over
//! [`Emitters`] where they are many. A mesh that shines takes part by its triangles then.

mod area;
mod directional;
mod emitters;
mod environment;
mod extent;
mod goniometric;
mod lanes;
mod point;
mod profile;
mod receiver;
mod sky;
mod spot;
mod tree;

pub use area::{Area, Directivity, Sides};
pub use directional::Directional;
pub(crate) use directional::cone_radiance;
pub(crate) use emitters::Along;
pub use emitters::{Emitter, Emitters};
pub use environment::Environment;
pub use goniometric::Goniometric;
pub use point::Point;
pub use profile::Profile;
pub use receiver::Receiver;
pub use sky::Sky;
pub use spot::{SoftCone, Spot};

use crate::geometry::Geometry;
use crate::math::{DVec3, Ray, Rgb, Stream};

/// One of the lights a scene file can name.
#[derive(Clone, Debug)]
pub enum Light {
    /// From one point, with one intensity in all directions.
    Point(Point),
    /// A cone, from one point.
    Spot(Spot),
    /// From one point, as a lamp was measured to.
    Goniometric(Goniometric),
    /// From infinity, or a round beam, in one direction or a narrow cone of them.
    Directional(Directional),
    /// From infinity, all around.
    Environment(Environment),
    /// From the surface of a shape.
    Area(Area),
}

/// Light that could arrive at a point, if nothing is in its way.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// From the point to the light.
    pub direction: DVec3,
    /// How far the light is; infinite for lights at infinity.
    pub distance: f64,
    /// The radiance that leaves the light towards the point; for lights of no size the irradiance on a
    /// plane facing it.
    pub radiance: Rgb,
    /// The density of the direction per steradian; 1 for lights of no size.
    pub density: f64,
    /// Whether a ray that starts at the point could meet the light by chance.
    pub has_size: bool,
    /// The outward normal of the light's surface; against the direction for lights without one.
    pub normal: DVec3,
}

impl Arrival {
    /// At `p` from a light without size; `intensity` is told the direction of travel, and is `None` where none is sent.
    fn from_point(position: DVec3, p: DVec3, intensity: impl FnOnce(DVec3) -> Option<Rgb>) -> Option<Arrival> {
        let distance = position.distance(p);
        let direction = (position - p) / distance;
        let intensity = if distance > 0.0 { intensity(-direction)? } else { return None };
        Some(Arrival {
            direction,
            distance,
            radiance: intensity / (distance * distance),
            density: 1.0,
            has_size: false,
            normal: -direction,
        })
    }
}

/// A photon at its start.
#[derive(Clone, Copy, Debug)]
pub struct Departure {
    /// Where it starts and whither.
    pub ray: Ray,
    /// The power it stands for: that of its light, if all were drawn alike.
    pub power: Rgb,
    /// How it was drawn.
    pub spread: DrawnFrom,
}

/// How a photon's start was drawn, where another might be drawn in its place with the same power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DrawnFrom {
    /// From its point in all directions alike.
    Sphere,
    /// From its point with density cos θ/π about this normal.
    Cosine(DVec3),
    /// In its direction, anywhere on a disc that faces it before the scene's bounding sphere.
    Disc,
    /// In some other way, from which no other start can be drawn.
    Other,
}

/// A sphere around everything that light from infinity can reach.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings {
    /// The sphere's centre.
    pub center: DVec3,
    /// The sphere's radius.
    pub radius: f64,
}

impl Light {
    /// The power it sends into the scene; of lights at infinity, through the scene's bounding sphere.
    pub fn power(&self, surroundings: &Surroundings) -> Rgb {
        match self {
            Light::Point(light) => light.power(),
            Light::Spot(light) => light.power(),
            Light::Goniometric(light) => light.power(),
            Light::Directional(light) => light.power(surroundings),
            Light::Environment(light) => light.power(surroundings),
            Light::Area(light) => light.power(),
        }
    }

    /// How much light it might send to `p`, roughly; 0 only if it sends none at all.
    pub fn importance(&self, p: DVec3) -> f64 {
        match self {
            Light::Point(light) => light.importance(p),
            Light::Spot(light) => light.importance(p),
            Light::Goniometric(light) => light.importance(p),
            Light::Directional(light) => light.importance(p),
            Light::Environment(light) => light.importance(),
            Light::Area(light) => light.importance(p),
        }
    }

    /// Light that could arrive at `p`; of a mesh from this triangle, or from anywhere.
    pub fn arrive(&self, geometry: &Geometry, triangle: Option<u32>, p: DVec3, stream: &mut Stream) -> Option<Arrival> {
        match self {
            Light::Point(light) => light.arrive(p),
            Light::Spot(light) => light.arrive(p),
            Light::Goniometric(light) => light.arrive(p),
            Light::Directional(light) => light.arrive(p, stream),
            Light::Environment(light) => light.arrive(stream),
            Light::Area(light) => light.arrive(geometry, triangle, p, stream),
        }
    }

    /// A photon, drawn in proportion to power.
    pub fn depart(&self, geometry: &Geometry, surroundings: &Surroundings, stream: &mut Stream) -> Option<Departure> {
        match self {
            Light::Point(light) => Some(light.depart(stream)),
            Light::Spot(light) => Some(light.depart(stream)),
            Light::Goniometric(light) => Some(light.depart(stream)),
            Light::Directional(light) => Some(light.depart(surroundings, stream)),
            Light::Environment(light) => light.depart(surroundings, stream),
            Light::Area(light) => light.depart(geometry, stream),
        }
    }

    /// The radiance that a ray which leaves the scene along `direction` sees.
    pub fn escaping(&self, direction: DVec3) -> Rgb {
        match self {
            Light::Environment(light) => light.radiance(direction),
            Light::Directional(light) => light.escaping(direction),
            _ => Rgb::ZERO,
        }
    }

    /// The density per steradian with which [`Light::arrive`] draws a direction that leaves the scene.
    pub fn escaping_density(&self, direction: DVec3) -> f64 {
        match self {
            Light::Environment(light) => light.density(direction),
            Light::Directional(light) => light.escaping_density(direction),
            _ => 0.0,
        }
    }

    /// Whether it shines from infinity.
    pub fn is_infinite(&self) -> bool {
        match self {
            Light::Environment(_) => true,
            Light::Directional(light) => light.beam.is_none(),
            _ => false,
        }
    }

    /// Whether its light thins with the square of the distance, however narrow its cone: not that from infinity, nor that of
    /// beams.
    fn thins(&self) -> bool {
        match self {
            Light::Point(_) | Light::Spot(_) | Light::Goniometric(_) => true,
            Light::Area(light) => !matches!(light.profile, Directivity::Beam(..)),
            Light::Directional(_) | Light::Environment(_) => false,
        }
    }

    /// Whether it lights a cone or a round beam alone.
    pub fn is_beam(&self) -> bool {
        match self {
            Light::Spot(_) => true,
            Light::Area(light) => !matches!(light.profile, Directivity::Diffuse(_)),
            Light::Directional(light) => light.beam.is_some(),
            Light::Point(_) | Light::Goniometric(_) | Light::Environment(_) => false,
        }
    }

    /// Multiplies what a light at infinity sends, channel by channel.
    pub fn dim(&mut self, factor: Rgb) {
        match self {
            Light::Environment(light) => light.dim(factor),
            Light::Directional(light) => light.irradiance *= factor,
            Light::Point(_) | Light::Spot(_) | Light::Goniometric(_) | Light::Area(_) => {}
        }
    }

    /// What a scene file calls its kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Light::Point(_) => "point",
            Light::Spot(_) => "spot",
            Light::Goniometric(_) => "profile",
            Light::Directional(_) => "directional",
            Light::Environment(_) => "environment",
            Light::Area(_) => "emission",
        }
    }

    /// Whether a ray can meet it by chance.
    pub fn has_size(&self) -> bool {
        match self {
            Light::Point(_) | Light::Spot(_) | Light::Goniometric(_) => false,
            Light::Directional(light) => light.has_size(),
            Light::Environment(_) | Light::Area(_) => true,
        }
    }
}
