use super::Deflection;
use std::f64::consts::PI;

/// Equal in all directions: p = 1/4π.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Isotropic;

impl Isotropic {
    pub(super) fn value(&self) -> f64 {
        0.25 / PI
    }

    pub(super) fn deflect(&self, u: f64) -> Deflection {
        Deflection::from_ends(2.0 * (1.0 - u), 2.0 * u)
    }
}
