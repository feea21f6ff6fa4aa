use super::{Arrival, Departure, DrawnFrom, Profile};
use crate::math::{DVec3, Frame, Ray, Rgb, Stream};
use std::sync::Arc;

/// A point that shines as a lamp was measured to.
#[derive(Clone, Debug)]
pub struct Goniometric {
    /// Where it is.
    pub position: DVec3,
    /// W/sr per channel where the profile is brightest.
    pub intensity: Rgb,
    /// z is the lamp's axis; φ of the profile goes from x to y.
    frame: Frame,
    profile: Arc<Profile>,
}

impl Goniometric {
    /// A lamp with this unit axis. φ = 0 is towards +x, or towards +z where the axis is along x; for a lamp that shines down φ grows
    /// counter-clockwise as seen from above.
    pub fn new(position: DVec3, axis: DVec3, intensity: Rgb, profile: Arc<Profile>) -> Self {
        const PARALLEL: f64 = 1.0 - 1e-9;
        let towards = if axis.x.abs() < PARALLEL { DVec3::X } else { DVec3::Z };
        let x = (towards - towards.dot(axis) * axis).normalize();
        Goniometric { position, intensity, frame: Frame { x, y: x.cross(axis), z: axis }, profile }
    }

    /// The unit axis.
    pub fn axis(&self) -> DVec3 {
        self.frame.z
    }

    /// The profile.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    pub(super) fn power(&self) -> Rgb {
        self.profile.total() * self.intensity
    }

    pub(super) fn importance(&self, p: DVec3) -> f64 {
        self.arrive(p).map_or(0.0, |arrival| arrival.radiance.element_sum())
    }

    pub(super) fn arrive(&self, p: DVec3) -> Option<Arrival> {
        let distance = self.position.distance(p);
        let direction = (self.position - p) / distance;
        let share = if distance > 0.0 { self.profile.at(self.frame.to_local(-direction)) } else { 0.0 };
        (share > 0.0).then(|| Arrival {
            direction,
            distance,
            radiance: share * self.intensity / (distance * distance),
            density: 1.0,
            has_size: false,
            normal: -direction,
        })
    }

    pub(super) fn depart(&self, stream: &mut Stream) -> Departure {
        let direction = self.frame.to_world(self.profile.sample(stream)).normalize();
        Departure { ray: Ray::new(self.position, direction), power: self.power(), spread: DrawnFrom::Other }
    }
}
