use super::{Arrival, Departure, DrawnFrom, Surroundings};
use crate::math::{DVec3, Frame, Ray, Rgb, Stream, sampling};
use std::f64::consts::PI;

/// Parallel light, or light from a narrow cone of directions; from infinity, or a round beam of
/// parallel light that starts on a disc. (A beam with a cone is an emitting disc.)
#[derive(Clone, Copy, Debug)]
pub struct Directional {
    /// The unit direction of travel.
    pub direction: DVec3,
    /// W per area on a plane facing it, per channel.
    pub irradiance: Rgb,
    /// 1 − cos of half the apparent diameter; 0 for parallel light.
    pub cone: f64,
    /// Centre and radius of the disc a bounded beam starts on.
    pub beam: Option<(DVec3, f64)>,
}

/// The radiance within a cone, 1 − cos of whose half-angle is given, that makes this irradiance on a
/// plane facing it: E = ∫ L cos θ dω = π L sin².
pub(crate) fn cone_radiance(irradiance: Rgb, cone: f64) -> Rgb {
    irradiance / (PI * cone * (2.0 - cone))
}

impl Directional {
    pub(super) fn has_size(&self) -> bool {
        self.cone > 0.0
    }

    pub(super) fn power(&self, surroundings: &Surroundings) -> Rgb {
        let radius = self.beam.map_or(surroundings.radius, |(_, radius)| radius);
        PI * radius * radius * self.irradiance
    }

    pub(super) fn importance(&self, p: DVec3) -> f64 {
        if self.beam.is_some_and(|beam| self.along_beam(beam, p).is_none()) {
            return 0.0;
        }
        self.irradiance.element_sum()
    }

    /// How far `p` is past the disc, if it lies in the beam.
    fn along_beam(&self, (center, radius): (DVec3, f64), p: DVec3) -> Option<f64> {
        let offset = p - center;
        let along = offset.dot(self.direction);
        let aside = (offset - along * self.direction).length();
        (along > 0.0 && aside <= radius).then_some(along)
    }

    pub(super) fn arrive(&self, p: DVec3, stream: &mut Stream) -> Option<Arrival> {
        if self.has_size() {
            let direction = Frame::around(-self.direction).to_world(sampling::cone(self.cone, stream.uniform2()));
            return Some(Arrival {
                direction: direction.normalize(),
                distance: f64::INFINITY,
                radiance: cone_radiance(self.irradiance, self.cone),
                density: 1.0 / (2.0 * PI * self.cone),
                has_size: true,
                normal: self.direction,
            });
        }
        let distance = match self.beam {
            None => f64::INFINITY,
            Some(beam) => self.along_beam(beam, p)?,
        };
        Some(Arrival {
            direction: -self.direction,
            distance,
            radiance: self.irradiance,
            density: 1.0,
            has_size: false,
            normal: self.direction,
        })
    }

    pub(super) fn depart(&self, surroundings: &Surroundings, stream: &mut Stream) -> Departure {
        let (x, y) = sampling::disc(stream.uniform2());
        let direction = if self.has_size() {
            Frame::around(self.direction).to_world(sampling::cone(self.cone, stream.uniform2())).normalize()
        } else {
            self.direction
        };
        let frame = Frame::around(direction);
        let origin = match self.beam {
            Some((center, radius)) => center + radius * (x * frame.x + y * frame.y),
            None => surroundings.center + surroundings.radius * (x * frame.x + y * frame.y - direction),
        };
        // The cone is drawn uniformly: each direction carries L dω over the disc that faces it.
        let power = if self.has_size() {
            2.0 * PI * self.cone * cone_radiance(self.irradiance, self.cone) * PI * surroundings.radius.powi(2)
        } else {
            self.power(surroundings)
        };
        let spread = if self.beam.is_some() { DrawnFrom::Other } else { DrawnFrom::Disc };
        Departure { ray: Ray::new(origin, direction), power, spread }
    }

    fn is_in_cone(&self, direction: DVec3) -> bool {
        0.5 * (direction + self.direction).length_squared() <= self.cone
    }

    pub(super) fn escaping(&self, direction: DVec3) -> Rgb {
        if self.has_size() && self.is_in_cone(direction) {
            cone_radiance(self.irradiance, self.cone)
        } else {
            Rgb::ZERO
        }
    }

    pub(super) fn escaping_density(&self, direction: DVec3) -> f64 {
        if self.has_size() && self.is_in_cone(direction) { 1.0 / (2.0 * PI * self.cone) } else { 0.0 }
    }
}
