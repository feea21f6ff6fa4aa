//! The kernels that spread a photon over its disc or ball, and their shares on one side of a wall.

use super::simd::Lanes;
use std::f64::consts::PI;

/// How a kernel falls off with x, the distance over the radius: (1 − x²)^k inside of the unit disc or
/// ball, 0 outside and at its rim, normalised so that its integral is 1 (Silverman 1986, §4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// k = 0: the same everywhere inside.
    Constant,
    /// k = 1.
    Epanechnikov,
    /// k = 2: on discs 3/π (1 − x²)² (Jarosz et al. 2008, below Eq. 22).
    Biweight,
}

impl Profile {
    /// The kernel of a disc, K₂(x).
    pub fn disc(self, x: f64) -> f64 {
        self.disc_peak() * self.shape(x)
    }

    /// The kernel of a ball, K₃(x).
    pub fn ball(self, x: f64) -> f64 {
        self.ball_peak() * self.shape(x)
    }

    /// K₂(0) = (k + 1)/π.
    pub fn disc_peak(self) -> f64 {
        match self {
            Profile::Constant => 1.0 / PI,
            Profile::Epanechnikov => 2.0 / PI,
            Profile::Biweight => 3.0 / PI,
        }
    }

    /// K₃(0) = Γ(k + 5/2)/(Γ(k + 1) π^{3/2}).
    pub fn ball_peak(self) -> f64 {
        match self {
            Profile::Constant => 3.0 / (4.0 * PI),
            Profile::Epanechnikov => 15.0 / (8.0 * PI),
            Profile::Biweight => 105.0 / (32.0 * PI),
        }
    }

    /// (1 − x²)^k.
    fn shape(self, x: f64) -> f64 {
        let q = 1.0 - x * x;
        match self {
            _ if q <= 0.0 || q.is_nan() => 0.0,
            Profile::Constant => 1.0,
            Profile::Epanechnikov => q,
            Profile::Biweight => q * q,
        }
    }

    /// The share of the disc's kernel within `s ≥ 0` of its centre, in units of the radius: 1 − (1 − s²)^{k + 1}.
    pub fn disc_within(self, s: f64) -> f64 {
        let q = (1.0 - s * s).max(0.0);
        1.0 - match self {
            Profile::Constant => q,
            Profile::Epanechnikov => q * q,
            Profile::Biweight => q * q * q,
        }
    }

    /// How far from its centre the disc's kernel has this share, likewise: the inverse of [`Profile::disc_within`].
    pub fn disc_distance(self, share: f32) -> f32 {
        let power = match self {
            Profile::Constant => 1.0,
            Profile::Epanechnikov => 0.5,
            Profile::Biweight => 1.0 / 3.0,
        };
        (1.0 - (1.0 - share).powf(power)).sqrt()
    }

    /// The share of the disc's kernel on the near side of a line at distance `s ≥ 0` from its centre, in
    /// units of the radius: C(s) = ½ + C′(0) ∫₀ˢ (1 − x²)^{k + ½} dx, and 1 from s = 1 on.
    pub fn disc_share(self, s: f64) -> f64 {
        if s >= 1.0 {
            return 1.0;
        }
        let s = s.max(0.0);
        let (s2, chord, arc) = (s * s, s * (1.0 - s * s).sqrt(), s.asin());
        let beyond_centre = match self {
            Profile::Constant => (chord + arc) / PI,
            Profile::Epanechnikov => (chord * (5.0 - 2.0 * s2) + 3.0 * arc) / (3.0 * PI),
            Profile::Biweight => (chord * (s2 * (8.0 * s2 - 26.0) + 33.0) + 15.0 * arc) / (15.0 * PI),
        };
        0.5 + beyond_centre
    }

    /// The share of the ball's kernel on the near side of a plane, likewise:
    /// C(s) = ½ + C′(0) ∫₀ˢ (1 − x²)^{k + 1} dx.
    pub fn ball_share(self, s: f64) -> f64 {
        let s = s.clamp(0.0, 1.0);
        let s2 = s * s;
        let beyond_centre = match self {
            Profile::Constant => (3.0 - s2) / 4.0,
            Profile::Epanechnikov => (15.0 + s2 * (3.0 * s2 - 10.0)) / 16.0,
            Profile::Biweight => (35.0 + s2 * (s2 * (21.0 - 5.0 * s2) - 35.0)) / 32.0,
        };
        0.5 + s * beyond_centre
    }

