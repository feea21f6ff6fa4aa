use super::{Drawn, Incidence};
use crate::math::{DVec3, Rgb};

/// Reflects specularly, on both sides.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Mirror {
    /// The share of light that is reflected, by channel in \[0, 1\].
    pub reflectance: Rgb,
}

impl Mirror {
    /// The direction light goes on in.
    pub(super) fn sample(&self, at: &Incidence) -> Drawn {
        let normal = at.specular_normal(|normal| Some(reflect(at.direction, normal)), true);
        Drawn { direction: reflect(at.direction, normal), normal, factor: self.reflectance, density: 0.0 }
    }
}

/// The direction in which light goes on that a plane mirror with this unit normal reflects.
pub(super) fn reflect(direction: DVec3, normal: DVec3) -> DVec3 {
    (direction - 2.0 * direction.dot(normal) * normal).normalize()
}
