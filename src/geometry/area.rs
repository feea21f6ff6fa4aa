//! Points drawn on surfaces: by area, or for the light they send to another point.

use std::f64::consts::TAU;

use super::{Geometry, Placed};
use crate::math::{DVec3, Frame, sampling};

/// A point drawn on a surface.
#[derive(Clone, Copy, Debug)]
pub struct AreaSample {
    /// The point in the world.
    pub point: DVec3,
    /// The unit geometric normal, pointing out.
    pub normal: DVec3,
    /// The density per area in the world.
    pub pdf: f64,
}

/// A point of a surface drawn as seen from another point.
#[derive(Clone, Copy, Debug)]
pub struct DirectionSample {
    /// The point in the world.
    pub point: DVec3,
    /// The unit geometric normal there, pointing out.
    pub normal: DVec3,
    /// The unit direction to it.
    pub direction: DVec3,
    /// The distance to it.
    pub distance: f64,
    /// The density per solid angle at the other point.
    pub pdf: f64,
}

impl Geometry {
    /// The area of a shape in the world.
    pub fn area(&self, id: u32) -> f64 {
        self.placed[id as usize].area()
    }

    /// A point on a shape. Uniform by world area for quads, disks, boxes and under similarity
    /// transforms; otherwise uniform by area in object space, which `pdf` accounts for.
    pub fn sample_area(&self, id: u32, u: [f64; 2]) -> AreaSample {
        let (point, normal, pdf) = self.placed[id as usize].sample_area(u);
        AreaSample { point, normal, pdf }
    }

    /// The density, per world area, with which [`Geometry::sample_area`] draws a point whose unit normal is `normal`.
    pub fn pdf_area(&self, id: u32, normal: DVec3) -> f64 {
        self.placed[id as usize].pdf_area(normal)
    }

    /// A point on a shape for the light it sends towards `from`: for what is a sphere in the world, seen
    /// from outside, uniform in the cone it subtends (Shirley, Wang and Zimmerman 1996); else
    /// [`Geometry::sample_area`] with its density per solid angle, d²/|cos θ| times that per area. `None`
    /// when the point drawn is seen edge-on or coincides with `from`.
    pub fn sample_toward(&self, id: u32, from: DVec3, u: [f64; 2]) -> Option<DirectionSample> {
        if let Some(cone) = Seen::of(&self.placed[id as usize], from) {
            return Some(cone.sample(from, u));
        }
        let AreaSample { point, normal, pdf } = self.sample_area(id, u);
        let distance = point.distance(from);
        let direction = (point - from) / distance;
        let pdf = pdf * distance * distance / direction.dot(normal).abs();
        (pdf.is_finite() && direction.is_finite()).then_some(DirectionSample {
            point,
            normal,
            direction,
            distance,
            pdf,
        })
    }

    /// The density, per solid angle at `from`, with which [`Geometry::sample_toward`] draws the point that lies so far
    /// in `direction` and has this unit normal; 0 for the far side of a sphere seen from outside.
    pub fn pdf_toward(&self, id: u32, from: DVec3, direction: DVec3, distance: f64, normal: DVec3) -> f64 {
        let cosine = direction.dot(normal);
        if let Some(cone) = Seen::of(&self.placed[id as usize], from) {
            return if cosine <= 0.0 { cone.pdf() } else { 0.0 };
        }
        let pdf = self.pdf_area(id, normal) * distance * distance / cosine.abs();
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

/// The cone under which a sphere is seen from a point outside.
struct Seen {
    center: DVec3,
    radius: f64,
    /// To the centre.
    distance: f64,
    sin2_max: f64,
    /// 1 − cos of the half-angle.
    one_minus_cos_max: f64,
}

impl Seen {
    fn of(placed: &Placed, from: DVec3) -> Option<Self> {
        let (center, radius) = placed.world_sphere()?;
        let distance = center.distance(from);
        if distance <= radius {
            return None;
        }
        let sine = radius / distance;
        let sin2_max = sine * sine;
        // cos from (d − r)(d + r), which keeps its digits close to the surface.
        let cos_max = ((distance - radius) * (distance + radius)).sqrt() / distance;
        Some(Seen { center, radius, distance, sin2_max, one_minus_cos_max: sin2_max / (1.0 + cos_max) })
    }

    fn pdf(&self) -> f64 {
        (TAU * self.one_minus_cos_max).recip()
    }

    fn sample(&self, from: DVec3, u: [f64; 2]) -> DirectionSample {
        let frame = Frame::around((self.center - from) / self.distance);
        let local = sampling::cone(self.one_minus_cos_max, u);
        // ---- the nearer intersection; no difference of close numbers, whatever the sphere's size
        let w = u[0] * self.one_minus_cos_max;
        let sin2 = w * (2.0 - w);
        let half_chord = (1.0 - sin2 / self.sin2_max).max(0.0).sqrt();
        let power = (self.distance - self.radius) * (self.distance + self.radius);
        let distance = power / (self.distance * local.z + self.radius * half_chord);
        // ---- the angle between the normal and the way back to `from`
        let sine = distance / self.radius;
        let cosine = sin2 / self.sin2_max.sqrt() + local.z * half_chord;
        let normal = frame.to_world(DVec3::new(sine * local.x, sine * local.y, -cosine)).normalize();
        let direction = frame.to_world(local).normalize();
        DirectionSample { point: self.center + self.radius * normal, normal, direction, distance, pdf: self.pdf() }
    }
}
