//! All phase functions: one of the kinds, or a mixture of several.

use super::draine::{self, Draine};
use super::henyey_greenstein::{self, HenyeyGreenstein};
use super::isotropic::{self, Isotropic};
use super::kind::{Deflection, Kind};
use super::rayleigh::{self, Rayleigh};
use super::schlick::{self, Schlick};
use super::term::{Form, Term};
use crate::math::{DVec3, Frame, Stream};
use smallvec::{SmallVec, smallvec};
use std::f64::consts::TAU;

/// One of the phase functions a scene file can name.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Equal in all directions.
    Isotropic(Isotropic),
    /// Henyey and Greenstein's, with one parameter: the mean cosine.
    HenyeyGreenstein(HenyeyGreenstein),
    /// Schlick's rational approximation of Henyey–Greenstein.
    Schlick(Schlick),
    /// Rayleigh's, of particles far smaller than the wavelength.
    Rayleigh(Rayleigh),
    /// Draine's, a Henyey–Greenstein with one more parameter.
    Draine(Draine),
    /// A weighted sum of others.
    Mixture(Mixture),
}

impl Phase {
    /// The value per steradian for light that travelled along `before` and goes on along `after`, both of length 1.
    pub fn value(&self, before: DVec3, after: DVec3) -> f64 {
        match self {
            Phase::Isotropic(_) => isotropic::VALUE,
            _ => self.at(Deflection::between(before, after)),
        }
    }

    /// The density per steradian with which [`Phase::sample`] draws `after` for light that travelled along `before`:
    /// the phase function's value.
    pub fn density(&self, before: DVec3, after: DVec3) -> f64 {
        self.value(before, after)
    }

    /// A new direction of travel for light that travelled along `before`, and its density per steradian, which is
    /// [`Phase::density`] of the two and the phase function's value.
    pub fn sample(&self, before: DVec3, stream: &mut Stream) -> (DVec3, f64) {
        let [u, turn] = stream.uniform2();
        let deflection = self.deflect(u, stream);
        let sin = (deflection.below_one * deflection.above_minus_one).max(0.0).sqrt();
        let (s, c) = (TAU * turn).sin_cos();
        let after = Frame::around(before).to_world(DVec3::new(sin * c, sin * s, deflection.cos));
        (after.normalize(), self.at(deflection))
    }

    /// The mean cosine of the angle between the directions before and after, from −1 to 1.
    pub fn mean_cosine(&self) -> f64 {
        match self {
            Phase::Isotropic(p) => p.mean_cosine(),
            Phase::HenyeyGreenstein(p) => p.mean_cosine(),
            Phase::Schlick(p) => p.mean_cosine(),
            Phase::Rayleigh(p) => p.mean_cosine(),
            Phase::Draine(p) => p.mean_cosine(),
            Phase::Mixture(p) => p.mean_cosine(),
        }
    }

    /// Whether it is the same for all directions.
    pub fn is_even(&self) -> bool {
        match self.only() {
            Phase::Isotropic(_) => true,
            Phase::HenyeyGreenstein(p) => p.g == 0.0,
            Phase::Schlick(p) => p.k == 0.0,
            _ => false,
        }
    }

    /// The g of the Henyey–Greenstein function that it is, if it is one.
    pub fn henyey_greenstein(&self) -> Option<f64> {
        match self.only() {
            Phase::HenyeyGreenstein(p) => Some(p.g),
            _ => None,
        }
    }

    /// The shares and mean cosines of the Henyey–Greenstein functions that it is a sum of, isotropic ones among them; `None` if it is
    /// of others, too.
    pub(crate) fn lobes(&self) -> Option<SmallVec<[(f64, f64); 2]>> {
        match self {
            Phase::Isotropic(_) => Some(smallvec![(1.0, 0.0)]),
            Phase::HenyeyGreenstein(p) => Some(smallvec![(1.0, p.g)]),
            Phase::Mixture(mixture) => {
                let lobe = |(share, phase): &(f64, Phase)| Some((*share, phase.lobes()?.first()?.1));
                mixture.lobes.iter().map(lobe).collect()
            }
            Phase::Schlick(_) | Phase::Rayleigh(_) | Phase::Draine(_) => None,
        }
    }

