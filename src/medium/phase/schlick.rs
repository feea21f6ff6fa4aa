use super::Deflection;
use std::f64::consts::PI;

/// Schlick's rational phase function, p = (1 − k²)/(4π (1 − k cos θ)²), with θ = 0 forward
/// (Jensen 2001, Eq. 10.15 with its sign turned to match Eq. 10.16).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schlick {
    /// The shape, in (−1, 1); positive forward. About 1.55 g − 0.55 g³ of the Henyey–Greenstein it imitates.
    pub k: f64,
}

impl Schlick {
    pub(super) fn value(&self, deflection: Deflection) -> f64 {
        let k = self.k.abs();
        let from_peak = if self.k >= 0.0 { deflection.below_one } else { deflection.above_minus_one };
        let d = (1.0 - k) + k * from_peak;
        (1.0 - k) * (1.0 + k) / (4.0 * PI * d * d)
    }

    pub(super) fn deflect(&self, u: f64) -> Deflection {
        let k = self.k.abs();
        let d = (1.0 - k) + 2.0 * k * u;
        let peak_forward = Deflection::from_ends(2.0 * (1.0 - u) * (1.0 - k) / d, 2.0 * u * (1.0 + k) / d);
        if self.k >= 0.0 { peak_forward } else { peak_forward.mirrored() }
    }

    /// 1/k + (1 − k²)/(2k²) ln((1 − k)/(1 + k)); its series 2k/3 + 2k³/15 + 2k⁵/35 near 0.
    pub(super) fn mean_cosine(&self) -> f64 {
        let k = self.k;
        if k.abs() < 1e-2 {
            k * (2.0 / 3.0 + k * k * (2.0 / 15.0 + k * k * (2.0 / 35.0)))
        } else {
            1.0 / k + (1.0 - k * k) / (2.0 * k * k) * ((-k).ln_1p() - k.ln_1p())
        }
    }
}
