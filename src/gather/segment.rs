//! What maps are asked for: segments of eye rays.

use crate::math::Ray;

/// A segment of an eye ray, and which photons count along it.
#[derive(Clone, Copy, Debug)]
pub struct EyeSegment {
    /// The ray.
    pub ray: Ray,
    /// Where on it the segment begins.
    pub a: f64,
    /// Where it ends; perhaps at infinity.
    pub b: f64,
    /// The medium: an index into the scene's.
    pub medium: u32,
    /// The region whose photons count.
    pub region: u32,
    /// The solid that it lies in, if that decides there: an index into the scene's.
    pub solid: Option<u32>,
    /// Only photons with at most this many events count; 255 for all.
    pub max_events: u8,
    /// Whether it lies on a ray from the camera: segments queued one after the other are then close to
    /// one another, and gather together.
    pub from_camera: bool,
    /// Whether what passes was left to chance, so that all along it counts alike: transmittance is 1.
    pub passed: bool,
    /// Whether it is one of many rays that a surface spreads light over, so that fewer photons tell enough of each.
    pub spread: bool,
}
