use super::{Arrival, Departure, DrawnFrom, SoftCone};
use crate::geometry::{AreaSample, Geometry, Patch};
use crate::math::{Bounds, DVec3, Frame, Ray, Rgb, Stream, error_bound, sampling};
use std::f64::consts::PI;

/// The surface of a shape that shines.
#[derive(Clone, Copy, Debug)]
pub struct Area {
    /// The placed shape.
    pub shape: u32,
    /// How its radiance varies over directions.
    pub profile: Directivity,
    /// The sides that shine.
    pub sides: Sides,
    /// Its area in the world.
    pub area: f64,
    /// A box around it.
    pub bounds: Bounds,
    /// Its power, all channels together.
    power: f64,
    /// The radius of a disc of this area.
    radius: f64,
    /// The sine of its cone's half-angle.
    sine: f64,
}

/// How radiance varies over directions.
#[derive(Clone, Copy, Debug)]
pub enum Directivity {
    /// One radiance in all directions, as from a diffuse emitter.
    Diffuse(Rgb),
    /// A spot light's intensity on the axis and cone, spread over a disc: L = I share/(A cos θ), so that
    /// the intensity far away is the point's.
    Spot(Rgb, SoftCone),
    /// A round beam: the same radiance within a cone (inner = outer) about the disc's normal.
    Beam(Rgb, SoftCone),
}

/// The sides of a shape that shine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sides {
    /// Away from the inside.
    Out,
    /// Towards the inside.
    In,
    /// Both sides: the area that shines is twice the shape's.
    Both,
}

impl Sides {
    /// Whether light leaves on the side with this cosine to the outward normal.
    fn shine(self, cos: f64) -> bool {
        match self {
            Sides::Out => cos > 0.0,
            Sides::In => cos < 0.0,
            Sides::Both => cos != 0.0,
        }
    }

    /// How many they are.
    pub fn count(self) -> f64 {
        if self == Sides::Both { 2.0 } else { 1.0 }
    }
}

impl Area {
    /// A shape of this area and with this box around it, that shines.
    pub fn new(shape: u32, (profile, sides): (Directivity, Sides), area: f64, bounds: Bounds) -> Self {
        let sine = match profile {
            Directivity::Diffuse(_) => 1.0,
            Directivity::Spot(_, cone) | Directivity::Beam(_, cone) => (cone.outer * (2.0 - cone.outer)).sqrt(),
        };
        let mut light = Area { shape, profile, sides, area, bounds, power: 0.0, radius: (area / PI).sqrt(), sine };
        light.power = light.power().element_sum();
        light
    }

    /// The radiance that leaves a point with outward normal `normal` along `direction`.
    pub fn radiance(&self, normal: DVec3, direction: DVec3) -> Rgb {
        let cos = normal.dot(direction);
        if !self.sides.shine(cos) {
            return Rgb::ZERO;
        }
        match self.profile {
            Directivity::Diffuse(radiance) => radiance,
            Directivity::Spot(intensity, cone) => intensity * (cone.share(direction) / (self.area * cos.abs())),
            Directivity::Beam(radiance, cone) => radiance * cone.share(direction),
        }
    }

    /// W per channel.
    pub fn power(&self) -> Rgb {
        match self.profile {
            Directivity::Diffuse(radiance) => radiance * (PI * self.area * self.sides.count()),
            Directivity::Spot(intensity, cone) => intensity * cone.solid_angle(),
            Directivity::Beam(radiance, cone) => radiance * (PI * cone.outer * (2.0 - cone.outer) * self.area),
        }
    }

    pub(super) fn importance(&self, p: DVec3) -> f64 {
        let nearest = p.clamp(self.bounds.min, self.bounds.max).distance_squared(p);
        match self.profile {
            // Inside its own box a shape is about as far as its size: the irradiance is then π times the radiance, that of a
            // sky of the same.
            Directivity::Diffuse(_) => self.power / (4.0 * PI * nearest).max(self.area),
            Directivity::Spot(_, cone) | Directivity::Beam(_, cone) => {
                // Dark for certain only where not even the disc's rim reaches.
                let offset = p - self.bounds.center();
                let along = offset.dot(cone.axis);
                let reach = if cone.outer >= 1.0 {
                    f64::INFINITY
                } else {
                    along * self.sine / (1.0 - cone.outer) + self.radius
                };
                let aside = (offset - along * cone.axis).length();
                if along <= 0.0 || aside > reach {
                    return 0.0;
                }
                self.power / (cone.outer_solid_angle() * nearest).max(self.area)
            }
        }
    }

