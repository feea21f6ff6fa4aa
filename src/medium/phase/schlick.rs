use super::kind::{Arithmetic, Deflection, Kind, NARROWEST};
use crate::math::Stream;
use std::f64::consts::PI;

/// Schlick's rational phase function, p = (1 − k²)/(4π (1 − k cos θ)²), with θ = 0 forward
/// (Jensen 2001, Eq. 10.15 with its sign turned to match Eq. 10.16).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Schlick {
    /// The shape, in (−1, 1); positive forward. About 1.55 g − 0.55 g³ of the Henyey–Greenstein it imitates.
    pub k: f64,
}

impl Kind for Schlick {
    fn at(&self, deflection: Deflection) -> f64 {
        let k = self.k.abs();
        let from_peak = if self.k >= 0.0 { deflection.below_one } else { deflection.above_minus_one };
        let d = (1.0 - k) + k * from_peak;
        (1.0 - k) * (1.0 + k) / (4.0 * PI * d * d)
    }

    fn deflect(&self, u: f64, _: &mut Stream) -> Deflection {
        let k = self.k.abs();
        let d = (1.0 - k) + 2.0 * k * u;
        let peak_forward = Deflection::from_ends(2.0 * (1.0 - u) * (1.0 - k) / d, 2.0 * u * (1.0 + k) / d);
        if self.k >= 0.0 { peak_forward } else { peak_forward.mirrored() }
    }

    /// 1/k + (1 − k²)/(2k²) ln((1 − k)/(1 + k)); its series 2k/3 + 2k³/15 + 2k⁵/35 near 0.
    fn mean_cosine(&self) -> f64 {
        let k = self.k;
        if k.abs() < 1e-2 {
            k * (2.0 / 3.0 + k * k * (2.0 / 15.0 + k * k * (2.0 / 35.0)))
        } else {
            1.0 / k + (1.0 - k * k) / (2.0 * k * k) * ((-k).ln_1p() - k.ln_1p())
        }
    }
}

/// (1 − |k| + |k| e²/2)^{−2}.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Form {
    base: f32,
    slope: f32,
}

impl Form {
    /// With the constant (1 − k²)/4π that normalises it.
    pub(super) fn new(k: f64) -> (Self, f64) {
        let k = k.abs().min(NARROWEST);
        (Form { base: (1.0 - k) as f32, slope: (0.5 * k) as f32 }, 0.25 / PI * (1.0 - k) * (1.0 + k))
    }

    /// How fast ⅔ of its logarithm changes with the angle, at most: (4/3) |k|/√(1 − k²).
    pub(super) fn steepness(&self) -> f64 {
        let k = 2.0 * f64::from(self.slope);
        4.0 / 3.0 * k.abs() / (1.0 - k * k).sqrt()
    }

    /// Its value and derivative.
    #[inline(always)]
    pub(super) fn value<N: Arithmetic>(&self, e2: N) -> (N, N) {
        let y = e2.mul_add(N::splat(self.slope), N::splat(self.base)).rsqrt();
        let y2 = y.mul(y);
        let value = y2.mul(y2);
        (value, value.mul(y2).mul(N::splat(-2.0 * self.slope)))
    }
}
