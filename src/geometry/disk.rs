use super::ellipsoid::bounds_about;
use crate::math::{Bounds, DAffine3, DVec2, DVec3, Frame, Ray, sampling};
use crate::{Error, Result};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A flat disk; open. Out is the side of its normal.
#[derive(Clone, Copy, Debug)]
pub struct Disk {
    center: DVec3,
    frame: Frame,
    radius: f64,
}

impl Disk {
    /// The disk of `radius` about `center`, perpendicular to `normal` (of any length).
    ///
    /// # Errors
    /// When the radius is not positive, the normal zero or a number is not finite.
    pub fn new(center: DVec3, normal: DVec3, radius: f64) -> Result<Self> {
        match normal.try_normalize() {
            Some(n) if center.is_finite() && radius.is_finite() && radius > 0.0 => {
                Ok(Disk { center, frame: Frame::around(n), radius })
            }
            _ => Err(Error::Scene(format!(
                "a disk with center {center}, normal {normal} and radius {radius}: \
                 expected finite numbers, a normal that is not zero and a radius above 0"
            ))),
        }
    }

    /// The centre and two radii at right angles.
    pub(super) fn radii(&self) -> (DVec3, [DVec3; 2]) {
        (self.center, [self.radius * self.frame.x, self.radius * self.frame.y])
    }

    /// This, `by` further on.
    pub(super) fn moved(self, by: DVec3) -> Self {
        Disk { center: self.center + by, ..self }
    }

    pub(super) fn bounds(&self, m: &DAffine3) -> Bounds {
        let (center, radii) = self.radii();
        bounds_about(m.transform_point3(center), &radii.map(|a| m.transform_vector3(a)))
    }

    pub(super) fn crossings(&self, ray: &Ray, visit: &mut impl FnMut(f64)) {
        let cosine = ray.direction.dot(self.frame.z);
        if cosine == 0.0 {
            return;
        }
        let from = ray.origin - self.center;
        let t = -from.dot(self.frame.z) / cosine;
        if (from + t * ray.direction).length_squared() <= self.radius * self.radius {
            visit(t);
        }
    }

    pub(super) fn normal(&self) -> DVec3 {
        self.frame.z
    }

    /// The share of a full turn and the share of the radius.
    pub(super) fn uv(&self, p: DVec3) -> [f64; 2] {
        let q = self.frame.to_local(p - self.center);
        [0.5 + q.y.atan2(q.x) * (0.5 * FRAC_1_PI), q.x.hypot(q.y) / self.radius]
    }

    /// ∂p/∂u and ∂p/∂v.
    pub(super) fn tangents(&self, p: DVec3) -> [DVec3; 2] {
        let q = self.frame.to_local(p - self.center).truncate();
        let out = q.normalize_or(DVec2::X) * self.radius;
        [TAU * (q.x * self.frame.y - q.y * self.frame.x), out.x * self.frame.x + out.y * self.frame.y]
    }

    pub(super) fn area(&self) -> f64 {
        PI * self.radius * self.radius
    }

    pub(super) fn sample(&self, u: [f64; 2]) -> DVec3 {
        let (x, y) = sampling::disc(u);
        self.center + self.radius * (x * self.frame.x + y * self.frame.y)
    }
}
