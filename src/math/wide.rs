//! Functions of several numbers at once, for loops that compilers turn into vectors: what they return depends on the number alone,
//! not on its neighbours nor on the processor, as nothing but sums, products, quotients and roots are taken, which IEEE 754 rounds
//! alike everywhere.

use std::f64::consts::{FRAC_PI_2, LN_2, LOG2_E};

/// Numbers side by side.
pub const WIDE: usize = 16;

/// So many numbers.
pub type Wide = [f64; WIDE];

/// 1.5·2⁵²: added and subtracted again, it rounds to the nearest integer, which stands in the last bits of the sum.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// The bits of √½.
const ROOT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;

/// Horner's scheme.
#[inline(always)]
fn polynomial<const N: usize>(x: f64, coefficients: [f64; N]) -> f64 {
    let mut sum = coefficients[0];
    let mut i = 1;
    while i < N {
        sum = sum * x + coefficients[i];
        i += 1;
    }
    sum
}

/// The natural logarithm of a number from 2⁻⁶⁰ to 1, to 10⁻¹⁵ relative to the larger of it and 1.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    // x = 2^(n − 64) m, with m from √½ to √2.
    let bits = x.to_bits();
    let n = (bits + (64 << 52) - ROOT_HALF) >> 52;
    let m = f64::from_bits(bits + (64 << 52) - (n << 52));
    let exponent = f64::from_bits(n | 0x4330_0000_0000_0000) - (4_503_599_627_370_496.0 + 64.0);
    // 2 artanh s
    let s = (m - 1.0) / (m + 1.0);
    const SERIES: [f64; 9] =
        [2.0 / 17.0, 2.0 / 15.0, 2.0 / 13.0, 2.0 / 11.0, 2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0];
    exponent * LN_2 + s * polynomial(s * s, SERIES)
}

/// e^x for a number below 0; for those below −700 as of −700.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    let x = if x < -700.0 { -700.0 } else { x };
    let shifted = x * LOG2_E + ROUND;
    let f = (x * LOG2_E - (shifted - ROUND)) * LN_2;
    const SERIES: [f64; 13] = [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    f64::from_bits(polynomial(f, SERIES).to_bits().wrapping_add(shifted.to_bits() << 52))
}

/// Sine and cosine of a part of a full turn, from 0 to 1.
#[inline(always)]
pub fn sin_cos_of_turn(turn: f64) -> (f64, f64) {
    let shifted = 4.0 * turn + ROUND;
    let quarter = shifted.to_bits();
    let r = (4.0 * turn - (shifted - ROUND)) * FRAC_PI_2;
    const SIN: [f64; 8] = [
        -1.0 / 1_307_674_368_000.0,
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
        1.0,
    ];
    const COS: [f64; 9] = [
        1.0 / 20_922_789_888_000.0,
        -1.0 / 87_178_291_200.0,
        1.0 / 479_001_600.0,
        -1.0 / 3_628_800.0,
        1.0 / 40_320.0,
        -1.0 / 720.0,
        1.0 / 24.0,
        -0.5,
        1.0,
    ];
    let (s, c) = (r * polynomial(r * r, SIN), polynomial(r * r, COS));
    let (sin, cos) = if quarter & 1 == 0 { (s, c) } else { (c, s) };
    let turned = |x: f64, quarter: u64| f64::from_bits(x.to_bits() ^ ((quarter & 2) << 62));
    (turned(sin, quarter), turned(cos, quarter.wrapping_add(1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// As the library's, over all that may be asked.
    #[test]
    fn functions_are_those_of_the_library() {
        let mut stream = Stream::new(61, Purpose::Test, 0, 0);
        for i in 0..100_000 {
            let u = if i % 2 == 0 { stream.uniform() } else { (stream.uniform() - 1.0).exp2().powi(1 + i % 50) };
            let u = u.max(1e-17);
            assert!((ln(u) - u.ln()).abs() <= 2e-15 * u.ln().abs().max(1.0), "ln {u}");
            let x = 690.0 * u.ln().max(-1.0);
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-15 * (4.0 - x), "exp {x}");
            let turn = u.min(1.0f64.next_down());
            let (sin, cos) = sin_cos_of_turn(turn);
            let (s, c) = (std::f64::consts::TAU * turn).sin_cos();
            assert!((sin - s).abs() < 1e-15 * 8.0 && (cos - c).abs() < 1e-15 * 8.0, "sin {turn}");
        }
        assert_eq!((exp(0.0), exp(-1e4) < 1e-300), (1.0, true));
    }
}
