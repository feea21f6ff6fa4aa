use super::term::Term;
use super::{Deflection, Kind, Phase};
use crate::math::Stream;

/// A weighted sum of phase functions.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    /// Weights that sum to one, and phase functions that are no mixtures.
    lobes: Vec<(f64, Phase)>,
}

impl Mixture {
    /// From weights that sum to one, up to rounding, and their phase functions. Mixtures among them are taken apart.
    pub fn new(lobes: Vec<(f64, Phase)>) -> Self {
        let total: f64 = lobes.iter().map(|lobe| lobe.0).sum();
        let mut flat = Vec::with_capacity(lobes.len());
        for (weight, phase) in lobes {
            match phase {
                Phase::Mixture(inner) => {
                    flat.extend(inner.lobes.into_iter().map(|(share, phase)| (weight / total * share, phase)));
                }
                phase => flat.push((weight / total, phase)),
            }
        }
        Mixture { lobes: flat }
    }

    /// Its phase function, if it is a sum of only one.
    pub(super) fn only(&self) -> Option<&Phase> {
        match &self.lobes[..] {
            [(_, phase)] => Some(phase),
            _ => None,
        }
    }
}

impl From<Mixture> for Phase {
    fn from(phase: Mixture) -> Phase {
        Phase::Mixture(phase)
    }
}

impl Kind for Mixture {
    fn at(&self, deflection: Deflection) -> f64 {
        self.lobes.iter().map(|(weight, phase)| weight * phase.at(deflection)).sum()
    }

    /// Reuses what the choice of the lobe leaves of `u`.
    fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
        let mut rest = u;
        for (weight, phase) in &self.lobes {
            if rest < *weight {
                return phase.deflect((rest / weight).min(1.0 - f64::EPSILON), stream);
            }
            rest -= weight;
        }
        // Rounding left a little beyond the last weight.
        match self.lobes.iter().rev().find(|lobe| lobe.0 > 0.0) {
            Some((_, phase)) => phase.deflect(1.0 - f64::EPSILON, stream),
            None => Deflection::from_ends(1.0, 1.0),
        }
    }

    fn mean_cosine(&self) -> f64 {
        self.lobes.iter().map(|(weight, phase)| weight * Kind::mean_cosine(phase)).sum()
    }

    fn terms(&self, weight: f64, terms: &mut Vec<Term>) {
        self.lobes.iter().for_each(|(share, phase)| phase.terms(weight * share, terms));
    }
}
