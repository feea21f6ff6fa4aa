use crate::math::{DVec3, Frame, Rgb, Stream, sampling};
use std::f64::consts::PI;

/// Reflects equally in all directions, on both sides: f = ρ/π.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lambert {
    /// ρ, the share of light that is reflected.
    pub reflectance: Rgb,
}

impl Lambert {
    /// f, for two directions on the same side.
    pub fn value(&self) -> Rgb {
        self.reflectance / PI
    }

    /// A direction about `normal` with density cos θ/π.
    pub fn sample(&self, normal: DVec3, stream: &mut Stream) -> DVec3 {
        Frame::around(normal).to_world(sampling::cosine_hemisphere(stream.uniform2())).normalize()
    }

    /// The density of [`Lambert::sample`].
    pub fn density(&self, normal: DVec3, direction: DVec3) -> f64 {
        normal.dot(direction).max(0.0) / PI
    }
}
