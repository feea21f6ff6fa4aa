//! Phase functions: how scattered light spreads over directions.
//!
//! All are normalised over the sphere, and depend on the cosine between the direction light travels
//! in before and after scattering; *forward*, the unchanged direction, has cosine +1.
//!
//! [`Phase::value`], [`Phase::density`] and [`Phase::sample`] agree: `sample` draws directions whose density per
//! steradian is `density`, and says it with each; since all kinds are drawn from the phase function itself, that is
//! `value`.
//!
//! A kind is one file: a struct that answers what `Kind` asks. It is listed in [`Phase`], with its terms in
//! `term::Form`, and where scene files are read; nowhere else are kinds told apart.

mod draine;
mod henyey_greenstein;
mod isotropic;
mod mie;
mod mixture;
mod rayleigh;
mod schlick;
mod term;

pub use draine::Draine;
pub use henyey_greenstein::HenyeyGreenstein;
pub use isotropic::Isotropic;
pub use mie::{LARGEST_DIAMETER, mie};
pub use mixture::Mixture;
pub use rayleigh::Rayleigh;
pub use schlick::Schlick;
pub(crate) use term::{Arithmetic, Term};

use crate::math::{DVec3, Frame, Stream};
use std::f64::consts::TAU;

/// One of the phase functions a scene file can name.
#[derive(Clone, Debug, PartialEq)]
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

/// The narrowest lobe that terms tell apart, by its |g|: far narrower than any direction in `f32` can tell.
const NARROWEST: f64 = 1.0 - 1e-12;

/// What every kind of phase function answers.
trait Kind {
    /// Its value per steradian for light deflected so.
    fn at(&self, deflection: Deflection) -> f64;

    /// A deflection drawn from it, for `u` in [0, 1); more numbers come from the stream.
    fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection;

    /// The mean cosine of the deflection.
    fn mean_cosine(&self) -> f64;

    /// Adds its terms, multiplied by `weight`.
    fn terms(&self, weight: f64, terms: &mut Vec<Term>);
}

impl Kind for Phase {
    fn at(&self, deflection: Deflection) -> f64 {
        match self {
            Phase::Isotropic(p) => p.at(deflection),
            Phase::HenyeyGreenstein(p) => p.at(deflection),
            Phase::Schlick(p) => p.at(deflection),
            Phase::Rayleigh(p) => p.at(deflection),
            Phase::Draine(p) => p.at(deflection),
            Phase::Mixture(p) => p.at(deflection),
        }
    }

    fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
        match self {
            Phase::Isotropic(p) => p.deflect(u, stream),
            Phase::HenyeyGreenstein(p) => p.deflect(u, stream),
            Phase::Schlick(p) => p.deflect(u, stream),
            Phase::Rayleigh(p) => p.deflect(u, stream),
            Phase::Draine(p) => p.deflect(u, stream),
            Phase::Mixture(p) => p.deflect(u, stream),
        }
    }

    fn mean_cosine(&self) -> f64 {
        match self {
            Phase::Isotropic(p) => p.mean_cosine(),
            Phase::HenyeyGreenstein(p) => p.mean_cosine(),
            Phase::Schlick(p) => p.mean_cosine(),
            Phase::Rayleigh(p) => p.mean_cosine(),
            Phase::Draine(p) => p.mean_cosine(),
            Phase::Mixture(p) => p.mean_cosine(),
        }
    }

    fn terms(&self, weight: f64, terms: &mut Vec<Term>) {
        match self {
            Phase::Isotropic(p) => p.terms(weight, terms),
            Phase::HenyeyGreenstein(p) => p.terms(weight, terms),
            Phase::Schlick(p) => p.terms(weight, terms),
            Phase::Rayleigh(p) => p.terms(weight, terms),
            Phase::Draine(p) => p.terms(weight, terms),
            Phase::Mixture(p) => p.terms(weight, terms),
        }
    }
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
        Kind::mean_cosine(self)
    }

    /// Whether it is the same for all directions.
    pub fn is_even(&self) -> bool {
        matches!(self.only(), Phase::Isotropic(_))
    }

    /// The g of the Henyey–Greenstein function that it is, if it is one.
    pub fn henyey_greenstein(&self) -> Option<f64> {
        match self.only() {
            Phase::HenyeyGreenstein(p) => Some(p.g),
            _ => None,
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
        self.terms(1.0, &mut terms);
        terms
    }
}

/// The cosine of a scattering angle with its distances to both ends, none of which cancels.
#[derive(Clone, Copy, Debug)]
struct Deflection {
    /// The cosine of the angle, cos θ; forward +1.
    cos: f64,
    /// Its distance to +1, 1 − cos θ.
    below_one: f64,
    /// Its distance to −1, 1 + cos θ.
    above_minus_one: f64,
}

impl Deflection {
    /// Between two unit directions of travel.
    fn between(before: DVec3, after: DVec3) -> Self {
        let cos = before.dot(after);
        if cos >= 0.0 {
            let v = 0.5 * (after - before).length_squared();
            Deflection { cos: 1.0 - v, below_one: v, above_minus_one: 2.0 - v }
        } else {
            let v = 0.5 * (after + before).length_squared();
            Deflection { cos: v - 1.0, below_one: 2.0 - v, above_minus_one: v }
        }
    }

