//! A photon, as it is traced and handed to a map.

use crate::math::Vec3;

/// A photon at a collision in a medium, or where it lands on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photon {
    /// Where it collided or landed.
    pub position: Vec3,
    /// The unit direction it travelled in.
    pub direction: Vec3,
    /// Its flux \[W\] into the collision, already divided by the number of emitted photons, times
    /// the albedo there; on a surface without that.
    pub power: Vec3,
    /// Events between the light and this place, at most 255; 0 for light that came straight.
    pub events: u8,
}

impl Photon {
    /// Whether all its numbers are.
    pub(super) fn is_finite(&self) -> bool {
        self.position.is_finite() && self.direction.is_finite() && self.power.is_finite()
    }
}
