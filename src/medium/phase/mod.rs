//! Phase functions: how scattered light spreads over directions.
//!
//! All are normalised over the sphere, and depend on the cosine between the direction light travels
//! in before and after scattering; *forward*, the unchanged direction, has cosine +1.
//! Sampling draws from the phase function itself, so its density is its value.

mod draine;
mod henyey_greenstein;
mod isotropic;
mod mie;
mod mixture;
mod rayleigh;
mod schlick;

pub use draine::Draine;
pub use henyey_greenstein::HenyeyGreenstein;
pub use isotropic::Isotropic;
pub use mie::{LARGEST_DIAMETER, mie};
pub use mixture::Mixture;
pub use rayleigh::Rayleigh;
pub use schlick::Schlick;

use crate::math::{DVec3, Frame, Stream};
use std::f64::consts::TAU;

/// One of the phase functions a scene file can name.
#[derive(Clone, Debug, PartialEq)]
pub enum Phase {
    /// Equal in all directions.
    Isotropic(Isotropic),
    /// Henyey–Greenstein.
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

/// The cosine of a scattering angle with its distances to both ends, none of which cancels.
#[derive(Clone, Copy, Debug)]
pub struct Deflection {
    /// cos θ.
    pub cos: f64,
    /// 1 − cos θ.
    pub below_one: f64,
    /// 1 + cos θ.
    pub above_minus_one: f64,
}

impl Deflection {
    /// Between two unit directions of travel.
    pub fn between(before: DVec3, after: DVec3) -> Self {
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

    /// The same angle measured from the opposite direction.
    fn mirrored(self) -> Self {
        Deflection { cos: -self.cos, below_one: self.above_minus_one, above_minus_one: self.below_one }
    }
}

impl Phase {
    /// Its value per steradian for light deflected so.
    pub fn value(&self, deflection: Deflection) -> f64 {
        match self {
            Phase::Isotropic(p) => p.value(),
            Phase::HenyeyGreenstein(p) => p.value(deflection),
            Phase::Schlick(p) => p.value(deflection),
            Phase::Rayleigh(p) => p.value(deflection),
            Phase::Draine(p) => p.value(deflection),
            Phase::Mixture(p) => p.value(deflection),
        }
    }

    /// Its value for light that travelled along `before` and goes on along `after`.
    pub fn between(&self, before: DVec3, after: DVec3) -> f64 {
        match self {
            Phase::Isotropic(p) => p.value(),
            _ => self.value(Deflection::between(before, after)),
        }
    }

    /// A deflection drawn from it, for `u` in [0, 1).
    fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection {
        match self {
            Phase::Isotropic(p) => p.deflect(u),
            Phase::HenyeyGreenstein(p) => p.deflect(u),
            Phase::Schlick(p) => p.deflect(u),
            Phase::Rayleigh(p) => p.deflect(u),
            Phase::Draine(p) => p.deflect(u, stream),
            Phase::Mixture(p) => p.deflect(u, stream),
        }
    }

    /// A new direction of travel for light that travelled along `before`, and its density per
    /// steradian, which is the phase function's value.
    pub fn sample(&self, before: DVec3, stream: &mut Stream) -> (DVec3, f64) {
        let [u, turn] = stream.uniform2();
        let deflection = self.deflect(u, stream);
        let sin = (deflection.below_one * deflection.above_minus_one).max(0.0).sqrt();
        let (s, c) = (TAU * turn).sin_cos();
        let after = Frame::around(before).to_world(DVec3::new(sin * c, sin * s, deflection.cos));
        (after.normalize(), self.value(deflection))
    }

    /// The mean cosine of the deflection.
    pub fn mean_cosine(&self) -> f64 {
        match self {
            Phase::Isotropic(_) | Phase::Rayleigh(_) => 0.0,
            Phase::HenyeyGreenstein(p) => p.g,
            Phase::Schlick(p) => p.mean_cosine(),
            Phase::Draine(p) => p.mean_cosine(),
            Phase::Mixture(p) => p.mean_cosine(),
        }
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
                sum += TAU * f(d.cos) * phase.value(d) * v * (high - low) / n as f64;
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
                phase.value(if mirrored { d.mirrored() } else { d })
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
                assert!(phase.value(d).is_finite(), "{name} at {u}");
            }
        }
    }
}
