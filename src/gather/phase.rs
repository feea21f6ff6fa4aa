//! Phase functions as the beam query evaluates them: for sixteen photons at a time.

use crate::math::DVec3;
use crate::photon::simd::Lanes;
use std::f64::consts::PI;

/// One lobe of a phase function; cosines are those of the angle of deflection, forward positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lobe {
    /// 1/4π.
    Isotropic,
    /// Henyey and Greenstein's (1 − g²)/(4π (1 + g² − 2g cos θ)^{3/2}), |g| < 1.
    HenyeyGreenstein(f64),
    /// Schlick's (1 − k²)/(4π (1 − k cos θ)²), |k| < 1.
    Schlick(f64),
    /// 3/16π (1 + cos² θ).
    Rayleigh,
    /// Draine's: Henyey–Greenstein of g, |g| < 1, times (1 + α cos² θ)/(1 + α (1 + 2g²)/3); g and α ≥ 0.
    Draine(f64, f64),
}

/// A phase function made ready for beam queries.
///
/// Accurate to 2·10⁻⁵ up to |g| = 0.9999; lobes beyond |g| = 1 − 10⁻¹², narrower than any direction
/// in `f32` can tell, are taken as that.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseLanes(pub(super) Kind);

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    Isotropic,
    HenyeyGreenstein(f64),
    Schlick(f64),
    Rayleigh,
    Sum(Vec<Term>),
}

/// Above this |g|, 1 − cos θ is taken from the difference of directions: the cosine itself, of
/// directions rounded to `f32`, is wrong by 10⁻⁷, which is 10⁻⁵ of (1 − g)² here.
const SHARP: f64 = 0.8;

/// The narrowest lobe.
const NARROWEST: f64 = 1.0 - 1e-12;

impl PhaseLanes {
    /// A single lobe.
    pub fn new(lobe: Lobe) -> Self {
        PhaseLanes(match lobe {
            Lobe::Isotropic => Kind::Isotropic,
            Lobe::HenyeyGreenstein(g) if g.abs() <= SHARP => Kind::HenyeyGreenstein(g),
            Lobe::Schlick(k) if k.abs() <= SHARP => Kind::Schlick(k),
            Lobe::Rayleigh => Kind::Rayleigh,
            sharp => Kind::Sum(vec![Term::new(1.0, sharp)]),
        })
    }

    /// How fast ⅔ of its logarithm changes with the angle, at most.
    pub(super) fn steepness(&self) -> f64 {
        let henyey_greenstein = |g: f64| 2.0 * g.abs() / (1.0 - g * g);
        let schlick = |k: f64| 4.0 / 3.0 * k.abs() / (1.0 - k * k).sqrt();
        match &self.0 {
            Kind::Isotropic => 0.0,
            Kind::HenyeyGreenstein(g) => henyey_greenstein(*g),
            Kind::Schlick(k) => schlick(*k),
            Kind::Rayleigh => 0.5,
            // No steeper than its steepest term.
            Kind::Sum(terms) => terms
                .iter()
                .map(|term| match term.shape {
                    Shape::Isotropic => 0.0,
                    Shape::HenyeyGreenstein => henyey_greenstein(f64::from(term.slope)),
                    Shape::Schlick => schlick(2.0 * f64::from(term.slope)),
                    Shape::Rayleigh => 0.5,
                    // Of 1 + α cos² θ the logarithm changes by at most α/√(1 + α).
                    Shape::Draine => {
                        let alpha = f64::from(term.alpha);
                        henyey_greenstein(f64::from(term.slope)) + 2.0 / 3.0 * alpha / (1.0 + alpha).sqrt()
                    }
                })
                .fold(0.0, f64::max),
        }
    }

    /// A weighted sum of lobes; weights should add up to 1.
    pub fn mixture(lobes: &[(f64, Lobe)]) -> Self {
        match lobes {
            [(weight, lobe)] if *weight == 1.0 => Self::new(*lobe),
            _ => PhaseLanes(Kind::Sum(lobes.iter().map(|&(weight, lobe)| Term::new(weight, lobe)).collect())),
        }
    }
}