    /// From 1 − cos θ and 1 + cos θ.
    fn from_ends(below_one: f64, above_minus_one: f64) -> Self {
        let cos = if below_one < above_minus_one { 1.0 - below_one } else { above_minus_one - 1.0 };
        Deflection { cos, below_one, above_minus_one }
    }

    /// The angle measured from the opposite direction.
    fn mirrored(self) -> Self {
        Deflection { cos: -self.cos, below_one: self.above_minus_one, above_minus_one: self.below_one }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;

    fn kinds() -> Vec<(String, Phase, f64)> {
        let mut kinds = vec![
            ("isotropic".into(), Phase::Isotropic(Isotropic), 0.0),
            ("rayleigh".into(), Phase::Rayleigh(Rayleigh), 0.0),
        ];
        for g in [0.0, 1e-8, 1e-4, 0.3, 0.75, 0.99, 0.9999] {
            for g in [g, -g] {
                kinds.push((format!("hg {g}"), Phase::HenyeyGreenstein(HenyeyGreenstein { g }), g));
                // Mean cosine by series near 0, where the closed form cancels.
                let mean = if g.abs() < 1e-3 {
                    g * (2.0 / 3.0)
                } else {
                    1.0 / g + (1.0 - g * g) / (2.0 * g * g) * ((1.0 - g) / (1.0 + g)).ln()
                };
                kinds.push((format!("schlick {g}"), Phase::Schlick(Schlick { k: g }), mean));
            }
        }
        let lobes = vec![
            (0.8, Phase::HenyeyGreenstein(HenyeyGreenstein { g: 0.8 })),
            (0.2, Phase::HenyeyGreenstein(HenyeyGreenstein { g: -0.5 })),
        ];
        // Mean cosines by quadrature over the textbook form.
        for (g, alpha) in [(0.0, 1.0), (1e-8, 250.0), (0.3, 0.0), (0.6, 30.0), (-0.6, 30.0), (0.99, 1.0), (0.0, 250.0)]
        {
            let n = 1_000_000;
            let [sum, cosines] = (0..n).fold([0.0; 2], |[sum, cosines], i| {
                let c = 2.0 * (i as f64 + 0.5) / n as f64 - 1.0;
                let p = (1.0 + alpha * c * c) / (1.0 + g * g - 2.0 * g * c).powf(1.5);
                [sum + p, cosines + c * p]
            });
            kinds.push((format!("draine {g} {alpha}"), Phase::Draine(Draine { g, alpha }), cosines / sum));
        }
        for (diameter, mean) in [(0.05, 0.0374), (0.5, 0.8180), (3.0, 0.8139), (10.0, 0.8642), (50.0, 0.8912)] {
            // From a transcription of the fit elsewhere, four digits.
            let phase = Phase::Mixture(mie(diameter));
            assert!((phase.mean_cosine() - mean).abs() < 1e-4, "{diameter} µm: {}", phase.mean_cosine());
            let mean = phase.mean_cosine();
            kinds.push((format!("mie {diameter}"), phase, mean));
        }
        kinds.push(("mixture".into(), Phase::Mixture(Mixture::new(lobes)), 0.8 * 0.8 - 0.2 * 0.5));
        kinds
    }

    /// ∫ f(cos θ) p dω over the sphere, with 1 ∓ cos θ as the variable on either half, spaced
    /// logarithmically so that the sharpest peak is resolved.
    fn integrate(phase: &Phase, f: impl Fn(f64) -> f64) -> f64 {
        let mut sum = 0.0;
        let n = 20_000;
        let (low, high) = (-40f64, 0f64);
        for forward in [true, false] {
            for i in 0..n {
                let x = low + (high - low) * (i as f64 + 0.5) / n as f64;
                let v = x.exp();
                let d = if forward { Deflection::from_ends(v, 2.0 - v) } else { Deflection::from_ends(2.0 - v, v) };
                sum += TAU * f(d.cos) * phase.at(d) * v * (high - low) / n as f64;
            }
        }
        sum
    }

    #[test]
    fn each_is_normalised_with_its_mean_cosine() {
        for (name, phase, mean) in kinds() {
            let total = integrate(&phase, |_| 1.0);
            assert!((total - 1.0).abs() < 1e-6, "{name}: ∫p = {total}");
            let cos = integrate(&phase, |c| c);
            assert!((cos - mean).abs() < 1e-6, "{name}: mean cosine {cos}, expected {mean}");
            assert!((phase.mean_cosine() - mean).abs() < 1e-6, "{name}: states {}", phase.mean_cosine());
        }
    }

    impl Arithmetic for f32 {
        fn splat(x: f32) -> Self {
            x
        }
        fn sub(self, b: Self) -> Self {
            self - b
        }
        fn mul(self, b: Self) -> Self {
            self * b
        }
        fn mul_add(self, b: Self, c: Self) -> Self {
            f32::mul_add(self, b, c)
        }
        fn rsqrt(self) -> Self {
            self.sqrt().recip()
        }
    }

    /// Terms add up to the value, their derivatives to its change, which is no steeper than they say.
    #[test]
    fn terms_are_what_they_stand_for() {
        for (name, phase, _) in kinds() {
            let terms = phase.sum();
            let steepest = terms.iter().map(|term| term.steepness).fold(0.0, f64::max);
            let mirrored = phase.mean_cosine() < 0.0;
            // From v = 1 − cos θ, or its mirror image: whichever end is sharper.
            let deflection = |v: f64| {
                let d = Deflection::from_ends(v, 2.0 - v);
                if mirrored { d.mirrored() } else { d }
            };
            for i in 0..200 {
                let v = (1.99f64.ln() - 0.125 * i as f64).exp();
                let (d, expected) = (deflection(v), phase.at(deflection(v)));
                let (mut value, mut by_cosine) = (0.0, 0.0);
                for term in &terms {
                    let (end, sign) = if term.backward { (d.above_minus_one, 2.0) } else { (d.below_one, -2.0) };
                    let (function, derivative) = term.value((2.0 * end) as f32);
                    value += f64::from(function * term.weight);
                    by_cosine += sign * f64::from(derivative * term.weight);
                }
                assert!((value / expected - 1.0).abs() < 2e-5, "{name} at {d:?}: {value}, not {expected}");

                // The change of the value with ln v, by central differences.
                let step = 1e-4;
                let change =
                    (phase.at(deflection(v * (1.0 + step))) - phase.at(deflection(v * (1.0 - step)))) / (2.0 * step);
                let found = if mirrored { by_cosine * v } else { -by_cosine * v };
                let off = (found - change).abs();
                assert!(off < 2e-3 * change.abs() + 1e-6 * expected, "{name} at {d:?}: {found}, not {change}");

                let sin = (d.below_one * d.above_minus_one).max(0.0).sqrt();
                let steepness = 2.0 / 3.0 * (by_cosine * sin / expected).abs();
                assert!(steepness <= steepest * 1.001 + 1e-6, "{name} at {d:?}: {steepness} beyond {steepest}");
            }
        }
    }

    /// The share of samples below each of 32 deflections of equal probability: χ² against uniform,
    /// with the bound of one failure in a million over all kinds.
    #[test]
    fn samples_follow_the_value() {
        const BINS: usize = 32;
        const SAMPLES: usize = 64_000;
        for (name, phase, _) in kinds() {
            // The distribution function over x = ln(1 − cos) or its mirror image, whichever end is sharper.
            let mirrored = phase.mean_cosine() < 0.0;
            let value = |v: f64| {
                let d = Deflection::from_ends(v, 2.0 - v);
                phase.at(if mirrored { d.mirrored() } else { d })
            };
            let n = 40_000;
            let (low, high) = (-40f64, 2f64.ln());
            let step = (high - low) / n as f64;
            let mut cdf = vec![0.0];
            for i in 0..n {
                let v = (low + (i as f64 + 0.5) * step).exp();
                cdf.push(cdf[i] + TAU * value(v) * v * step);
            }
            let mut counts = [0u32; BINS];
            let mut stream = Stream::new(7, Purpose::Test, 0, 0);
            let before = DVec3::new(0.36, -0.48, 0.8);
            for _ in 0..SAMPLES {
                let (after, density) = phase.sample(before, &mut stream);
                assert!(density.is_finite() && density > 0.0, "{name}: density {density}");
                assert!((after.length() - 1.0).abs() < 1e-12);
                assert!((density / phase.density(before, after) - 1.0).abs() < 1e-6, "{name}: density {density}");
                let d = Deflection::between(before, after);
                let v = if mirrored { d.above_minus_one } else { d.below_one };
                let x = ((v.max(1e-300).ln() - low) / step).clamp(0.0, n as f64 - 1e-6);
                let (i, f) = (x as usize, x.fract());
                let share = cdf[i] + f * (cdf[i + 1] - cdf[i]);
                counts[((share * BINS as f64) as usize).min(BINS - 1)] += 1;
            }
            let expected = SAMPLES as f64 / BINS as f64;
            let chi2: f64 = counts.iter().map(|&c| (c as f64 - expected).powi(2) / expected).sum();
            // 31 degrees of freedom: mean 31, deviation 7.9.
            assert!(chi2 < 85.0, "{name}: χ² = {chi2}, {counts:?}");
        }
    }

    #[test]
    fn the_ends_of_the_random_range_are_in_domain() {
        for (name, phase, _) in kinds() {
            let mut stream = Stream::new(1, Purpose::Test, 0, 0);
            for u in [0.0, 1e-300, 0.5, 1.0 - f64::EPSILON / 2.0, 1.0 - 2f64.powi(-24)] {
                let d = phase.deflect(u, &mut stream);
                assert!(d.cos.abs() <= 1.0 && d.below_one >= 0.0 && d.above_minus_one >= 0.0, "{name} at {u}: {d:?}");
                assert!((d.below_one + d.above_minus_one - 2.0).abs() < 1e-9, "{name} at {u}: {d:?}");
                assert!(phase.at(d).is_finite(), "{name} at {u}");
            }
        }
    }
}
