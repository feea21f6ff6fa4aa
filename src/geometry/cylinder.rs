use super::ellipsoid::bounds_about;
use crate::math::{Bounds, DAffine3, DVec2, DVec3, Frame, Ray, choose, sampling};
use crate::{Error, Result};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A circular cylinder, closed if it has caps. Its primitives are the side (0), the cap at the base
/// (1) and the cap at the top (2).
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    base: DVec3,
    frame: Frame,
    height: f64,
    radius: f64,
    caps: bool,
}

/// The curved face.
pub(super) const SIDE: u32 = 0;
/// The flat face at the base.
pub(super) const BASE: u32 = 1;
/// The flat face at the top.
pub(super) const TOP: u32 = 2;

impl Cylinder {
    /// The cylinder of `radius` about the segment from `base` to `top`.
    ///
    /// # Errors
    /// When the ends coincide, the radius is not positive or a number is not finite.
    pub fn new(base: DVec3, top: DVec3, radius: f64, caps: bool) -> Result<Self> {
        let axis = top - base;
        match axis.try_normalize() {
            Some(z) if base.is_finite() && radius.is_finite() && radius > 0.0 => {
                Ok(Cylinder { base, frame: Frame::around(z), height: axis.length(), radius, caps })
            }
            _ => Err(Error::Scene(format!(
                "a cylinder from base {base} to top {top} with radius {radius}: \
                 expected finite numbers, ends that differ and a radius above 0"
            ))),
        }
    }

    /// The centre of the base, two radii at right angles, and the axis from base to top.
    pub(super) fn axes(&self) -> (DVec3, [DVec3; 2], DVec3) {
        (self.base, [self.radius * self.frame.x, self.radius * self.frame.y], self.height * self.frame.z)
    }

    /// This, `by` further on.
    pub(super) fn moved(self, by: DVec3) -> Self {
        Cylinder { base: self.base + by, ..self }
    }

    pub(super) fn bounds(&self, m: &DAffine3) -> Bounds {
        let (base, radii, axis) = self.axes();
        let radii = radii.map(|a| m.transform_vector3(a));
        let end = |p: DVec3| bounds_about(m.transform_point3(p), &radii);
        end(base).union(end(base + axis))
    }

    pub(super) fn is_closed(&self) -> bool {
        self.caps
    }

    /// With caps the cylinder is the overlap of two intervals, of the infinite cylinder and of the
    /// slab between the caps, so that every entry has its exit, even through the rim.
    pub(super) fn crossings(&self, ray: &Ray, visit: &mut impl FnMut(f64, u32)) {
        let o = self.frame.to_local(ray.origin - self.base);
        let d = self.frame.to_local(ray.direction);
        let Some((s0, s1)) = self.side_interval(o, d) else { return };
        if !self.caps {
            for t in [s0, s1] {
                let z = o.z + t * d.z;
                if t.is_finite() && z >= 0.0 && z <= self.height {
                    visit(t, SIDE);
                }
            }
            return;
        }
        let (c0, c1, first, last) = if d.z == 0.0 {
            if o.z < 0.0 || o.z > self.height {
                return;
            }
            (f64::NEG_INFINITY, f64::INFINITY, SIDE, SIDE)
        } else {
            let (base, top) = (-o.z / d.z, (self.height - o.z) / d.z);
            if d.z > 0.0 { (base, top, BASE, TOP) } else { (top, base, TOP, BASE) }
        };
        let (t0, enter) = if c0 > s0 { (c0, first) } else { (s0, SIDE) };
        let (t1, leave) = if c1 < s1 { (c1, last) } else { (s1, SIDE) };
        if t0 <= t1 {
            visit(t0, enter);
            visit(t1, leave);
        }
    }

    /// Where the ray, in the frame's coordinates, is inside the infinite cylinder; as for the sphere,
    /// the discriminant comes from the distance between axis and ray.
    fn side_interval(&self, o: DVec3, d: DVec3) -> Option<(f64, f64)> {
        let (o, d, r2) = (o.truncate(), d.truncate(), self.radius * self.radius);
        let a = d.length_squared();
        if a == 0.0 {
            return (o.length_squared() <= r2).then_some((f64::NEG_INFINITY, f64::INFINITY));
        }
        let b = -o.dot(d);
        let discriminant = r2 - (o + (b / a) * d).length_squared();
        if discriminant < 0.0 {
            return None;
        }
        let q = b + (a * discriminant).sqrt().copysign(b);
        if q == 0.0 {
            return Some((0.0, 0.0));
        }
        let (t0, t1) = ((o.length_squared() - r2) / q, q / a);
        Some((t0.min(t1), t0.max(t1)))
    }

    pub(super) fn normal(&self, p: DVec3, face: u32) -> DVec3 {
        match face {
            BASE => -self.frame.z,
            TOP => self.frame.z,
            _ => {
                let q = self.frame.to_local(p - self.base);
                self.frame.to_world(q.with_z(0.0)).normalize_or(self.frame.x)
            }
        }
    }

    /// The share of a full turn, and of the height on the side or of the radius on a cap.
    pub(super) fn uv(&self, p: DVec3, face: u32) -> [f64; 2] {
        let q = self.frame.to_local(p - self.base);
        let across = if face == SIDE { q.z / self.height } else { q.x.hypot(q.y) / self.radius };
        [0.5 + q.y.atan2(q.x) * (0.5 * FRAC_1_PI), across]
    }

    /// ∂p/∂u and ∂p/∂v.
    pub(super) fn tangents(&self, p: DVec3, face: u32) -> [DVec3; 2] {
        let q = self.frame.to_local(p - self.base).truncate();
        let out = q.normalize_or(DVec2::X) * self.radius;
        let across =
            if face == SIDE { self.height * self.frame.z } else { out.x * self.frame.x + out.y * self.frame.y };
        [TAU * (q.x * self.frame.y - q.y * self.frame.x), across]
    }

    pub(super) fn contains(&self, p: DVec3) -> bool {
        let q = self.frame.to_local(p - self.base);
        self.caps && q.z >= 0.0 && q.z <= self.height && q.truncate().length_squared() <= self.radius * self.radius
    }

    /// The areas of side and one cap; the latter 0 without caps.
    pub(super) fn areas(&self) -> (f64, f64) {
        (TAU * self.radius * self.height, if self.caps { PI * self.radius * self.radius } else { 0.0 })
    }

    pub(super) fn area(&self) -> f64 {
        let (side, cap) = self.areas();
        side + 2.0 * cap
    }

    pub(super) fn sample(&self, [u, v]: [f64; 2]) -> (DVec3, u32) {
        let (side, cap) = self.areas();
        let (part, u) = choose([side, cap, cap], self.area(), u).map_or((0, u), |choice| (choice.index, choice.rest));
        let (face, z) = match part {
            0 => {
                let (s, c) = (TAU * v).sin_cos();
                let q = DVec3::new(self.radius * c, self.radius * s, self.height * u);
                return (self.base + self.frame.to_world(q), SIDE);
            }
            1 => (BASE, 0.0),
            _ => (TOP, self.height),
        };
        let (x, y) = sampling::disc([u, v]);
        (self.base + self.frame.to_world(DVec3::new(self.radius * x, self.radius * y, z)), face)
    }
}
