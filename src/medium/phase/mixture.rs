use super::{Deflection, Phase};
use crate::math::Stream;

/// A weighted sum of phase functions.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
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

    /// The weights and phase functions, no mixtures themselves; the weights sum to one.
    pub fn lobes(&self) -> &[(f64, Phase)] {
        &self.lobes
    }

    pub(super) fn value(&self, deflection: Deflection) -> f64 {
        self.lobes.iter().map(|(weight, phase)| weight * phase.value(deflection)).sum()
    }

    /// Reuses what the choice of the lobe leaves of `u`.
    pub(super) fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
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

    pub(super) fn mean_cosine(&self) -> f64 {
        self.lobes.iter().map(|(weight, phase)| weight * phase.mean_cosine()).sum()
    }
}
