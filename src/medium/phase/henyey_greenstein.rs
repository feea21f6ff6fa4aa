use super::kind::{Arithmetic, Deflection, Kind, NARROWEST};
use crate::math::Stream;
use std::f64::consts::PI;

/// Henyey and Greenstein's phase function, p = (1 − g²)/(4π (1 + g² − 2g cos θ)^{3/2})
/// (Jensen 2001, Eq. 10.13).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct HenyeyGreenstein {
    /// The mean cosine, in (−1, 1); positive forward.
    pub g: f64,
}

impl HenyeyGreenstein {
    /// Inversion of the distribution function in a form that cancels at neither end nor at g = 0.
    pub(super) fn inverse(&self, u: f64) -> Deflection {
        let g = self.g.abs();
        let v = 1.0 - u;
        let d = (1.0 - g) + 2.0 * g * u;
        let (a, b) = ((1.0 - g) / d, (1.0 + g) / d);
        let peak_forward = Deflection::from_ends(2.0 * v * a * a * (1.0 + g * u), 2.0 * u * b * b * (1.0 - g * v));
        if self.g >= 0.0 { peak_forward } else { peak_forward.mirrored() }
    }

    /// How fast ⅔ of its logarithm changes with the angle, at most: 2|g|/(1 − g²) per radian.
    pub(crate) fn steepness(&self) -> f64 {
        2.0 * self.g.abs() / (1.0 - self.g * self.g)
    }
}

impl Kind for HenyeyGreenstein {
    fn at(&self, deflection: Deflection) -> f64 {
        let g = self.g.abs();
        let from_peak = if self.g >= 0.0 { deflection.below_one } else { deflection.above_minus_one };
        // 1 + g² − 2g cos θ without its cancellation towards the peak.
        let d = (1.0 - g) * (1.0 - g) + 2.0 * g * from_peak;
        (1.0 - g) * (1.0 + g) / (4.0 * PI * d * d.sqrt())
    }

    fn deflect(&self, u: f64, _: &mut Stream) -> Deflection {
        self.inverse(u)
    }

    fn mean_cosine(&self) -> f64 {
        self.g
    }
}

/// x^{−3/2} with x = (1 − |g|)² + |g| e².
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Form {
    base: f32,
    slope: f32,
}

impl Form {
    /// With the constant (1 − g²)/4π that normalises it.
    pub(super) fn new(g: f64) -> (Self, f64) {
        let g = g.abs().min(NARROWEST);
        (Form { base: (1.0 - g).powi(2) as f32, slope: g as f32 }, 0.25 / PI * (1.0 - g) * (1.0 + g))
    }

    /// Of x = e², with v = g d in place of the direction d, where that is kept so: |v + ω|² = 1 + g² + 2g d·ω.
    pub(super) const SCALED: Form = Form { base: 0.0, slope: 1.0 };

    /// How fast ⅔ of its logarithm changes with the angle, at most.
    pub(super) fn steepness(&self) -> f64 {
        HenyeyGreenstein { g: f64::from(self.slope) }.steepness()
    }

    /// The powers 1/x and x^{−3/2} of its base.
    #[inline(always)]
    pub(super) fn powers<N: Arithmetic>(&self, e2: N) -> (N, N) {
        let y = e2.mul_add(N::splat(self.slope), N::splat(self.base)).rsqrt();
        let y2 = y.mul(y);
        (y2, y2.mul(y))
    }

    /// −3/2 |g|: the derivative of x^{−3/2} by e² is this times x^{−3/2}/x.
    #[inline(always)]
    pub(super) fn fall(&self) -> f32 {
        -1.5 * self.slope
    }

    /// Its value and derivative.
    #[inline(always)]
    pub(super) fn value<N: Arithmetic>(&self, e2: N) -> (N, N) {
        let (inverse, value) = self.powers(e2);
        (value, value.mul(inverse).mul(N::splat(self.fall())))
    }
}