    /// The share of the ball's kernel within `s ≥ 0` of its centre, in units of the radius: ∫₀ˢ 4πx² K₃(x) dx.
    pub fn ball_within(self, s: f64) -> f64 {
        let s = s.clamp(0.0, 1.0);
        let s2 = s * s;
        s * s2
            * match self {
                Profile::Constant => 1.0,
                Profile::Epanechnikov => 2.5 - 1.5 * s2,
                Profile::Biweight => 4.375 + s2 * (1.875 * s2 - 5.25),
            }
    }

    /// The share of the ball's kernel that two planes leave, at distances `s ≥ 0` from its centre, in units of the
    /// radius, the cosine between their normals being `cosine`: 1 less the parts beyond each, and again what is beyond
    /// both.
    pub fn ball_share_of_two(self, s: [f64; 2], cosine: f64) -> f64 {
        let [a, b] = s.map(|s| s.clamp(0.0, 1.0));
        let angle = cosine.clamp(-1.0, 1.0).acos();
        // In the plane of both normals, directions from the first normal on: towards the planes' common line.
        let edge = if a + b > 0.0 { f64::atan2(b - a * angle.cos(), a * angle.sin()) } else { 0.5 * angle };
        let beyond_both = (self.ball_beyond(a, edge) + self.ball_beyond(b, angle - edge)) / (2.0 * PI);
        (self.ball_share(a) + self.ball_share(b) - 1.0 + beyond_both).clamp(0.0, 1.0)
    }

    /// 2π times the share of the ball's kernel beyond a plane at a distance `a`, in directions of more than `from` away
    /// from its normal, to one side, as projected along a line in that plane.
    ///
    /// The projection is ∝ (1 − ρ²)^{k + ½}, so this is ∫ (1 − a²/cos²u)^{k + 3/2} du from `from` on. With
    /// sin u = c sin θ, c² = 1 − a², D = a² + c² cos²θ, it is ∫ (1 − a²/D)^{k + 2} dθ: a sum of the
    /// Jₙ = ∫ (a²/D)ⁿ dθ up to π/2, of which J₀ and J₁ are known, and
    /// 2n Jₙ₊₁ = (2n − 1)(1 + a²) Jₙ − (2n − 2) a² Jₙ₋₁ + (a²/D)ⁿ c² sin θ cos θ.
    fn ball_beyond(self, a: f64, from: f64) -> f64 {
        let binomials: &[f64] = match self {
            Profile::Constant => &[1.0, -2.0, 1.0],
            Profile::Epanechnikov => &[1.0, -3.0, 3.0, -1.0],
            Profile::Biweight => &[1.0, -4.0, 6.0, -4.0, 1.0],
        };
        let (a2, c2) = (a * a, 1.0 - a * a);
        if c2 <= 0.0 {
            return 0.0;
        }
        let widest = a.acos();
        let theta = (from.clamp(-widest, widest).sin() / c2.sqrt()).clamp(-1.0, 1.0).asin();
        let (sin, cos) = theta.sin_cos();
        let ratio = a2 / (a2 + c2 * cos * cos).max(f64::MIN_POSITIVE);
        let (mut before, mut here) = (0.5 * PI - theta, a * (0.5 * PI - f64::atan2(a * sin, cos)));
        let mut sum = binomials[0] * before + binomials[1] * here;
        let mut power = 1.0;
        for (n, binomial) in (1..).zip(&binomials[2..]) {
            let n = f64::from(n);
            power *= ratio;
            let next = (2.0 * n - 1.0) * (1.0 + a2) * here - (2.0 * n - 2.0) * a2 * before + power * c2 * sin * cos;
            (before, here) = (here, next / (2.0 * n));
            sum += binomial * here;
        }
        sum
    }
}

impl Profile {
    /// (1 − x²)^k as c₀ + c₁ q + c₂ q², q = 1 − x² > 0: for loops that are not worth compiling three times.
    pub(crate) fn polynomial(self) -> [f32; 3] {
        match self {
            Profile::Constant => [1.0, 0.0, 0.0],
            Profile::Epanechnikov => [0.0, 1.0, 0.0],
            Profile::Biweight => [0.0, 0.0, 1.0],
        }
    }

    /// [`Profile::disc_share`] of √s², to 3·10⁻⁶.
    #[inline(always)]
    pub(crate) fn disc_share_lanes<L: Lanes>(self, s2: L) -> L {
        match self {
            Profile::Constant => Constant::disc_share(s2),
            Profile::Epanechnikov => Epanechnikov::disc_share(s2),
            Profile::Biweight => Biweight::disc_share(s2),
        }
    }
}

