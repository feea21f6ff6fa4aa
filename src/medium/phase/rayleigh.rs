use super::kind::{Arithmetic, Deflection, Kind};
use crate::math::Stream;
use std::f64::consts::PI;

/// Rayleigh's phase function, p = 3/(16π) (1 + cos² θ).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Rayleigh;

impl Kind for Rayleigh {
    fn at(&self, deflection: Deflection) -> f64 {
        3.0 / (16.0 * PI) * (1.0 + deflection.cos * deflection.cos)
    }

    /// The root of c³ + 3c = 8u − 4: with A³ = a + √(a² + 1) and a = 4u − 2, c = A − 1/A.
    fn deflect(&self, u: f64, _: &mut Stream) -> Deflection {
        let a = 4.0 * u - 2.0;
        // The larger of the two conjugate roots; the other one cancels.
        let root = (a.abs() + (a * a + 1.0).sqrt()).cbrt();
        let c = ((root - 1.0 / root) * a.signum()).clamp(-1.0, 1.0);
        Deflection::from_ends(1.0 - c, 1.0 + c)
    }

    fn mean_cosine(&self) -> f64 {
        0.0
    }
}

/// What normalises 1 + cos² θ, 3/(16π).
pub(super) const CONSTANT: f64 = 3.0 / 16.0 / PI;

/// How fast ⅔ of its logarithm changes with the angle, at most, per radian.
pub(super) const STEEPNESS: f64 = 0.5;

/// 1 + cos² θ with cos θ = 1 − e²/2, and its derivative by e².
#[inline(always)]
pub(super) fn value<N: Arithmetic>(e2: N) -> (N, N) {
    let cos = e2.mul_add(N::splat(-0.5), N::splat(1.0));
    (cos.mul_add(cos, N::splat(1.0)), cos.mul(N::splat(-1.0)))
}