/// Evaluates a phase function for one ray, up to a constant.
pub(super) trait Evaluate: Copy {
    /// What values must be multiplied by.
    fn constant(&self) -> f64;
    /// The values for photons that travel along `d`.
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L;
    /// Whether it is the same for all directions.
    const EVEN: bool = false;
    /// For ω = z: the values, and κ such that for other ω near by they become values · (1 + κ (d·ω − d_z))^{−3/2},
    /// exactly or in first order.
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L);
}

/// `constant + d·v`
#[inline(always)]
fn plus_dot<L: Lanes>(constant: f32, d: &[L; 3], v: &[f32; 3]) -> L {
    d[0].mul_add(L::splat(v[0]), d[1].mul_add(L::splat(v[1]), d[2].mul_add(L::splat(v[2]), L::splat(constant))))
}

#[derive(Clone, Copy)]
pub(super) struct Isotropic;

impl Evaluate for Isotropic {
    fn constant(&self) -> f64 {
        0.25 / PI
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, _: &[L; 3]) -> L {
        L::splat(1.0)
    }
    const EVEN: bool = true;
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, _: &[L; 3]) -> (L, L) {
        (L::splat(1.0), L::splat(0.0))
    }
}

/// Light that travels along d and is scattered against the ray's direction ω: cos θ = −d·ω.
#[derive(Clone, Copy)]
pub(super) struct HenyeyGreenstein {
    g: f64,
    base: f32,
    slope: [f32; 3],
}

impl HenyeyGreenstein {
    pub(super) fn new(g: f64, omega: DVec3) -> Self {
        HenyeyGreenstein { g, base: (1.0 + g * g) as f32, slope: (2.0 * g * omega).as_vec3().to_array() }
    }
}

impl Evaluate for HenyeyGreenstein {
    fn constant(&self) -> f64 {
        0.25 / PI * (1.0 - self.g * self.g)
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L {
        let y = plus_dot(self.base, d, &self.slope).rsqrt();
        y.mul(y).mul(y)
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        let y = d[2].mul_add(L::splat(self.slope[2]), L::splat(self.base)).rsqrt();
        let y2 = y.mul(y);
        (y2.mul(y), y2.mul(L::splat(self.slope[2])))
    }
}

#[derive(Clone, Copy)]
pub(super) struct Schlick {
    k: f64,
    slope: [f32; 3],
}

impl Schlick {
    pub(super) fn new(k: f64, omega: DVec3) -> Self {
        Schlick { k, slope: (k * omega).as_vec3().to_array() }
    }
}

impl Evaluate for Schlick {
    fn constant(&self) -> f64 {
        0.25 / PI * (1.0 - self.k * self.k)
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L {
        let y = plus_dot(1.0, d, &self.slope).rsqrt();
        let y2 = y.mul(y);
        y2.mul(y2)
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        let y = d[2].mul_add(L::splat(self.slope[2]), L::splat(1.0)).rsqrt();
        let y2 = y.mul(y);
        (y2.mul(y2), y2.mul(L::splat(4.0 / 3.0 * self.slope[2])))
    }
}

#[derive(Clone, Copy)]
pub(super) struct Rayleigh {
    omega: [f32; 3],
}

impl Rayleigh {
    pub(super) fn new(omega: DVec3) -> Self {
        Rayleigh { omega: omega.as_vec3().to_array() }
    }
}

impl Evaluate for Rayleigh {
    fn constant(&self) -> f64 {
        3.0 / 16.0 / PI
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L {
        let c = plus_dot(0.0, d, &self.omega);
        c.mul_add(c, L::splat(1.0))
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        let value = d[2].mul_add(d[2], L::splat(1.0));
        (value, d[2].mul(L::splat(-4.0 / 3.0)).div(value))
    }
}

/// A lobe of a sum, as a function of |d ± ω|² = 2 (1 ∓ cos θ), which does not cancel at the peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Term {
    shape: Shape,
    /// Whether the peak is backward.
    backward: bool,
    base: f32,
    slope: f32,
    /// Draine's α; else 0.
    alpha: f32,
    weight: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Isotropic,
    HenyeyGreenstein,
    Schlick,
    Rayleigh,
    Draine,
}

impl Term {
    fn new(weight: f64, lobe: Lobe) -> Self {
        let (shape, g, base, slope, constant) = match lobe {
            Lobe::Isotropic => (Shape::Isotropic, 0.0, 0.0, 0.0, 0.25 / PI),
            Lobe::HenyeyGreenstein(g) | Lobe::Draine(g, _) => {
                let a = g.abs().min(NARROWEST);
                (Shape::HenyeyGreenstein, g, (1.0 - a).powi(2), a, 0.25 / PI * (1.0 - a) * (1.0 + a))
            }
            Lobe::Schlick(k) => {
                let a = k.abs().min(NARROWEST);
                (Shape::Schlick, k, 1.0 - a, 0.5 * a, 0.25 / PI * (1.0 - a) * (1.0 + a))
            }
            Lobe::Rayleigh => (Shape::Rayleigh, 0.0, 1.0, -0.5, 3.0 / 16.0 / PI),
        };
        let (shape, alpha, constant) = match lobe {
            Lobe::Draine(g, alpha) => (Shape::Draine, alpha, constant / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)),
            _ => (shape, 0.0, constant),
        };
        Term {
            shape,
            backward: g < 0.0,
            base: base as f32,
            slope: slope as f32,
            alpha: alpha as f32,
            weight: (weight * constant) as f32,
        }
    }
}

/// A sum of lobes. ω is kept in two parts, so that d ± ω is right to its own last place.
#[derive(Clone, Copy)]
pub(super) struct Sum<'a> {
    terms: &'a [Term],
    high: [f32; 3],
    low: [f32; 3],
}