    /// How far from `p`, against a direction of travel, the disc of a beam is met.
    fn toward_disc(&self, p: DVec3, travel: DVec3, axis: DVec3) -> Option<f64> {
        let offset = p - self.bounds.center();
        let distance = offset.dot(axis) / travel.dot(axis);
        let aside = (offset - distance * travel).length();
        (distance > 0.0 && aside <= self.radius).then_some(distance)
    }

    /// What light is asked of: all of the shape, or a triangle.
    fn patch(&self, triangle: Option<u32>) -> Patch {
        Patch { shape: self.shape, triangle }
    }

    #[inline]
    pub(super) fn arrive(
        &self,
        geometry: &Geometry,
        triangle: Option<u32>,
        p: DVec3,
        stream: &mut Stream,
    ) -> Option<Arrival> {
        if let Directivity::Beam(radiance, cone) = self.profile {
            let travel = cone.sample(stream.uniform2());
            let distance = self.toward_disc(p, travel, cone.axis)?;
            let density = 1.0 / cone.outer_solid_angle();
            let normal = cone.axis;
            return Some(Arrival { direction: -travel, distance, radiance, density, has_size: true, normal });
        }
        let sample = geometry.sample_toward(self.patch(triangle), p, stream.uniform2())?;
        let radiance = self.radiance(sample.normal, -sample.direction);
        (radiance.max_element() > 0.0).then_some(Arrival {
            direction: sample.direction,
            distance: sample.distance,
            radiance,
            density: sample.pdf,
            has_size: true,
            normal: sample.normal,
        })
    }

    /// The density per steradian at `from` with which [`super::Light::arrive`] draws `direction`, in which the shape, or this
    /// triangle, is so far away and has this unit normal.
    #[inline]
    pub fn density(
        &self,
        geometry: &Geometry,
        triangle: Option<u32>,
        from: DVec3,
        (direction, distance): (DVec3, f64),
        normal: DVec3,
    ) -> f64 {
        match self.profile {
            Directivity::Beam(_, cone) => 1.0 / cone.outer_solid_angle(),
            _ => geometry.pdf_toward(self.patch(triangle), from, direction, distance, normal),
        }
    }

    /// A point drawn by area, from all of the shape or a triangle.
    pub fn sample(&self, geometry: &Geometry, triangle: Option<u32>, u: [f64; 2]) -> AreaSample {
        geometry.sample_area(self.patch(triangle), u)
    }

    /// The density per area with which [`Area::sample`] draws a point that has this unit normal.
    pub fn pdf(&self, geometry: &Geometry, triangle: Option<u32>, normal: DVec3) -> f64 {
        geometry.pdf_area(self.patch(triangle), normal)
    }

    pub(super) fn depart(&self, geometry: &Geometry, stream: &mut Stream) -> Option<Departure> {
        let point = geometry.sample_area(self.shape, stream.uniform2());
        let (direction, power) = match self.profile {
            Directivity::Diffuse(radiance) => {
                let outward = match self.sides {
                    Sides::Out => point.normal,
                    Sides::In => -point.normal,
                    Sides::Both if stream.uniform() < 0.5 => point.normal,
                    Sides::Both => -point.normal,
                };
                let local = sampling::cosine_hemisphere(stream.uniform2());
                let direction = Frame::around(outward).to_world(local).normalize();
                (direction, radiance * (PI * self.sides.count() / point.pdf))
            }
            Directivity::Spot(intensity, cone) => {
                let direction = cone.sample(stream.uniform2());
                let weight = cone.share(direction) * cone.outer_solid_angle() / (self.area * point.pdf);
                (direction, intensity * weight)
            }
            Directivity::Beam(radiance, cone) => {
                let direction = cone.sample(stream.uniform2());
                let cos = direction.dot(cone.axis);
                (direction, radiance * (cos * cone.outer_solid_angle() / point.pdf))
            }
        };
        let side = if direction.dot(point.normal) >= 0.0 { point.normal } else { -point.normal };
        let at = Ray::new(point.point, direction);
        let origin = point.point + side * error_bound(&at, 0.0).max(error_bound(&at, self.bounds.diagonal()));
        let spread = match self.profile {
            Directivity::Diffuse(_) => DrawnFrom::Cosine(side),
            Directivity::Spot(..) | Directivity::Beam(..) => DrawnFrom::Other,
        };
        Some(Departure { ray: Ray::new(origin, direction), power, spread })
    }
}
