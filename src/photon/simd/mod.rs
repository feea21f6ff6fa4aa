//! Sixteen lanes of `f32`: one AVX-512 register, two AVX2 registers, four SSE2 registers, or an array where the
//! processor is of another kind. Which one is chosen at run time, once for a map; kernels are written once, generic
//! over [`Lanes`].
//!
//! A kernel is a [`Task`]. [`Isa::run`] instantiates it inside a function compiled for the chosen
//! instruction set, into which everything marked `#[inline(always)]` here is inlined.

mod isa;
#[cfg(any(test, not(target_arch = "x86_64")))]
mod portable;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use isa::Isa;

/// Lanes in a vector, and photons in a block.
pub(crate) const LANES: usize = 16;

/// One field of a block of photons.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Row(pub [f32; LANES]);

/// A computation that runs in any instruction set. `run` must be `#[inline(always)]`.
pub(crate) trait Task {
    /// What it returns.
    type Output;
    /// Does it.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Arithmetic on sixteen lanes. Comparisons with NaN are false. Only a [`Task`] run by [`Isa::run`]
/// may use an implementation.
pub(crate) trait Lanes: Copy {
    /// One truth value a lane.
    type Mask: Copy;

    /// The same number in every lane.
    fn splat(x: f32) -> Self;
    /// The numbers of a row.
    fn load(row: &Row) -> Self;
    /// The first numbers of a slice that has at least sixteen; any numbers if it has fewer.
    fn load_front(values: &[f32]) -> Self;
    /// Writes the lanes to a row.
    fn store(self, row: &mut Row);
    /// `self + b`
    fn add(self, b: Self) -> Self;
    /// `self − b`
    fn sub(self, b: Self) -> Self;
    /// `self · b`
    fn mul(self, b: Self) -> Self;
    /// `self / b`
    fn div(self, b: Self) -> Self;
    /// The smaller; `b` if either is NaN.
    fn min(self, b: Self) -> Self;
    /// The larger; `b` if either is NaN.
    fn max(self, b: Self) -> Self;
    /// `self · b + c`
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c − self · b`
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// `√self`
    fn sqrt(self) -> Self;
    /// `1/√self`, to 3·10⁻⁷, for normal positive numbers.
    fn rsqrt(self) -> Self;
    /// `2^self` for numbers below 127, to 2·10⁻⁷; at most 10⁻³⁷ below −126.
    fn exp2(self) -> Self;
    /// `self < b`
    fn less(self, b: Self) -> Self::Mask;
    /// `self ≤ b`
    fn less_equal(self, b: Self) -> Self::Mask;
    /// Where both hold.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Bit `i` is lane `i`.
    fn bits(mask: Self::Mask) -> u16;
    /// The mask whose lane `i` is bit `i`.
    fn mask(bits: u16) -> Self::Mask;
    /// `self` where the mask holds, elsewhere `other`.
    fn select(self, mask: Self::Mask, other: Self) -> Self;
    /// `self` where the mask holds, elsewhere 0.
    fn keep(self, mask: Self::Mask) -> Self;
    /// The sum of all lanes.
    fn sum(self) -> f32;
    /// The largest lane.
    fn largest(self) -> f32;
    /// Writes the lanes of `bits`, packed, to the front of `out`, whose first sixteen numbers may
    /// all be overwritten.
    fn compress(self, bits: u16, out: &mut [f32; LANES]);
    /// As [`Lanes::compress`], of integers; one by one, where there is no instruction for all.
    #[inline(always)]
    fn compress_indices(values: &[u32; LANES], bits: u16, out: &mut [u32; LANES]) {
        compress_scalar(values, bits, out);
    }
}

/// The coefficients of `(2^f − 1)/f` on [−½, ½]: minimax in the relative error of `2^f`, 2·10⁻⁸
/// once rounded, and exact at 0, so that no extinction means a transmittance of exactly 1.
const EXP2: [f32; 6] =
    [std::f32::consts::LN_2, 0.240_226_53, 0.055_503_106, 0.009_617_693, 0.001_340_664_4, 0.000_155_946_77];

/// Below this, 2^x is taken as 2^this: the smallest normal number.
const EXP2_MIN: f32 = -126.0;

/// 1.5·2²³: added and subtracted again, it rounds to the nearest integer, which stands in the last bits of the sum.
const ROUND: f32 = 12_582_912.0;

/// `2^f` for `|f| ≤ ½`.
#[inline(always)]
fn exp2_fraction<L: Lanes>(f: L) -> L {
    let mut p = L::splat(EXP2[5]);
    p = p.mul_add(f, L::splat(EXP2[4]));
    p = p.mul_add(f, L::splat(EXP2[3]));
    p = p.mul_add(f, L::splat(EXP2[2]));
    p = p.mul_add(f, L::splat(EXP2[1]));
    p = p.mul_add(f, L::splat(EXP2[0]));
    p.mul_add(f, L::splat(1.0))
}

/// A vector, the same in every lane.
#[inline(always)]
pub(crate) fn splat3<L: Lanes>(v: [f32; 3]) -> [L; 3] {
    [L::splat(v[0]), L::splat(v[1]), L::splat(v[2])]
}

/// Vectors, one a lane.
#[inline(always)]
pub(crate) fn load3<L: Lanes>(rows: &[Row; 3]) -> [L; 3] {
    [L::load(&rows[0]), L::load(&rows[1]), L::load(&rows[2])]
}

/// `x·v + offset`
#[inline(always)]
pub(crate) fn dot_plus<L: Lanes>(x: &[L; 3], v: &[L; 3], offset: L) -> L {
    x[0].mul_add(v[0], x[1].mul_add(v[1], x[2].mul_add(v[2], offset)))
}

/// Bit `i` tells whether `values[i] ≤ limit`.
#[inline(always)]
pub(crate) fn at_most(values: &[u8; LANES], limit: u8) -> u16 {
    let mut bits = 0;
    for (lane, value) in values.iter().enumerate() {
        bits |= u16::from(*value <= limit) << lane;
    }
    bits
}

/// Asks the processor to fetch `value`, wherever it knows how.
#[inline(always)]
pub(crate) fn prefetch<T>(value: &T) {
    prefetch_at::<T>(value);
}

/// Asks the processor to fetch what may be of type `T` at an address, valid or not, wherever it knows how.
#[inline(always)]
pub(crate) fn prefetch_at<T>(address: *const T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let start = address.cast::<i8>();
        for line in 0..size_of::<T>().div_ceil(64) {
            // SAFETY: a prefetch reads nothing, whatever the address; SSE is part of x86-64.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}

/// Packs the elements of `bits` to the front of `out`.
#[inline(always)]
fn compress_scalar<T: Copy>(values: &[T; LANES], mut bits: u16, out: &mut [T; LANES]) {
    for slot in out.iter_mut() {
        if bits == 0 {
            break;
        }
        *slot = values[bits.trailing_zeros() as usize];
        bits &= bits - 1;
    }
}
