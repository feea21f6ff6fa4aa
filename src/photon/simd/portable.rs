//! Lanes as an array, for processors that are not x86-64, and for tests.

use super::{EXP2_MIN, LANES, Lanes, ROUND, Row, compress_scalar, exp2_fraction};

/// Lanes as an array. Kernels on x86-64 have registers instead: to compile them for arrays, too, took three minutes.
#[derive(Clone, Copy)]
pub(crate) struct Portable([f32; LANES]);

impl Portable {
    #[inline(always)]
    fn zip(self, b: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self;
        for (x, y) in out.0.iter_mut().zip(b.0) {
            *x = f(*x, y);
        }
        out
    }

    #[inline(always)]
    fn compare(self, b: Self, f: impl Fn(f32, f32) -> bool) -> u16 {
        let mut bits = 0;
        for lane in 0..LANES {
            bits |= u16::from(f(self.0[lane], b.0[lane])) << lane;
        }
        bits
    }
}

impl Lanes for Portable {
    type Mask = u16;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Portable([x; LANES])
    }
    #[inline(always)]
    fn load(row: &Row) -> Self {
        Portable(row.0)
    }
    #[inline(always)]
    fn load_front(values: &[f32]) -> Self {
        values.first_chunk().map_or(Self::splat(0.0), |values| Portable(*values))
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        row.0 = self.0;
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, |x, y| x + y)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, |x, y| x - y)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.zip(b, |x, y| x * y)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        self.zip(b, |x, y| x / y)
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.zip(b, |x, y| if x < y { x } else { y })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.zip(b, |x, y| if x > y { x } else { y })
    }
    // Not fused: without the instruction, `f32::mul_add` is a slow function call.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        c.sub(self.mul(b))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.zip(self, |x, _| x.sqrt())
    }
    #[inline(always)]
    fn rsqrt(self) -> Self {
        self.zip(self, |x, _| 1.0 / x.sqrt())
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        let x = self.max(Self::splat(EXP2_MIN));
        let shifted = x.add(Self::splat(ROUND));
        let n = shifted.sub(Self::splat(ROUND));
        exp2_fraction(x.sub(n)).zip(shifted, |p, s| {
            let exponent = s.to_bits().wrapping_sub(ROUND.to_bits());
            f32::from_bits(p.to_bits().wrapping_add(exponent << 23))
        })
    }
    #[inline(always)]
    fn less(self, b: Self) -> u16 {
        self.compare(b, |x, y| x < y)
    }
    #[inline(always)]
    fn less_equal(self, b: Self) -> u16 {
        self.compare(b, |x, y| x <= y)
    }
    #[inline(always)]
    fn and(a: u16, b: u16) -> u16 {
        a & b
    }
    #[inline(always)]
    fn bits(mask: u16) -> u16 {
        mask
    }
    #[inline(always)]
    fn mask(bits: u16) -> u16 {
        bits
    }
    #[inline(always)]
    fn select(self, mask: u16, other: Self) -> Self {
        let mut out = self;
        for lane in 0..LANES {
            if mask >> lane & 1 == 0 {
                out.0[lane] = other.0[lane];
            }
        }
        out
    }
    #[inline(always)]
    fn keep(self, mask: u16) -> Self {
        self.select(mask, Self::splat(0.0))
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        self.0.iter().sum()
    }
    #[inline(always)]
    fn largest(self) -> f32 {
        self.0.iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b))
    }
    #[inline(always)]
    fn compress(self, bits: u16, out: &mut [f32; LANES]) {
        compress_scalar(&self.0, bits, out);
    }
}
