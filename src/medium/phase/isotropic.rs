use super::kind::{Deflection, Kind};
use crate::math::Stream;
use std::f64::consts::PI;

/// Equal in all directions: p = 1/4π.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Isotropic;

/// Its value in every direction, 1/4π.
pub(super) const VALUE: f64 = 0.25 / PI;

impl Kind for Isotropic {
    fn at(&self, _: Deflection) -> f64 {
        VALUE
    }

    fn deflect(&self, u: f64, _: &mut Stream) -> Deflection {
        Deflection::from_ends(2.0 * (1.0 - u), 2.0 * u)
    }

    fn mean_cosine(&self) -> f64 {
        0.0
    }
}
