use crate::math::{DVec3, Rgb};

/// Reflects specularly, on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    /// The share of light that is reflected.
    pub reflectance: Rgb,
}

impl Mirror {
    /// The direction light goes on in.
    pub fn reflect(direction: DVec3, normal: DVec3) -> DVec3 {
        (direction - 2.0 * direction.dot(normal) * normal).normalize()
    }
}
