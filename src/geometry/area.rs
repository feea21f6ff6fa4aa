//! Points drawn on surfaces, or on one triangle of a mesh: by area, or for the light they send to another point.

use std::f64::consts::TAU;

use super::{Geometry, Placed, Shape};
use crate::math::{DVec3, Frame, sampling};

/// What points are drawn on: a shape, or a triangle of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patch {
    /// The placed shape.
    pub shape: u32,
    /// The triangle, where it is not all of the shape: what [`Hit::primitive`](super::Hit::primitive) counts.
    pub triangle: Option<u32>,
}

impl From<u32> for Patch {
    /// All of a shape.
    fn from(shape: u32) -> Self {
        Patch { shape, triangle: None }
    }
}

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

    /// The triangles of a mesh; `None` for other shapes.
    pub fn triangles(&self, id: u32) -> Option<u32> {
        match self.placed[id as usize].shape() {
            Shape::Mesh(mesh) => Some(mesh.triangle_count() as u32),
            _ => None,
        }
    }

    /// The corners of a triangle of a mesh, in the world, and its outward unit normal.
    #[inline(never)]
    pub fn triangle(&self, id: u32, triangle: u32) -> Option<([DVec3; 3], DVec3)> {
        self.placed[id as usize].triangle(triangle)
    }

    /// A point on a patch. Uniform by world area for triangles, quads, disks, boxes and under similarity
    /// transforms; otherwise uniform by area in object space, which `pdf` accounts for.
    #[inline]
    pub fn sample_area(&self, patch: impl Into<Patch>, u: [f64; 2]) -> AreaSample {
        let Patch { shape, triangle } = patch.into();
        if let Some((corners, normal)) = triangle.and_then(|triangle| self.triangle(shape, triangle)) {
            return AreaSample { point: point_in(corners, u), normal, pdf: area_of(corners).recip() };
        }
        let (point, normal, pdf) = self.placed[shape as usize].sample_area(u);
        AreaSample { point, normal, pdf }
    }

    /// The density, per world area, with which [`Geometry::sample_area`] draws a point whose unit normal is `normal`.
    #[inline]
    pub fn pdf_area(&self, patch: impl Into<Patch>, normal: DVec3) -> f64 {
        let Patch { shape, triangle } = patch.into();
        match triangle.and_then(|triangle| self.triangle(shape, triangle)) {
            Some((corners, _)) => area_of(corners).recip(),
            None => self.placed[shape as usize].pdf_area(normal),
        }
    }

    /// A point on a patch for the light it sends towards `from`: for what is a sphere in the world, seen
    /// from outside, uniform in the cone it subtends (Shirley, Wang and Zimmerman 1996); else
    /// [`Geometry::sample_area`] with its density per solid angle, d²/|cos θ| times that per area. `None`
    /// when the point drawn is seen edge-on or coincides with `from`.
    pub fn sample_toward(&self, patch: impl Into<Patch>, from: DVec3, u: [f64; 2]) -> Option<DirectionSample> {
        let patch = patch.into();
        if let Some(cone) = Seen::of(&self.placed[patch.shape as usize], from) {
            return Some(cone.sample(from, u));
        }
        let AreaSample { point, normal, pdf } = self.sample_area(patch, u);
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
    pub fn pdf_toward(
        &self,
        patch: impl Into<Patch>,
        from: DVec3,
        direction: DVec3,
        distance: f64,
        normal: DVec3,
    ) -> f64 {
        let patch = patch.into();
        let cosine = direction.dot(normal);
        if let Some(cone) = Seen::of(&self.placed[patch.shape as usize], from) {
            return if cosine <= 0.0 { cone.pdf() } else { 0.0 };
        }
        let pdf = self.pdf_area(patch, normal) * distance * distance / cosine.abs();
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

/// The area of a triangle.
pub(crate) fn area_of([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// A point of a triangle, uniform by area.
pub(super) fn point_in([a, b, c]: [DVec3; 3], [u, v]: [f64; 2]) -> DVec3 {
    let r = u.sqrt();
    a + r * (1.0 - v) * (b - a) + r * v * (c - a)
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
    #[inline]
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

    #[inline]
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
