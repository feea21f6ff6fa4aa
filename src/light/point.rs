use super::{Arrival, Departure, DrawnFrom};
use crate::math::{DVec3, Ray, Rgb, Stream, sampling};
use std::f64::consts::PI;

/// A point that sends the same intensity in all directions.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Where it is.
    pub position: DVec3,
    /// W/sr per channel.
    pub intensity: Rgb,
}

impl Point {
    pub(super) fn power(&self) -> Rgb {
        4.0 * PI * self.intensity
    }

    pub(super) fn importance(&self, p: DVec3) -> f64 {
        self.intensity.element_sum() / (self.position - p).length_squared().max(f64::MIN_POSITIVE)
    }

    pub(super) fn arrive(&self, p: DVec3) -> Option<Arrival> {
        Arrival::from_point(self.position, p, |_| Some(self.intensity))
    }

    pub(super) fn depart(&self, stream: &mut Stream) -> Departure {
        let direction = sampling::sphere(stream.uniform2()).normalize();
        Departure { ray: Ray::new(self.position, direction), power: self.power(), spread: DrawnFrom::Sphere }
    }
}
