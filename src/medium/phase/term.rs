//! Phase functions as sums of simple terms: the form in which many photons are evaluated at a time.

use std::f64::consts::PI;

use super::kind::Arithmetic;
use super::{draine, henyey_greenstein, rayleigh, schlick};

/// A term of a phase function: a weight times a function of the squared distance e² = 2 (1 − cos θ) between the
/// direction of travel after scattering and the term's peak, which is forward, or for a backward peak
/// e² = 2 (1 + cos θ). Unlike the cosine, e² does not cancel at the peak.
///
/// Accurate to 2·10⁻⁵ up to |g| = 0.9999; lobes narrower than [`NARROWEST`](super::kind::NARROWEST) are taken as that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Term {
    /// What the function is multiplied by, its normalisation included.
    pub(crate) weight: f32,
    /// Whether the peak is backward.
    pub(crate) backward: bool,
    /// The function of e² that is multiplied by the weight.
    pub(super) form: Form,
    /// How fast ⅔ of the function's logarithm changes with the angle, at most, per radian.
    pub(crate) steepness: f64,
}

/// The functions of e² that terms are made of, normalised by the term's weight only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
    /// 1, whatever e².
    Even,
    /// ((1 − |g|)² + |g| e²)^{−3/2}.
    HenyeyGreenstein(henyey_greenstein::Form),
    /// (1 − |k| + |k| e²/2)^{−2}.
    Schlick(schlick::Form),
    /// 1 + (1 − e²/2)².
    Rayleigh,
    /// Henyey and Greenstein's function times 1 + α (1 − e²/2)².
    Draine(draine::Form),
}

impl Form {
    /// How fast ⅔ of its logarithm changes with the angle, at most, per radian.
    pub(super) fn steepness(&self) -> f64 {
        match self {
            Form::Even => 0.0,
            Form::HenyeyGreenstein(form) => form.steepness(),
            Form::Schlick(form) => form.steepness(),
            Form::Rayleigh => rayleigh::STEEPNESS,
            Form::Draine(form) => form.steepness(),
        }
    }
}

impl Term {
    /// Henyey and Greenstein's functions without their 1 − g², of directions that are multiplied each by its own g, of at most
    /// `largest` either way.
    pub(crate) fn of_scaled_directions(largest: f64) -> Term {
        let steepness = henyey_greenstein::HenyeyGreenstein { g: largest }.steepness();
        let form = Form::HenyeyGreenstein(henyey_greenstein::Form::SCALED);
        Term { weight: (0.25 / PI) as f32, backward: false, form, steepness }
    }

    /// The function of e², without the weight, and its derivative by e².
    #[inline(always)]
    pub(crate) fn value<N: Arithmetic>(&self, e2: N) -> (N, N) {
        match &self.form {
            Form::Even => (N::splat(1.0), N::splat(0.0)),
            Form::HenyeyGreenstein(form) => form.value(e2),
            Form::Schlick(form) => form.value(e2),
            Form::Rayleigh => rayleigh::value(e2),
            Form::Draine(form) => form.value(e2),
        }
    }
}
