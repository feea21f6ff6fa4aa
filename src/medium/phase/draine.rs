use super::henyey_greenstein::{self, HenyeyGreenstein};
use super::kind::{Arithmetic, Deflection, Kind};
use crate::math::Stream;

/// Draine's phase function (Draine 2003, The Astrophysical Journal 598, Eq. 6): Henyey and Greenstein's times a
/// quadratic in the cosine, p = p_HG(g) (1 + α cos² θ)/(1 + α (1 + 2g²)/3).
///
/// α = 0 is Henyey–Greenstein, g = 0 with α = 1 is Rayleigh, α = 1 is Cornette and Shanks'.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Draine {
    /// The g of the Henyey–Greenstein factor, in (−1, 1); positive forward.
    pub g: f64,
    /// The weight of cos² θ; at least 0.
    pub alpha: f64,
}

impl Draine {
    /// The mean of 1 + α cos² θ under Henyey–Greenstein.
    fn norm(&self) -> f64 {
        1.0 + self.alpha * (1.0 + 2.0 * self.g * self.g) / 3.0
    }
}

impl Kind for Draine {
    fn at(&self, deflection: Deflection) -> f64 {
        let Draine { g, alpha } = *self;
        let quadratic = (1.0 + alpha * deflection.cos * deflection.cos) / self.norm();
        HenyeyGreenstein { g }.at(deflection) * quadratic
    }

    /// Rejection from Henyey–Greenstein, which is accepted with (1 + α cos² θ)/(1 + α): at most three tries on
    /// average, whatever g and α, and without the cancellation of the closed inverse (a quartic's root).
    fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
        let lobe = HenyeyGreenstein { g: self.g };
        let mut deflection = lobe.inverse(u);
        while stream.uniform() * (1.0 + self.alpha) >= 1.0 + self.alpha * deflection.cos * deflection.cos {
            deflection = lobe.inverse(stream.uniform());
        }
        deflection
    }

    /// g (1 + α (3 + 2g²)/5)/(1 + α (1 + 2g²)/3)
    fn mean_cosine(&self) -> f64 {
        self.g * (1.0 + self.alpha * (3.0 + 2.0 * self.g * self.g) / 5.0) / self.norm()
    }
}

/// Henyey and Greenstein's function of e² times 1 + α cos² θ, which is the same for either peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Form {
    lobe: henyey_greenstein::Form,
    alpha: f32,
}

impl Form {
    /// With the constant that normalises it: that of its lobe by the mean of 1 + α cos² θ.
    pub(super) fn new(phase: &Draine) -> (Self, f64) {
        let (lobe, constant) = henyey_greenstein::Form::new(phase.g);
        (Form { lobe, alpha: phase.alpha as f32 }, constant / phase.norm())
    }

    /// How fast ⅔ of its logarithm changes with the angle, at most: that of 1 + α cos² θ by α/√(1 + α).
    pub(super) fn steepness(&self) -> f64 {
        let alpha = f64::from(self.alpha);
        self.lobe.steepness() + 2.0 / 3.0 * alpha / (1.0 + alpha).sqrt()
    }

    /// Its value and derivative.
    #[inline(always)]
    pub(super) fn value<N: Arithmetic>(&self, e2: N) -> (N, N) {
        let (inverse, lobe) = self.lobe.powers(e2);
        // cos θ = 1 − e²/2, but for its sign.
        let cos = e2.mul_add(N::splat(-0.5), N::splat(1.0));
        let bent = cos.mul(N::splat(self.alpha));
        let value = lobe.mul(cos.mul_add(bent, N::splat(1.0)));
        (value, value.mul(inverse).mul(N::splat(self.lobe.fall())).sub(lobe.mul(bent)))
    }
}
