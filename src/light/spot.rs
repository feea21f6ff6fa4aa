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

    /// Where a ray's line lies inside the cone around an apex, from one parameter to another: all of it for cones of a right angle or
    /// more, `None` where it passes by.
    ///
    /// With v from the apex to the line, f = v·axis, p = v − f axis and the half-angle θ, it is where f sin θ ≥ |p| cos θ.
    pub fn chord(&self, apex: DVec3, ray: &Ray) -> Option<(f64, f64)> {
        if self.outer >= 1.0 {
            return Some((f64::NEG_INFINITY, f64::INFINITY));
        }
        let (cos2, sin2) = ((1.0 - self.outer).powi(2), self.outer * (2.0 - self.outer));
        let split = |v: DVec3| {
            let along = v.dot(self.axis);
            (along, v - along * self.axis)
        };
        // a t² + 2 b t + c ≥ 0, from where the line is nearest to the apex: there products cancel least.
        let foot = (apex - ray.origin).dot(ray.direction);
        let (way, from) = (split(ray.direction), split(ray.at(foot) - apex));
        let product = |(f, p): (f64, DVec3), (g, q): (f64, DVec3)| sin2 * f * g - cos2 * p.dot(q);
        let (a, b, c) = (product(way, way), product(way, from), product(from, from));
        let squared = b * b - a * c;
        let middle = if a < 0.0 { from.0 - b / a * way.0 } else { 1.0 };
        if squared < 0.0 && a < 0.0 || middle <= 0.0 {
            return None;
        }
        // The larger sum is free of cancellation, and tells the other root.
        let sum = -(b + squared.max(0.0).sqrt().copysign(b));
        let [one, other] = [sum / a, if sum == 0.0 { 0.0 } else { c / sum }];
        let (low, high) = (one.min(other), one.max(other));
        let (start, end) = match (a < 0.0, way.0 > 0.0) {
            (true, _) => (low, high),
            // Once inside, it stays there; or it has always been.
            (false, true) => (high, f64::INFINITY),
            (false, false) => (f64::NEG_INFINITY, low),
        };
        (start < end).then_some((foot + start, foot + end))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;

    /// Places of a line before and behind its chord are outside the cone, those on it inside: wide and narrow cones, near and far
    /// lines, along the axis and across.
    #[test]
    fn chords_are_where_the_cone_is() {
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        let (mut met, mut passed) = (0, 0);
        for case in 0..20_000 {
            let angle = 10f64.powf(-4.0 * stream.uniform()) * 1.55;
            let axis = sampling::sphere(stream.uniform2());
            let cone = SoftCone::new(axis, 0.5 * angle, angle);
            let apex = 100.0 * sampling::sphere(stream.uniform2());
            let size = 10f64.powf(6.0 * stream.uniform() - 3.0);
            // Through a place near the cone, from somewhere, or nearly along it.
            let aside = 2.0 * angle.tan().min(10.0) * stream.uniform();
            let through = apex + size * (axis + aside * Frame::around(axis).x);
            let toward = sampling::sphere(stream.uniform2());
            let direction = if case % 3 == 0 { axis + angle * toward } else { toward }.normalize();
            let ray = Ray::new(through - 3.0 * size * direction, direction);
            let inside = |t: f64| {
                let v = ray.at(t) - apex;
                let along = v.dot(axis);
                (along > 0.0).then(|| (v - along * axis).length().atan2(along) / angle)
            };
            let at = format!("case {case}: {angle}, {ray:?}, {axis}, {apex}");
            let chord = cone.chord(apex, &ray);
            let places = (0..200).map(|i| size * (0.1 * f64::from(i) - 7.0));
            for t in places {
                let share = inside(t);
                let (is_in, is_out) = (share.is_some_and(|x| x < 1.0 - 1e-6), share.is_none_or(|x| x > 1.0 + 1e-6));
                let holds = chord.is_some_and(|(a, b)| a <= t && t <= b);
                assert!(!(is_in && !holds || is_out && holds), "{at}: {t}, {share:?}, {chord:?}");
            }
            if chord.is_some() { met += 1 } else { passed += 1 }
        }
        assert!(met > 2000 && passed > 2000, "{met} {passed}");
    }
}
