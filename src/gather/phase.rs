//! Phase functions as the beam query evaluates them: for sixteen photons at a time.

use crate::math::DVec3;
use crate::medium::phase::{self, Broad, Peak, Phase, Term};
use crate::medium::{Medium, Phases};
use crate::photon::simd::Lanes;
use std::f64::consts::PI;

/// A phase function made ready for beam queries.
///
/// Accurate to 2·10⁻⁵ up to |g| = 0.9999; lobes beyond |g| = 1 − 10⁻¹², narrower than any direction
/// in `f32` can tell, are taken as that.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseLanes(pub(super) Kind);

/// The ways in which a phase function is evaluated: two quick ones, and one for all.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    /// 1/4π.
    Isotropic,
    /// Henyey and Greenstein's of this g, from the cosine: for lobes that are not sharp.
    HenyeyGreenstein(f64),
    /// A sum of terms, each from the distance to its peak.
    Sum(Vec<Term>),
    /// The broad part of such a sum.
    Broad(Vec<Term>, Broad),
}

/// Above this |g|, 1 − cos θ is taken from the difference of directions: the cosine itself, of
/// directions rounded to `f32`, is wrong by 10⁻⁷, which is 10⁻⁵ of (1 − g)² here.
const SHARP: f64 = 0.8;

impl PhaseLanes {
    /// From the phase function of a medium.
    pub fn new(phase: impl Into<Phase>) -> Self {
        let phase: Phase = phase.into();
        PhaseLanes(match phase.henyey_greenstein() {
            _ if phase.is_even() => Kind::Isotropic,
            Some(g) if g.abs() <= SHARP => Kind::HenyeyGreenstein(g),
            _ => Kind::Sum(phase.sum()),
        })
    }

    /// Of all media: of those whose phase function has a peak in `peaks`, what is below that.
    pub fn of_media(media: &[Medium], peaks: &[Option<Peak>]) -> Vec<Self> {
        let peak = |index: usize| peaks.get(index).and_then(Option::as_ref);
        let of = |(index, medium): (usize, &Medium)| match peak(index) {
            Some(peak) => PhaseLanes::below(peak),
            None => match &medium.phase {
                Phases::Even(phase) => PhaseLanes::new(phase.clone()),
                // Photons tell theirs.
                phases => PhaseLanes(Kind::Sum(vec![Term::of_scaled_directions(phases.greatest_cosine())])),
            },
        };
        media.iter().enumerate().map(of).collect()
    }

    /// What there is below a peak.
    pub fn below(peak: &Peak) -> Self {
        PhaseLanes(Kind::Broad(peak.phase().sum(), peak.broad()))
    }

    /// How fast ⅔ of its logarithm changes with the angle, at most.
    pub(super) fn steepness(&self) -> f64 {
        match &self.0 {
            Kind::Isotropic => 0.0,
            Kind::HenyeyGreenstein(g) => phase::HenyeyGreenstein { g: *g }.steepness(),
            // No steeper than its steepest term.
            Kind::Sum(terms) => terms.iter().map(|term| term.steepness).fold(0.0, f64::max),
            Kind::Broad(_, broad) => broad.steepness,
        }
    }
}

/// Terms are evaluated for the photons of a block.
impl<L: Lanes> phase::Arithmetic for L {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Lanes::splat(x)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Lanes::sub(self, b)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Lanes::mul(self, b)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Lanes::mul_add(self, b, c)
    }
    #[inline(always)]
    fn rsqrt(self) -> Self {
        Lanes::rsqrt(self)
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Lanes::min(self, b)
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Lanes::max(self, b)
    }
}

/// Evaluates a phase function for one ray, up to a constant.
pub(super) trait Evaluate: Copy {
    /// What values must be multiplied by.
    fn constant(&self) -> f64;
    /// The values for photons that travel along `d`.
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L;
    /// Whether its type says that it is the same for all directions.
    const EVEN: bool = false;
    /// The same, one type for all kinds.
    fn any(&self) -> Any<'_>;
    /// For ω = z: the values, and κ such that for other ω near by they become values · (1 + κ (d·ω − d_z))^{−3/2},
    /// exactly or in first order.
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L);
}

/// The sum of a constant and of the product d·v, as fused operations.
#[inline(always)]
fn plus_dot<L: Lanes>(constant: f32, d: &[L; 3], v: &[f32; 3]) -> L {
    d[0].mul_add(L::splat(v[0]), d[1].mul_add(L::splat(v[1]), d[2].mul_add(L::splat(v[2]), L::splat(constant))))
}

/// 1/4π: the values are 1, the constant all of it.
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
    fn any(&self) -> Any<'_> {
        Any::Isotropic
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, _: &[L; 3]) -> (L, L) {
        (L::splat(1.0), L::splat(0.0))
    }
}

