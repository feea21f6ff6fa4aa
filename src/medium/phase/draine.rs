use super::{Deflection, HenyeyGreenstein};
use crate::math::Stream;

/// Draine's phase function (Draine 2003, The Astrophysical Journal 598, Eq. 6): Henyey and Greenstein's times a
/// quadratic in the cosine, p = p_HG(g) (1 + α cos² θ)/(1 + α (1 + 2g²)/3).
///
/// α = 0 is Henyey–Greenstein, g = 0 with α = 1 is Rayleigh, α = 1 is Cornette and Shanks'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draine {
    /// The g of the Henyey–Greenstein factor, in (−1, 1); positive forward.
    pub g: f64,
    /// The weight of cos² θ; at least 0.
    pub alpha: f64,
}

impl Draine {
    pub(super) fn value(&self, deflection: Deflection) -> f64 {
        let Draine { g, alpha } = *self;
        let quadratic = (1.0 + alpha * deflection.cos * deflection.cos) / self.norm();
        HenyeyGreenstein { g }.value(deflection) * quadratic
    }

    /// The mean of 1 + α cos² θ under Henyey–Greenstein.
    fn norm(&self) -> f64 {
        1.0 + self.alpha * (1.0 + 2.0 * self.g * self.g) / 3.0
    }

    /// Rejection from Henyey–Greenstein, which is accepted with (1 + α cos² θ)/(1 + α): at most three tries on
    /// average, whatever g and α, and without the cancellation of the closed inverse (a quartic's root).
    pub(super) fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
        let lobe = HenyeyGreenstein { g: self.g };
        let mut deflection = lobe.deflect(u);
        while stream.uniform() * (1.0 + self.alpha) >= 1.0 + self.alpha * deflection.cos * deflection.cos {
            deflection = lobe.deflect(stream.uniform());
        }
        deflection
    }

    /// g (1 + α (3 + 2g²)/5)/(1 + α (1 + 2g²)/3)
    pub(super) fn mean_cosine(&self) -> f64 {
        self.g * (1.0 + self.alpha * (3.0 + 2.0 * self.g * self.g) / 5.0) / self.norm()
    }
}
