//! Rays, boxes, frames, sampling and random streams.
//!
//! Geometry and light transport run in `f64`: positions a millionth of the scene apart must stay
//! apart (mean free paths of dense media), and weights must not drift over walks of millions of
//! events. Photons and pictures are stored in `f32`.

mod bounds;
mod cells;
mod choice;
mod frame;
pub mod random;
pub mod sampling;
mod sets;
pub mod wide;

pub use bounds::Bounds;
pub use cells::Cells;
pub use choice::{Choice, Distribution, choose};
pub use frame::Frame;
pub use random::Stream;
pub use sets::DisjointSets;

pub use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3, Vec3};

/// Three spectral channels: linear sRGB radiance, power, coefficients or weights.
pub type Rgb = DVec3;

/// A half line. `direction` has unit length, so that parameters along the ray are lengths.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: DVec3,
    /// The unit direction it runs in.
    pub direction: DVec3,
}

impl Ray {
    /// A ray from `origin` along the unit vector `direction`.
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        Ray { origin, direction }
    }

    /// The point at distance `t` from the origin.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// How far a computed point at distance `t` along `ray` may lie from where it should be: a bound of
/// some hundred roundings in `f64`, enough for intersections in transformed object space.
/// New rays start this far off a surface, and surfaces closer together than this are one.
pub fn error_bound(ray: &Ray, t: f64) -> f64 {
    const ROUNDINGS: f64 = 512.0 * f64::EPSILON;
    ROUNDINGS * (ray.origin.abs().max_element() + t.abs())
}

/// Each channel's present share of a weight; equal shares of nothing.
pub fn shares(weight: Rgb) -> Rgb {
    let sum = weight.element_sum();
    if sum > 0.0 { weight / sum } else { Rgb::splat(1.0 / 3.0) }
}

/// `(1 − e^{−x})/x`, without cancellation near 0.
pub fn one_minus_exp_over(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { -(-x).exp_m1() / x }
}