/// Henyey and Greenstein's function for light that travels along d and is scattered against the ray's direction ω:
/// (1 + g² + 2g d·ω)^{−3/2}, since cos θ = −d·ω.
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
    fn any(&self) -> Any<'_> {
        Any::HenyeyGreenstein(*self)
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        let y = d[2].mul_add(L::splat(self.slope[2]), L::splat(self.base)).rsqrt();
        let y2 = y.mul(y);
        (y2.mul(y), y2.mul(L::splat(self.slope[2])))
    }
}

/// A sum of terms, each a function of |d ± ω|². ω is kept in two parts, so that d ± ω is right to its own last place.
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
    fn any(&self) -> Any<'_> {
        Any::Sum(*self)
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

/// The broad part of a sum of terms.
#[derive(Clone, Copy)]
pub(super) struct BroadSum<'a> {
    sum: Sum<'a>,
    broad: Broad,
}

impl<'a> BroadSum<'a> {
    pub(super) fn new(terms: &'a [Term], broad: &Broad, omega: DVec3) -> Self {
        BroadSum { sum: Sum::new(terms, omega), broad: *broad }
    }
}

impl Evaluate for BroadSum<'_> {
    fn constant(&self) -> f64 {
        1.0
    }
    fn any(&self) -> Any<'_> {
        Any::Broad(*self)
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L {
        self.broad.value(Lanes::min(self.sum.values(d), L::splat(self.broad.high))).0
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        let (value, kappa) = self.sum.near_axis(d);
        let high = L::splat(self.broad.high);
        let below = Lanes::min(value, high);
        let (broad, slope) = self.broad.value(below);
        // Above the ceiling it does not change, however large κ is there.
        let kappa = kappa.mul(below.mul(slope)).div(broad.max(L::splat(f32::MIN_POSITIVE)));
        (broad, kappa.keep(value.less(high)))
    }
}

/// A phase function whose kind is looked at where it is evaluated: for code that is compiled once for all.
#[derive(Clone, Copy)]
pub(super) enum Any<'a> {
    Isotropic,
    HenyeyGreenstein(HenyeyGreenstein),
    Sum(Sum<'a>),
    Broad(BroadSum<'a>),
}

impl Evaluate for Any<'_> {
    fn constant(&self) -> f64 {
        match self {
            Any::Isotropic => Isotropic.constant(),
            Any::HenyeyGreenstein(phase) => phase.constant(),
            Any::Sum(phase) => phase.constant(),
            Any::Broad(phase) => phase.constant(),
        }
    }
    #[inline(always)]
    fn values<L: Lanes>(&self, d: &[L; 3]) -> L {
        match self {
            Any::Isotropic => Isotropic.values(d),
            Any::HenyeyGreenstein(phase) => phase.values(d),
            Any::Sum(phase) => phase.values(d),
            Any::Broad(phase) => phase.values(d),
        }
    }
    fn any(&self) -> Any<'_> {
        *self
    }
    #[inline(always)]
    fn near_axis<L: Lanes>(&self, d: &[L; 3]) -> (L, L) {
        match self {
            Any::Isotropic => Isotropic.near_axis(d),
            Any::HenyeyGreenstein(phase) => phase.near_axis(d),
            Any::Sum(phase) => phase.near_axis(d),
            Any::Broad(phase) => phase.near_axis(d),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::phase::{Draine, Mixture};
    use crate::photon::simd::{Isa, LANES, Row, Task};

    struct Values<'a> {
        phase: Any<'a>,
        directions: &'a [Row; 3],
    }

    impl Task for Values<'_> {
        type Output = Row;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Row {
            let mut row = Row([0.0; LANES]);
            self.phase.values::<L>(&self.directions.each_ref().map(L::load)).store(&mut row);
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
        let sum = |g: f64, alpha: f64, weight: f64| {
            let draine = Draine { g: 0.6 * g, alpha };
            Phase::from(Mixture::new(vec![
                (1.0 - weight, phase::HenyeyGreenstein { g }.into()),
                (weight, draine.into()),
            ]))
        };
        for phase in [sum(0.998, 32.3, 0.508), sum(0.97, 17.0, 0.448), sum(-0.9, 250.0, 0.3), sum(0.0, 250.0, 1.0)] {
            let (terms, peak) = (phase.sum(), Peak::new(&phase, 4.0));
            let whole = Any::Sum(Sum::new(&terms, omega));
            let broad = Any::Broad(BroadSum::new(&terms, &peak.broad(), omega));
            for (lanes, isa) in
                [whole, broad].into_iter().flat_map(|lanes| Isa::available().into_iter().map(move |isa| (lanes, isa)))
            {
                let found = isa.run(Values { phase: lanes, directions: &directions });
                for lane in 0..LANES {
                    let d = DVec3::from_array(std::array::from_fn(|axis| directions[axis].0[lane] as f64)).normalize();
                    let left_out = if matches!(lanes, Any::Broad(_)) { peak.value(d, -omega) } else { 0.0 };
                    let value = phase.value(d, -omega);
                    let error = (found.0[lane] as f64 + left_out) / value - 1.0;
                    assert!(error.abs() < 2e-5, "{isa:?}, {phase:?}, cosine {}: off by {error:e}", -d.dot(omega));
                }
            }
        }
    }
}
