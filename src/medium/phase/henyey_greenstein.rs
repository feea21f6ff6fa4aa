use super::Deflection;
use std::f64::consts::PI;

/// Henyey and Greenstein's phase function, p = (1 − g²)/(4π (1 + g² − 2g cos θ)^{3/2})
/// (Jensen 2001, Eq. 10.13).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HenyeyGreenstein {
    /// The mean cosine, in (−1, 1); positive forward.
    pub g: f64,
}

impl HenyeyGreenstein {
    pub(super) fn value(&self, deflection: Deflection) -> f64 {
        let g = self.g.abs();
        let from_peak = if self.g >= 0.0 { deflection.below_one } else { deflection.above_minus_one };
        // 1 + g² − 2g cos θ without its cancellation towards the peak.
        let d = (1.0 - g) * (1.0 - g) + 2.0 * g * from_peak;
        (1.0 - g) * (1.0 + g) / (4.0 * PI * d * d.sqrt())
    }

    /// Inversion of the distribution function in a form that cancels at neither end nor at g = 0.
    pub(super) fn deflect(&self, u: f64) -> Deflection {
        let g = self.g.abs();
        let v = 1.0 - u;
        let d = (1.0 - g) + 2.0 * g * u;
        let (a, b) = ((1.0 - g) / d, (1.0 + g) / d);
        let peak_forward = Deflection::from_ends(2.0 * v * a * a * (1.0 + g * u), 2.0 * u * b * b * (1.0 - g * v));
        if self.g >= 0.0 { peak_forward } else { peak_forward.mirrored() }
    }
}