/// A profile as queries evaluate it: for sixteen photons at a time, without its peak.
pub(crate) trait Shape: Copy {
    /// (1 − x²)^k from `q` = 1 − x² > 0.
    fn value<L: Lanes>(q: L) -> L;
    /// [`Profile::disc_share`] of √s², to 3·10⁻⁶.
    fn disc_share<L: Lanes>(s2: L) -> L;
}

/// [`Profile::Constant`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Constant;

/// [`Profile::Epanechnikov`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Epanechnikov;

/// [`Profile::Biweight`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Biweight;

// The share beyond the line is (1 − s)^{k + 3/2} times a smooth function of s, for which these are
// minimax polynomials: shares to 1.7·10⁻⁶, 0.8·10⁻⁶ and 1.0·10⁻⁶.
const CONSTANT_BEYOND: [f32; 4] = [0.500_001_7, 0.113_276_6, -0.016_514_796, 0.003_570_935];
const EPANECHNIKOV_BEYOND: [f32; 4] = [0.499_999_2, 0.401_232_78, 0.064_810_82, -0.005_927_688_6];
const BIWEIGHT_BEYOND: [f32; 4] = [0.500_001, 0.731_319_64, 0.373_511_54, 0.042_250_29];

/// From s² capped at 1: 1 − s, its power 3/2, and the polynomial of s.
#[inline(always)]
fn beyond<L: Lanes>(s2: L, c: &[f32; 4]) -> (L, L, L) {
    let s = s2.min(L::splat(1.0)).sqrt();
    let rest = L::splat(1.0).sub(s);
    let p = s.mul_add(L::splat(c[3]), L::splat(c[2])).mul_add(s, L::splat(c[1])).mul_add(s, L::splat(c[0]));
    (rest, rest.mul(rest.sqrt()), p)
}

impl Shape for Constant {
    #[inline(always)]
    fn value<L: Lanes>(_: L) -> L {
        L::splat(1.0)
    }
    #[inline(always)]
    fn disc_share<L: Lanes>(s2: L) -> L {
        let (_, power, p) = beyond(s2, &CONSTANT_BEYOND);
        power.neg_mul_add(p, L::splat(1.0))
    }
}

impl Shape for Epanechnikov {
    #[inline(always)]
    fn value<L: Lanes>(q: L) -> L {
        q
    }
    #[inline(always)]
    fn disc_share<L: Lanes>(s2: L) -> L {
        let (rest, power, p) = beyond(s2, &EPANECHNIKOV_BEYOND);
        power.mul(rest).neg_mul_add(p, L::splat(1.0))
    }
}

impl Shape for Biweight {
    #[inline(always)]
    fn value<L: Lanes>(q: L) -> L {
        q.mul(q)
    }
    #[inline(always)]
    fn disc_share<L: Lanes>(s2: L) -> L {
        let (rest, power, p) = beyond(s2, &BIWEIGHT_BEYOND);
        power.mul(rest.mul(rest)).neg_mul_add(p, L::splat(1.0))
    }
}

/// Coefficients of 1/C(s), by interpolation at Chebyshev's nodes: 4·10⁻⁵ on [0, 1].
const INVERSE_DISC_SHARE: [f32; 8] =
    [1.999_942_1, -4.066_888, 8.136_03, -12.079_031, 14.034_813, -11.070_336, 5.078_787, -1.033_356];