    /// Of a mixture of one, that one.
    fn only(&self) -> &Phase {
        match self {
            Phase::Mixture(mixture) => mixture.only().unwrap_or(self),
            _ => self,
        }
    }

    /// The terms whose sum it is.
    pub(crate) fn sum(&self) -> Vec<Term> {
        let mut terms = Vec::new();
        self.add_terms(1.0, &mut terms);
        terms
    }

    /// Adds its terms, multiplied by `weight`.
    fn add_terms(&self, weight: f64, terms: &mut Vec<Term>) {
        let (form, constant, backward) = match self {
            Phase::Isotropic(_) => (Form::Even, isotropic::VALUE, false),
            Phase::HenyeyGreenstein(p) => {
                let (form, constant) = henyey_greenstein::Form::new(p.g);
                (Form::HenyeyGreenstein(form), constant, p.g < 0.0)
            }
            Phase::Schlick(p) => {
                let (form, constant) = schlick::Form::new(p.k);
                (Form::Schlick(form), constant, p.k < 0.0)
            }
            Phase::Rayleigh(_) => (Form::Rayleigh, rayleigh::CONSTANT, false),
            Phase::Draine(p) => {
                let (form, constant) = draine::Form::new(p);
                (Form::Draine(form), constant, p.g < 0.0)
            }
            Phase::Mixture(p) => return p.lobes.iter().for_each(|(share, p)| p.add_terms(weight * share, terms)),
        };
        terms.push(Term { weight: (weight * constant) as f32, backward, form, steepness: form.steepness() });
    }

    /// Its value per steradian for light deflected so.
    pub(super) fn at(&self, deflection: Deflection) -> f64 {
        match self {
            Phase::Isotropic(p) => p.at(deflection),
            Phase::HenyeyGreenstein(p) => p.at(deflection),
            Phase::Schlick(p) => p.at(deflection),
            Phase::Rayleigh(p) => p.at(deflection),
            Phase::Draine(p) => p.at(deflection),
            Phase::Mixture(p) => p.at(deflection),
        }
    }

    /// A deflection drawn from it, for `u` in [0, 1); more numbers come from the stream.
    pub(super) fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
        match self {
            Phase::Isotropic(p) => p.deflect(u, stream),
            Phase::HenyeyGreenstein(p) => p.deflect(u, stream),
            Phase::Schlick(p) => p.deflect(u, stream),
            Phase::Rayleigh(p) => p.deflect(u, stream),
            Phase::Draine(p) => p.deflect(u, stream),
            Phase::Mixture(p) => p.deflect(u, stream),
        }
    }
}

impl From<Isotropic> for Phase {
    fn from(phase: Isotropic) -> Phase {
        Phase::Isotropic(phase)
    }
}

impl From<HenyeyGreenstein> for Phase {
    fn from(phase: HenyeyGreenstein) -> Phase {
        Phase::HenyeyGreenstein(phase)
    }
}

impl From<Schlick> for Phase {
    fn from(phase: Schlick) -> Phase {
        Phase::Schlick(phase)
    }
}

impl From<Rayleigh> for Phase {
    fn from(phase: Rayleigh) -> Phase {
        Phase::Rayleigh(phase)
    }
}

impl From<Draine> for Phase {
    fn from(phase: Draine) -> Phase {
        Phase::Draine(phase)
    }
}

impl From<Mixture> for Phase {
    fn from(phase: Mixture) -> Phase {
        Phase::Mixture(phase)
    }
}

/// A weighted sum of phase functions.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
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
    fn only(&self) -> Option<&Phase> {
        match &self.lobes[..] {
            [(_, phase)] => Some(phase),
            _ => None,
        }
    }

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
        self.lobes.iter().map(|(weight, phase)| weight * phase.mean_cosine()).sum()
    }
}