impl<'a> Sum<'a> {
    pub(super) fn new(terms: &'a [Term], omega: DVec3) -> Self {
        let high = omega.as_vec3();
        let low = (omega - high.as_dvec3()).as_vec3();
        Sum { terms, high: high.to_array(), low: low.to_array() }
    }
}

/// |d + sign·(high + low)|²
#[inline(always)]
fn squared_sum<L: Lanes>(d: &[L; 3], high: &[f32; 3], low: &[f32; 3], sign: f32) -> L {
    let x = d[0].add(L::splat(sign * high[0])).add(L::splat(sign * low[0]));
    let y = d[1].add(L::splat(sign * high[1])).add(L::splat(sign * low[1]));
    let z = d[2].add(L::splat(sign * high[2])).add(L::splat(sign * low[2]));
    x.mul_add(x, y.mul_add(y, z.mul(z)))
}

impl Evaluate for Sum<'_> {
    fn constant(&self) -> f64 {
        1.0
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L {
        let ahead = squared_sum::<L>(d, &self.high, &self.low, 1.0);
        let behind = squared_sum::<L>(d, &self.high, &self.low, -1.0);
        let mut sum = L::splat(0.0);
        for term in self.terms {
            let weight = L::splat(term.weight);
            let e2 = if term.backward { behind } else { ahead };
            sum = term.value(e2).0.mul_add(weight, sum);
        }
        sum
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        let ahead = squared_sum::<L>(d, &self.high, &self.low, 1.0);
        let behind = squared_sum::<L>(d, &self.high, &self.low, -1.0);
        let (mut sum, mut growth) = (L::splat(0.0), L::splat(0.0));
        for term in self.terms {
            let (e2, sign) = if term.backward { (behind, -2.0) } else { (ahead, 2.0) };
            // The term, and its derivative by d·ω, ±2 times that by |d ± ω|².
            let (value, derivative) = term.value(e2);
            sum = value.mul_add(L::splat(term.weight), sum);
            growth = derivative.mul_add(L::splat(sign * term.weight), growth);
        }
        (sum, growth.mul(L::splat(-2.0 / 3.0)).div(sum.max(L::splat(f32::MIN_POSITIVE))))
    }
}