/// 1 over the biweight's [`Profile::disc_share`] of s, in lanes, to 5·10⁻⁵; anything below 0.
#[inline(always)]
pub(crate) fn inverse_biweight_share<L: Lanes>(s: L) -> L {
    let s = s.min(L::splat(1.0));
    let mut p = L::splat(INVERSE_DISC_SHARE[7]);
    for coefficient in INVERSE_DISC_SHARE[..7].iter().rev() {
        p = p.mul_add(s, L::splat(*coefficient));
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photon::simd::{Isa, LANES, Row, Task};
    use std::marker::PhantomData;

    const ALL: [Profile; 3] = [Profile::Constant, Profile::Epanechnikov, Profile::Biweight];

    struct Share<S>(Row, PhantomData<S>);
    impl<S: Shape> Task for Share<S> {
        type Output = Row;
        #[inline(always)]
        fn run<L: Lanes>(mut self) -> Row {
            S::disc_share(L::load(&self.0)).store(&mut self.0);
            self.0
        }
    }

    struct Value<S>(Row, PhantomData<S>);
    impl<S: Shape> Task for Value<S> {
        type Output = Row;
        #[inline(always)]
        fn run<L: Lanes>(mut self) -> Row {
            S::value(L::load(&self.0)).store(&mut self.0);
            self.0
        }
    }

    /// ∫ f from a to b by the midpoint rule, after x = a + (b − a)(1 − cos πu)/2, which levels square roots at both
    /// ends.
    fn integral(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
        const N: usize = 400;
        let at = |i: usize| (i as f64 + 0.5) / N as f64 * PI;
        let part = |u: f64| f(a + (b - a) * 0.5 * (1.0 - u.cos())) * 0.5 * (b - a) * PI * u.sin();
        (0..N).map(|i| part(at(i))).sum::<f64>() / N as f64
    }

    #[test]
    fn shares_are_the_masses_of_the_kernels_beside_a_wall() {
        for profile in ALL {
            for s in [0.0, 0.1, 0.37, 0.75, 0.9, 1.0, 7.0] {
                let disc = integral(-1.0, f64::min(s, 1.0), |x| {
                    let chord = (1.0 - x * x).sqrt();
                    integral(-chord, chord, |y| profile.disc(x.hypot(y)))
                });
                let ball = integral(-1.0, f64::min(s, 1.0), |x| {
                    integral(0.0, (1.0 - x * x).sqrt(), |y| 2.0 * PI * y * profile.ball(x.hypot(y)))
                });
                assert!((profile.disc_share(s) - disc).abs() < 1e-4, "{profile:?} {s}: {disc}");
                assert!((profile.ball_share(s) - ball).abs() < 1e-4, "{profile:?} {s}: {ball}");
            }
            // The whole kernel.
            assert_eq!((profile.disc_share(7.0), profile.ball_share(7.0)), (1.0, 1.0));
            assert_eq!((profile.disc(1.0), profile.ball(1.0)), (0.0, 0.0));
        }
    }

    #[test]
    fn two_planes_leave_what_they_do_not_cut() {
        for profile in ALL {
            for a in [0.0, 1e-9, 0.2, 0.35, 0.7, 1.0] {
                for b in [0.0, 0.2, 0.5, 0.9, 3.0] {
                    for cosine in [-1.0, -0.8, 0.0, 0.5, 0.97, 1.0] {
                        // Along the planes' common line the kernel is ∝ (1 − ρ²)^{k + ½}: by direction, its share
                        // up to the nearer plane.
                        let angle = f64::acos(cosine);
                        let reach = |s: f64, u: f64| if u.cos() > 0.0 { s / u.cos() } else { f64::INFINITY };
                        let (power, n) = (profile.disc_peak() * PI + 0.5, 20_000);
                        let within = |i: i32| {
                            let u = (f64::from(i) + 0.5) / f64::from(n) * 2.0 * PI;
                            let rho = f64::min(reach(a, u), reach(b, u - angle)).min(1.0);
                            1.0 - (1.0 - rho * rho).powf(power)
                        };
                        let expected = (0..n).map(within).sum::<f64>() / f64::from(n);
                        let found = profile.ball_share_of_two([a, b], cosine);
                        assert!(
                            (found - expected).abs() < 1e-4,
                            "{profile:?} {a} {b} {cosine}: {found} instead of {expected}"
                        );
                        let swapped = profile.ball_share_of_two([b, a], cosine);
                        assert!((found - swapped).abs() < 1e-12, "{profile:?} {a} {b} {cosine}");
                    }
                }
            }
        }
    }

    fn check<S: Shape>(profile: Profile) {
        for isa in Isa::available() {
            for k in 0..2000 {
                let s: [f64; LANES] = std::array::from_fn(|i| (16 * k + i) as f64 / 31000.0);
                let shares = isa.run(Share::<S>(Row(s.map(|s| (s * s) as f32)), PhantomData));
                let values = isa.run(Value::<S>(Row(s.map(|s| (1.0 - s * s) as f32)), PhantomData));
                for (lane, s) in s.into_iter().enumerate() {
                    let share = f64::from(shares.0[lane]);
                    assert!((share - profile.disc_share(s)).abs() < 3e-6, "{isa:?} {profile:?}: C({s}) = {share}");
                    if s < 1.0 {
                        let value = f64::from(values.0[lane]) * profile.disc_peak();
                        assert!((value - profile.disc(s)).abs() < 1e-6, "{isa:?} {profile:?}: K({s}) = {value}");
                    }
                }
            }
            let far = isa.run(Share::<S>(Row([f32::INFINITY; LANES]), PhantomData));
            assert_eq!(far, Row([1.0; LANES]));
        }
    }

    #[test]
    fn lanes_follow_the_profiles() {
        check::<Constant>(Profile::Constant);
        check::<Epanechnikov>(Profile::Epanechnikov);
        check::<Biweight>(Profile::Biweight);
    }
}
