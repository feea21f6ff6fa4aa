use super::{Arrival, Departure, DrawnFrom};
use crate::math::{DVec3, Frame, Ray, Rgb, Stream, sampling};
use std::f64::consts::PI;

/// A cone with a soft edge: full inside the inner half-angle, none outside the outer one, smoothstep in
/// cos θ between.
#[derive(Clone, Copy, Debug)]
pub struct SoftCone {
    /// The unit direction of its axis.
    pub axis: DVec3,
    /// 1 − cos of the inner half-angle.
    pub inner: f64,
    /// 1 − cos of the outer half-angle.
    pub outer: f64,
}

impl SoftCone {
    /// From half-angles in radians.
    pub fn new(axis: DVec3, inner: f64, outer: f64) -> Self {
        // 1 − cos x = 2 sin² (x/2), without cancellation for narrow cones.
        let below_one = |angle: f64| 2.0 * (0.5 * angle).sin().powi(2);
        SoftCone { axis, inner: below_one(inner), outer: below_one(outer) }
    }

    /// The share of the axis' intensity in a unit direction.
    pub fn share(&self, direction: DVec3) -> f64 {
        let v = if direction.dot(self.axis) > 0.0 { 0.5 * (direction - self.axis).length_squared() } else { 1.0 };
        if v <= self.inner {
            1.0
        } else if v >= self.outer || direction.dot(self.axis) <= 0.0 {
            0.0
        } else {
            let x = (self.outer - v) / (self.outer - self.inner);
            x * x * (3.0 - 2.0 * x)
        }
    }

    /// ∫ share dω = 2π[(1 − cos inner) + (cos inner − cos outer)/2].
    pub fn solid_angle(&self) -> f64 {
        PI * (self.inner + self.outer)
    }

    /// The solid angle inside the outer half-angle.
    pub fn outer_solid_angle(&self) -> f64 {
        2.0 * PI * self.outer
    }

    /// A direction uniform inside the outer half-angle.
    pub fn sample(&self, u: [f64; 2]) -> DVec3 {
        Frame::around(self.axis).to_world(sampling::cone(self.outer, u)).normalize()
    }
}

/// A point that shines into a cone.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Where it is.
    pub position: DVec3,
    /// W/sr on the axis, per channel.
    pub intensity: Rgb,
    /// The directions it shines in.
    pub cone: SoftCone,
}

impl Spot {
    pub(super) fn power(&self) -> Rgb {
        self.cone.solid_angle() * self.intensity
    }

    pub(super) fn importance(&self, p: DVec3) -> f64 {
        self.arrive(p).map_or(0.0, |arrival| arrival.radiance.element_sum())
    }

    pub(super) fn arrive(&self, p: DVec3) -> Option<Arrival> {
        Arrival::from_point(self.position, p, |travel| {
            let share = self.cone.share(travel);
            (share > 0.0).then(|| share * self.intensity)
        })
    }

    pub(super) fn depart(&self, stream: &mut Stream) -> Departure {
        let direction = self.cone.sample(stream.uniform2());
        let power = self.cone.share(direction) * self.cone.outer_solid_angle() * self.intensity;
        Departure { ray: Ray::new(self.position, direction), power, spread: DrawnFrom::Other }
    }
}
