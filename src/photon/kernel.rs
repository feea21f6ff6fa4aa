//! The kernel that spreads a photon over its disc, and the share of a disc on one side of a wall.

use super::simd::Lanes;
use std::f64::consts::{FRAC_1_PI, PI};

/// The constant of the two-dimensional biweight kernel.
pub const BIWEIGHT: f64 = 3.0 * FRAC_1_PI;

/// Silverman's two-dimensional biweight kernel, K₂(x) = 3/π (1 − x²)² inside of the unit disc, 0
/// outside: its integral over the disc is 1 (Jarosz et al. 2008, below Eq. 22).
pub fn biweight(x: f64) -> f64 {
    if x.abs() < 1.0 { BIWEIGHT * (1.0 - x * x).powi(2) } else { 0.0 }
}

/// The biweight kernel's mass on the near side of a line at distance `s ≥ 0` from the disc's
/// centre, in units of its radius:
/// C(s) = ½ + 16/(5π) ∫₀ˢ (1 − x²)^{5/2} dx, and 1 from s = 1 on.
/// (The kernel's integral over the chord at x is 3/π · 16/15 (1 − x²)^{5/2}.)
pub fn disc_share(s: f64) -> f64 {
    if s >= 1.0 {
        return 1.0;
    }
    let s = s.max(0.0);
    let integral = (s * (1.0 - s * s).sqrt() * (s * s * (8.0 * s * s - 26.0) + 33.0) + 15.0 * s.asin()) / 48.0;
    0.5 + 16.0 / (5.0 * PI) * integral
}

/// Minimax coefficients of `(C(s) − ½)/s` in powers of s²: C to 1.8·10⁻⁶ on [0, 1].
const DISC_SHARE: [f32; 6] = [1.018_613_6, -0.849_362_2, 0.385_660_9, -0.056_013_74, 0.009_226_29, -0.008_123_027];

/// [`disc_share`] of √s², in lanes, to 3·10⁻⁶.
#[inline(always)]
pub(crate) fn disc_share_lanes<L: Lanes>(s2: L) -> L {
    let one = L::splat(1.0);
    let inside = s2.less(one);
    let s2 = s2.min(one);
    let mut p = L::splat(DISC_SHARE[5]);
    p = p.mul_add(s2, L::splat(DISC_SHARE[4]));
    p = p.mul_add(s2, L::splat(DISC_SHARE[3]));
    p = p.mul_add(s2, L::splat(DISC_SHARE[2]));
    p = p.mul_add(s2, L::splat(DISC_SHARE[1]));
    p = p.mul_add(s2, L::splat(DISC_SHARE[0]));
    p.mul_add(s2.sqrt(), L::splat(0.5)).select(inside, one)
}

/// Coefficients of 1/C(s), by interpolation at Chebyshev's nodes: 4·10⁻⁵ on [0, 1].
const INVERSE_DISC_SHARE: [f32; 8] =
    [1.999_942_1, -4.066_888, 8.136_03, -12.079_031, 14.034_813, -11.070_336, 5.078_787, -1.033_355_9];

/// 1 over [`disc_share`] of s, in lanes, to 5·10⁻⁵; anything below 0.
#[inline(always)]
pub(crate) fn inverse_disc_share_lanes<L: Lanes>(s: L) -> L {
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

    struct Share(Row);
    impl Task for Share {
        type Output = Row;
        #[inline(always)]
        fn run<L: Lanes>(mut self) -> Row {
            disc_share_lanes(L::load(&self.0)).store(&mut self.0);
            self.0
        }
    }

    #[test]
    fn disc_share_is_the_mass_of_the_kernel_beside_a_line() {
        // The kernel summed over a fine grid of the unit disc, midpoint rule in both directions.
        const N: usize = 1000;
        let cell = 2.0 / N as f64;
        for s in [0.0, 0.1, 0.37, 0.75, 0.9, 1.0] {
            let cells = ((1.0 + s) / cell).round() as usize;
            let mut mass = 0.0;
            for i in 0..cells {
                let x = -1.0 + (1.0 + s) * (i as f64 + 0.5) / cells as f64;
                for j in 0..N {
                    let y = -1.0 + cell * (j as f64 + 0.5);
                    mass += biweight(x.hypot(y)) * cell * (1.0 + s) / cells as f64;
                }
            }
            assert!((disc_share(s) - mass).abs() < 2e-6, "{s}: {} {mass}", disc_share(s));
        }
        assert_eq!(disc_share(7.0), 1.0);
    }

    #[test]
    fn fit_of_the_disc_share_stays_within_its_error() {
        for isa in Isa::available() {
            for k in 0..2000 {
                let s: [f64; LANES] = std::array::from_fn(|i| (16 * k + i) as f64 / 31000.0);
                let got = isa.run(Share(Row(s.map(|s| (s * s) as f32))));
                for (s, c) in s.into_iter().zip(got.0) {
                    assert!((f64::from(c) - disc_share(s)).abs() < 3e-6, "{isa:?}: C({s}) = {c}");
                }
            }
            let far = isa.run(Share(Row([f32::INFINITY; LANES])));
            assert_eq!(far, Row([1.0; LANES]));
        }
    }
}
