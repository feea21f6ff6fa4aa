//! What phase functions promise.

use super::kind::Deflection;
use super::*;
use crate::math::random::Purpose;
use crate::math::{DVec3, Stream};
use std::f64::consts::TAU;

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
    for (g, alpha) in [(0.0, 1.0), (1e-8, 250.0), (0.3, 0.0), (0.6, 30.0), (-0.6, 30.0), (0.99, 1.0), (0.0, 250.0)] {
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
    fn min(self, b: Self) -> Self {
        f32::min(self, b)
    }
    fn max(self, b: Self) -> Self {
        f32::max(self, b)
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

/// What is left to photons and what to paths: together all of it, the one bounded, the other drawn as its value says.
#[test]
fn a_peak_and_what_is_below_it_make_up_the_whole() {
    const SAMPLES: usize = 20_000;
    let before = DVec3::new(0.36, -0.48, 0.8);
    for (name, phase, _) in kinds() {
        for ceiling in [0.7, 4.0] {
            let peak = Peak::new(&phase, ceiling);
            let most = ceiling / (2.0 * TAU);
            let second = integrate(&phase, |c| 2.0 * TAU * phase.value(before, aside(before, c)));
            if second < 1e4 {
                let off = (peak.second_moment() / second - 1.0).abs();
                assert!(off < 1e-3, "{name}: second moment {}, not {second}", peak.second_moment());
            }
            if peak.share() < 0.02 {
                continue;
            }
            let (terms, broad) = (phase.sum(), peak.broad());
            let (mut sum, mut squares, mut cosines) = (0.0, 0.0, 0.0);
            let mut stream = Stream::new(8, Purpose::Test, 0, 0);
            for _ in 0..SAMPLES {
                let (after, density) = peak.sample(before, &mut stream);
                let (value, whole) = (peak.value(before, after), phase.value(before, after));
                assert!((density * peak.share() / value - 1.0).abs() < 1e-5, "{name}: density {density} of {value}");
                let d = Deflection::between(before, after);
                let p = terms.iter().map(|term| {
                    let end = if term.backward { d.above_minus_one } else { d.below_one };
                    term.value((2.0 * end) as f32).0 * term.weight
                });
                let (below, slope) = broad.value(p.sum::<f32>().min(broad.high));
                let off = (f64::from(below) + value - whole).abs();
                assert!(off < 3e-5 * whole, "{name}, {ceiling}: {below} and {value} of {whole}");
                assert!(
                    f64::from(below) <= most * 1.000_01 && (0.0..=1.0).contains(&slope),
                    "{name}: {below}, {slope}"
                );
                let x = d.below_one.min(d.above_minus_one).sqrt();
                (sum, squares, cosines) = (sum + x, squares + x * x, cosines + d.cos);
            }
            let n = SAMPLES as f64;
            let ratio = |c: f64| peak.value(before, aside(before, c)) / phase.value(before, aside(before, c));
            let share = integrate(&phase, ratio);
            let expected = integrate(&phase, |c| ratio(c) * (1.0 - c.abs()).max(0.0).sqrt()) / share;
            let (mean, error) = (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt());
            let forward = (integrate(&phase, |c| c * ratio(c)) / share, cosines / n);
            let off = (mean - expected).abs();
            assert!((peak.share() / share - 1.0).abs() < 2e-3, "{name}: {} of all, not {share}", peak.share());
            assert!(off < 5.0 * error + 1e-3 * mean, "{name}, {ceiling}: {mean} ± {error}, not {expected}");
            assert!((forward.0 - forward.1).abs() < 0.02, "{name}, {ceiling}: mean cosine {forward:?}");
        }
    }
}

/// A direction at this cosine to another.
fn aside(before: DVec3, cos: f64) -> DVec3 {
    let across = before.cross(DVec3::X).normalize();
    (cos * before + (1.0 - cos * cos).max(0.0).sqrt() * across).normalize()
}
