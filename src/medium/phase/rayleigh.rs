use super::Deflection;
use std::f64::consts::PI;

/// Rayleigh's phase function, p = 3/(16π) (1 + cos² θ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rayleigh;

impl Rayleigh {
    pub(super) fn value(&self, deflection: Deflection) -> f64 {
        3.0 / (16.0 * PI) * (1.0 + deflection.cos * deflection.cos)
    }

    /// The root of c³ + 3c = 8u − 4: with A³ = a + √(a² + 1) and a = 4u − 2, c = A − 1/A.
    pub(super) fn deflect(&self, u: f64) -> Deflection {
        let a = 4.0 * u - 2.0;
        // The larger of the two conjugate roots; the other one cancels.
        let root = (a.abs() + (a * a + 1.0).sqrt()).cbrt();
        let c = ((root - 1.0 / root) * a.signum()).clamp(-1.0, 1.0);
        Deflection::from_ends(1.0 - c, 1.0 + c)
    }
}
