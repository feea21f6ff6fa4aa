use super::ellipsoid::bounds_about;
use crate::math::{Bounds, DAffine3, DVec3, Ray, sampling};
use crate::{Error, Result};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A sphere; closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    center: DVec3,
    radius: f64,
}

impl Sphere {
    /// The sphere of `radius` about `center`.
    ///
    /// # Errors
    /// When the radius is not positive or a number is not finite.
    pub fn new(center: DVec3, radius: f64) -> Result<Self> {
        if !center.is_finite() || !radius.is_finite() || radius <= 0.0 {
            return Err(Error::Scene(format!(
                "a sphere with center {center} and radius {radius}: expected finite numbers and a radius above 0"
            )));
        }
        Ok(Sphere { center, radius })
    }

    /// The centre in object space.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// The radius in object space.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// This, `by` further on.
    pub(super) fn moved(self, by: DVec3) -> Self {
        Sphere { center: self.center + by, ..self }
    }

    pub(super) fn bounds(&self, m: &DAffine3) -> Bounds {
        bounds_about(m.transform_point3(self.center), &DVec3::AXES.map(|a| m.transform_vector3(self.radius * a)))
    }

    /// The discriminant is taken from the distance between centre and ray, which does not cancel for
    /// far origins (Haines et al. 2019, "Precision improvements for ray/sphere intersection").
    pub(super) fn crossings(&self, ray: &Ray, visit: &mut impl FnMut(f64)) {
        let f = ray.origin - self.center;
        let a = ray.direction.length_squared();
        let b = -f.dot(ray.direction);
        let across = f + (b / a) * ray.direction;
        let discriminant = self.radius * self.radius - across.length_squared();
        if discriminant < 0.0 {
            return;
        }
        let q = b + (a * discriminant).sqrt().copysign(b);
        if q == 0.0 {
            return;
        }
        let (t0, t1) = ((f.length_squared() - self.radius * self.radius) / q, q / a);
        visit(t0.min(t1));
        visit(t0.max(t1));
    }

    pub(super) fn normal(&self, p: DVec3) -> DVec3 {
        (p - self.center).normalize_or(DVec3::Y)
    }

    /// Longitude about +y, from −z by way of −x, and latitude from −y, as shares of their ranges.
    pub(super) fn uv(&self, p: DVec3) -> [f64; 2] {
        let n = self.normal(p);
        [0.5 + n.x.atan2(n.z) * (0.5 * FRAC_1_PI), 1.0 - n.y.clamp(-1.0, 1.0).acos() * FRAC_1_PI]
    }

    /// ∂p/∂u and ∂p/∂v.
    pub(super) fn tangents(&self, p: DVec3) -> [DVec3; 2] {
        let n = self.normal(p);
        let across = n.x.hypot(n.z).max(f64::MIN_POSITIVE);
        let along = DVec3::new(-n.y * n.x / across, across, -n.y * n.z / across);
        [TAU * self.radius * DVec3::new(n.z, 0.0, -n.x), PI * self.radius * along]
    }

    pub(super) fn contains(&self, p: DVec3) -> bool {
        p.distance_squared(self.center) < self.radius * self.radius
    }

    pub(super) fn area(&self) -> f64 {
        4.0 * PI * self.radius * self.radius
    }

    pub(super) fn sample(&self, u: [f64; 2]) -> DVec3 {
        self.center + self.radius * sampling::sphere(u)
    }

    pub(super) fn closest(&self, p: DVec3) -> DVec3 {
        self.center + self.radius * self.normal(p)
    }
}
