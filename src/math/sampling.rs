//! Warps from uniform random numbers in [0, 1) to directions and points. All are finite and in
//! domain for 0 and for the largest number below 1.

use super::DVec3;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

/// A point in the unit disc, uniform by area, with little distortion (Shirley and Chiu 1997).
pub fn disc([u, v]: [f64; 2]) -> (f64, f64) {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return (0.0, 0.0);
    }
    let (r, phi) = if a.abs() > b.abs() { (a, FRAC_PI_4 * (b / a)) } else { (b, FRAC_PI_2 - FRAC_PI_4 * (a / b)) };
    (r * phi.cos(), r * phi.sin())
}

/// A direction on the unit sphere, uniform by solid angle: density 1/4π.
pub fn sphere([u, v]: [f64; 2]) -> DVec3 {
    direction(1.0 - 2.0 * u, v)
}

/// The direction with this cosine to +z and this share of a full turn about it.
pub fn direction(cos_theta: f64, turn: f64) -> DVec3 {
    let sin_theta = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    let (s, c) = (TAU * turn).sin_cos();
    DVec3::new(sin_theta * c, sin_theta * s, cos_theta)
}

/// A direction about +z with density cos θ/π.
pub fn cosine_hemisphere(u: [f64; 2]) -> DVec3 {
    let (x, y) = disc(u);
    DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt())
}

/// `1 − cos θ` and the direction about +z, uniform in a cone whose rim has `1 − cos` = `one_minus_cos_max`:
/// density 1/(2π · one_minus_cos_max). Stable for cones of any width.
pub fn cone(one_minus_cos_max: f64, [u, v]: [f64; 2]) -> DVec3 {
    let w = u * one_minus_cos_max;
    let sin_theta = (w * (2.0 - w)).max(0.0).sqrt();
    let (s, c) = (TAU * v).sin_cos();
    DVec3::new(sin_theta * c, sin_theta * s, 1.0 - w)
}
