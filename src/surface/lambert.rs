use super::{Drawn, Incidence, Scattering};
use crate::math::{DVec3, Frame, Rgb, Stream, sampling};
use std::f64::consts::PI;

/// Reflects equally in all directions, on both sides: f = ρ/π.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Lambert {
    /// ρ, the share of light that is reflected, by channel in \[0, 1\].
    pub reflectance: Rgb,
}

impl Lambert {
    /// ρ cos θ/π with density cos θ/π.
    pub(super) fn value(&self, at: &Incidence, o: DVec3) -> Scattering {
        let density = cosine_density(at.shading_normal, o);
        Scattering { value: self.reflectance * density, ahead: Rgb::splat(density) }
    }

    /// A direction drawn in proportion to the cosine.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Drawn {
        let normal = at.shading_normal;
        let (direction, density) = cosine(normal, stream);
        Drawn { direction, normal, factor: self.reflectance, density }
    }
}

/// The density cos θ/π per steradian of a direction `o` about `normal`; 0 below.
pub(super) fn cosine_density(normal: DVec3, o: DVec3) -> f64 {
    normal.dot(o).max(0.0) / PI
}

/// A direction drawn about `normal`, and its [`cosine_density`].
pub(super) fn cosine(normal: DVec3, stream: &mut Stream) -> (DVec3, f64) {
    let direction = Frame::around(normal).to_world(sampling::cosine_hemisphere(stream.uniform2())).normalize();
    (direction, cosine_density(normal, direction))
}