impl Term {
    /// The lobe as a function of |d ± ω|², without its weight, and its derivative.
    #[inline(always)]
    fn value<L: Lanes>(&self, e2: L) -> (L, L) {
        let x = e2.mul_add(L::splat(self.slope), L::splat(self.base));
        let slope = |times: f32| L::splat(times * self.slope);
        match self.shape {
            Shape::Isotropic => (L::splat(1.0), L::splat(0.0)),
            Shape::HenyeyGreenstein => {
                let y = x.rsqrt();
                let y2 = y.mul(y);
                let value = y2.mul(y);
                (value, value.mul(y2).mul(slope(-1.5)))
            }
            Shape::Schlick => {
                let y = x.rsqrt();
                let y2 = y.mul(y);
                let value = y2.mul(y2);
                (value, value.mul(y2).mul(slope(-2.0)))
            }
            Shape::Rayleigh => (x.mul_add(x, L::splat(1.0)), x.mul(slope(2.0))),
            Shape::Draine => {
                let y = x.rsqrt();
                let y2 = y.mul(y);
                let lobe = y2.mul(y);
                // cos θ = 1 − |d ± ω|²/2 but for its sign.
                let cos = e2.mul_add(L::splat(-0.5), L::splat(1.0));
                let bent = cos.mul(L::splat(self.alpha));
                let value = lobe.mul(cos.mul_add(bent, L::splat(1.0)));
                (value, value.mul(y2).mul(slope(-1.5)).sub(lobe.mul(bent)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photon::simd::{Isa, LANES, Row, Task};

    struct Values<'a> {
        sum: Sum<'a>,
        directions: &'a [Row; 3],
    }

    impl Task for Values<'_> {
        type Output = Row;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Row {
            let mut row = Row([0.0; LANES]);
            self.sum.values::<L>(&self.directions.each_ref().map(L::load)).store(&mut row);
            row
        }
    }

    /// Light deflected by angles from none to half a turn, the smallest ones below what the cosine itself could
    /// tell in `f32`.
    #[test]
    fn lanes_keep_their_precision_up_to_the_peak() {
        let omega = DVec3::new(0.48, -0.6, 0.64);
        let aside = omega.cross(DVec3::X).normalize();
        let mut directions = [Row([0.0; LANES]); 3];
        for lane in 0..LANES {
            let angle = if lane == 0 { 0.0 } else { PI * 10f64.powf(-0.35 * (lane - 1) as f64) };
            let d = (-omega * angle.cos() + aside * angle.sin()).as_vec3();
            for axis in 0..3 {
                directions[axis].0[lane] = d[axis];
            }
        }
        let lobes = |g: f64, alpha: f64, weight: f64| {
            [(1.0 - weight, Lobe::HenyeyGreenstein(g)), (weight, Lobe::Draine(0.6 * g, alpha))]
        };
        for lobes in
            [lobes(0.998, 32.3, 0.508), lobes(0.97, 17.0, 0.448), lobes(-0.9, 250.0, 0.3), lobes(0.0, 250.0, 1.0)]
        {
            let PhaseLanes(Kind::Sum(terms)) = PhaseLanes::mixture(&lobes) else { panic!("one lobe") };
            for isa in Isa::available() {
                let found = isa.run(Values { sum: Sum::new(&terms, omega), directions: &directions });
                for lane in 0..LANES {
                    let d = DVec3::from_array(std::array::from_fn(|axis| directions[axis].0[lane] as f64)).normalize();
                    let cos = -d.dot(omega);
                    let henyey_greenstein = |g: f64| {
                        let peak = if g < 0.0 { omega } else { -omega };
                        let from_peak = (d - peak).length_squared();
                        (1.0 - g * g) / (4.0 * PI * ((1.0 - g.abs()).powi(2) + g.abs() * from_peak).powf(1.5))
                    };
                    let expected: f64 = lobes
                        .iter()
                        .map(|&(weight, lobe)| match lobe {
                            Lobe::Draine(g, alpha) => {
                                let quadratic = (1.0 + alpha * cos * cos) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0);
                                weight * henyey_greenstein(g) * quadratic
                            }
                            Lobe::HenyeyGreenstein(g) => weight * henyey_greenstein(g),
                            other => panic!("{other:?}"),
                        })
                        .sum();
                    let error = found.0[lane] as f64 / expected - 1.0;
                    assert!(error.abs() < 2e-5, "{isa:?}, {lobes:?}, cosine {cos}: off by {error:e}");
                }
            }
        }
    }
}
