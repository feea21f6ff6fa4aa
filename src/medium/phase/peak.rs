//! A phase function in two parts, of which photons estimate one, and paths the other.

use super::all::Phase;
use super::kind::{Arithmetic, Deflection};
use crate::math::{DVec3, Stream};
use std::f64::consts::{PI, TAU};

/// The peak of a phase function p: what is left of it above its broad part, which is about min(p, c).
///
/// Photons whose directions fall into the peak would count hundreds of times more than others. So they count by the broad part
/// alone, b(p), which is never above c; and what the rest p − b(p) sends is looked for by paths that go on in its directions.
/// b bends from p to c between c/2 and 3c/2, as a parabola: it has a slope everywhere, by which the rays of a bundle are told
/// apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Peak {
    phase: Phase,
    shoulder: Shoulder,
    share: f64,
    second_moment: f64,
    steepness: f64,
}

/// Where the broad part bends: it is p up to `low`, and c, in the middle of both, from `high` on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shoulder {
    low: f64,
    high: f64,
}

impl Shoulder {
    /// By how much the broad part is less than a value p of the phase function, or than `high` if p is more.
    fn bend(self, p: f64) -> f64 {
        let over = (p.min(self.high) - self.low).max(0.0);
        0.5 * over * over / (self.high - self.low)
    }

    /// The broad part of a value p of the phase function.
    fn below(self, p: f64) -> f64 {
        p.min(self.high) - self.bend(p)
    }

    /// What is left of it.
    fn above(self, p: f64) -> f64 {
        self.bend(p) + (p - self.high).max(0.0)
    }
}

/// Points of a quadrature over either hemisphere, spaced evenly by the logarithm of 1 ∓ cos θ,
const POINTS: usize = 14_000;
/// which begins at e to this.
const NARROWEST: f64 = -70.0;

impl Peak {
    /// What is above a broad part of at most `ceiling`/4π, that many times an isotropic phase function.
    pub fn new(phase: &Phase, ceiling: f64) -> Peak {
        let c = ceiling / (4.0 * PI);
        let shoulder = Shoulder { low: 0.5 * c, high: 1.5 * c };
        let mut peak = Peak { phase: phase.clone(), shoulder, share: 0.0, second_moment: 0.0, steepness: 0.0 };
        let step = -NARROWEST / POINTS as f64;
        for mirrored in [false, true] {
            // The broad part's logarithm, and the angle from the pole.
            let mut last: Option<(f64, f64)> = None;
            for i in 0..POINTS {
                let v = (NARROWEST + (i as f64 + 0.5) * step).exp();
                let deflection = Deflection::from_ends(v, 2.0 - v);
                let p = phase.at(if mirrored { deflection.mirrored() } else { deflection });
                let above = shoulder.above(p);
                peak.share += TAU * above * v * step;
                peak.second_moment += TAU * 4.0 * PI * p * p * v * step;
                let (angle, broad) = (2.0 * (0.5 * v).sqrt().asin(), shoulder.below(p).ln());
                if let Some((before, other)) = last {
                    peak.steepness = peak.steepness.max(2.0 / 3.0 * ((broad - other) / (angle - before)).abs());
                }
                last = Some((angle, broad));
            }
        }
        peak
    }

    /// Its share of what is scattered, ∫ (p − b(p)) dω.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// 4π ∫ p² dω of the whole phase function: about how many times the variance of a sum over photons is that of isotropic
    /// scattering.
    pub fn second_moment(&self) -> f64 {
        self.second_moment
    }

    /// The phase function of which it is a part.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// Its value per steradian for light that travelled along `before` and goes on along `after`, both of length 1.
    pub fn value(&self, before: DVec3, after: DVec3) -> f64 {
        self.shoulder.above(self.phase.value(before, after))
    }

    /// A direction in which light goes on that travelled along `before`, and its density per steradian, which is
    /// [`Peak::value`] over [`Peak::share`]. Drawn from the whole phase function until one is of the peak, once in 1/share times.
    pub fn sample(&self, before: DVec3, stream: &mut Stream) -> (DVec3, f64) {
        loop {
            let (after, p) = self.phase.sample(before, stream);
            let above = self.shoulder.above(p);
            if stream.uniform() * p < above {
                return (after, above / self.share);
            }
        }
    }

    /// The broad part, as many photons are evaluated at a time.
    pub(crate) fn broad(&self) -> Broad {
        let Shoulder { low, high } = self.shoulder;
        let (low, high) = (low as f32, high as f32);
        Broad { low, high, inverse: (high - low).recip(), steepness: self.steepness }
    }
}

/// The broad part of a phase function, of its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Broad {
    low: f32,
    pub(crate) high: f32,
    inverse: f32,
    /// How fast ⅔ of its logarithm changes with the angle, at most, per radian.
    pub(crate) steepness: f64,
}

impl Broad {
    /// Of a value no greater than `high`: the broad part, and its derivative by that value.
    #[inline(always)]
    pub(crate) fn value<N: Arithmetic>(&self, p: N) -> (N, N) {
        let bent = p.sub(N::splat(self.low)).max(N::splat(0.0));
        let broad = bent.mul(bent).mul_add(N::splat(-0.5 * self.inverse), p);
        let slope = N::splat(self.high).sub(p).mul(N::splat(self.inverse)).min(N::splat(1.0));
        (broad, slope)
    }
}
