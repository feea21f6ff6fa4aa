//! Sixteen lanes of `f32`: one AVX-512 register, two AVX2 registers, four SSE2 registers, or an array where the
//! processor is of another kind. Which one is chosen at run time, once for a map; kernels are written once, generic
//! over [`Lanes`].
//!
//! A kernel is a [`Task`]. [`Isa::run`] instantiates it inside a function compiled for the chosen
//! instruction set, into which everything marked `#[inline(always)]` here is inlined.

/// Lanes in a vector, and photons in a block.
pub(crate) const LANES: usize = 16;

/// One field of a block of photons.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Row(pub [f32; LANES]);

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Isa {
    /// AVX-512 F, BW, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX2 and FMA, with POPCNT and BMI1, which came before them.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Whatever the crate was compiled for.
    Portable,
}

/// A computation that runs in any instruction set. `run` must be `#[inline(always)]`.
pub(crate) trait Task {
    /// What it returns.
    type Output;
    /// Does it.
    fn run<L: Lanes>(self) -> Self::Output;
}

impl Isa {
    /// Every instruction set this machine has, the fastest first.
    pub(crate) fn available() -> Vec<Isa> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("popcnt")
                && is_x86_feature_detected!("bmi1");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx2 && avx512 {
                sets.push(Isa::Avx512);
            }
            if avx2 {
                sets.push(Isa::Avx2);
            }
        }
        sets.push(Isa::Portable);
        sets
    }

    /// The fastest instruction set this machine has.
    pub(crate) fn best() -> Isa {
        Self::available()[0]
    }

    /// Runs `task` with this set's lanes. The set must come from [`Isa::available`].
    pub(crate) fn run<T: Task>(self, task: T) -> T::Output {
        match self {
            // SAFETY: values of this variant come from `available`, which found the features.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => unsafe { run_avx512(task) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => unsafe { run_avx2(task) },
            #[cfg(target_arch = "x86_64")]
            Isa::Portable => task.run::<x86::Sse2>(),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Portable => task.run::<Portable>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,popcnt,bmi1")]
fn run_avx512<T: Task>(task: T) -> T::Output {
    task.run::<x86::Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt,bmi1")]
fn run_avx2<T: Task>(task: T) -> T::Output {
    task.run::<x86::Avx2>()
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
    /// As [`Lanes::compress`], of integers.
    fn compress_indices(values: &[u32; LANES], bits: u16, out: &mut [u32; LANES]);
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

/// The same of what may be at an address.
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

/// Lanes as an array. Kernels on x86-64 have registers instead: to compile them for arrays, too, took three minutes.
#[cfg(any(test, not(target_arch = "x86_64")))]
#[derive(Clone, Copy)]
pub(crate) struct Portable([f32; LANES]);

#[cfg(any(test, not(target_arch = "x86_64")))]
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

#[cfg(any(test, not(target_arch = "x86_64")))]
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
    #[inline(always)]
    fn compress_indices(values: &[u32; LANES], bits: u16, out: &mut [u32; LANES]) {
        compress_scalar(values, bits, out);
    }
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

#[cfg(target_arch = "x86_64")]
mod x86 {
    // SAFETY, for every `unsafe` in this module: the functions are reached only through
    // `Isa::run`, inlined into a function compiled for the features their intrinsics need; loads
    // and stores go through references to whole rows, whose alignment is 64 bytes.
    use super::{EXP2_MIN, LANES, Lanes, ROUND, Row, compress_scalar, exp2_fraction};
    use std::arch::x86_64::*;

    const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

    /// Lanes in one register.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512);

    impl Lanes for Avx512 {
        type Mask = __mmask16;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_set1_ps(x)) }
        }
        #[inline(always)]
        fn load(row: &Row) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_load_ps(row.0.as_ptr())) }
        }
        #[inline(always)]
        fn load_front(values: &[f32]) -> Self {
            let Some(values) = values.first_chunk::<LANES>() else { return Self::splat(0.0) };
            // SAFETY: see the head of the module; sixteen numbers lie there, aligned or not.
            unsafe { Avx512(_mm512_loadu_ps(values.as_ptr())) }
        }
        #[inline(always)]
        fn store(self, row: &mut Row) {
            // SAFETY: see the head of the module.
            unsafe { _mm512_store_ps(row.0.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_add_ps(self.0, b.0)) }
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_sub_ps(self.0, b.0)) }
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_mul_ps(self.0, b.0)) }
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_div_ps(self.0, b.0)) }
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_min_ps(self.0, b.0)) }
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_max_ps(self.0, b.0)) }
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_fmadd_ps(self.0, b.0, c.0)) }
        }
        #[inline(always)]
        fn neg_mul_add(self, b: Self, c: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_fnmadd_ps(self.0, b.0, c.0)) }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_sqrt_ps(self.0)) }
        }
        #[inline(always)]
        fn rsqrt(self) -> Self {
            // SAFETY: see the head of the module.
            let y = unsafe { Avx512(_mm512_rsqrt14_ps(self.0)) };
            let half = self.mul(Self::splat(0.5)).mul(y);
            y.mul(half.neg_mul_add(y, Self::splat(1.5)))
        }
        #[inline(always)]
        fn exp2(self) -> Self {
            let x = self.max(Self::splat(2.0 * EXP2_MIN));
            // SAFETY: see the head of the module.
            let n = unsafe { Avx512(_mm512_roundscale_ps::<NEAREST>(x.0)) };
            let p = exp2_fraction(x.sub(n));
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_scalef_ps(p.0, n.0)) }
        }
        #[inline(always)]
        fn less(self, b: Self) -> __mmask16 {
            // SAFETY: see the head of the module.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, b.0) }
        }
        #[inline(always)]
        fn less_equal(self, b: Self) -> __mmask16 {
            // SAFETY: see the head of the module.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, b.0) }
        }
        #[inline(always)]
        fn and(a: __mmask16, b: __mmask16) -> __mmask16 {
            a & b
        }
        #[inline(always)]
        fn bits(mask: __mmask16) -> u16 {
            mask
        }
        #[inline(always)]
        fn mask(bits: u16) -> __mmask16 {
            bits
        }
        #[inline(always)]
        fn select(self, mask: __mmask16, other: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_mask_mov_ps(other.0, mask, self.0)) }
        }
        #[inline(always)]
        fn keep(self, mask: __mmask16) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx512(_mm512_maskz_mov_ps(mask, self.0)) }
        }
        #[inline(always)]
        fn sum(self) -> f32 {
            // SAFETY: see the head of the module.
            unsafe { _mm512_reduce_add_ps(self.0) }
        }
        #[inline(always)]
        fn largest(self) -> f32 {
            // SAFETY: see the head of the module.
            unsafe { _mm512_reduce_max_ps(self.0) }
        }
        #[inline(always)]
        fn compress(self, bits: u16, out: &mut [f32; LANES]) {
            // SAFETY: see the head of the module; `out` holds sixteen numbers, any alignment.
            unsafe { _mm512_storeu_ps(out.as_mut_ptr(), _mm512_maskz_compress_ps(bits, self.0)) }
        }
        #[inline(always)]
        fn compress_indices(values: &[u32; LANES], bits: u16, out: &mut [u32; LANES]) {
            // SAFETY: see the head of the module; both arrays hold sixteen numbers, any alignment.
            unsafe {
                let values = _mm512_loadu_si512(values.as_ptr().cast());
                _mm512_storeu_si512(out.as_mut_ptr().cast(), _mm512_maskz_compress_epi32(bits, values));
            }
        }
    }

    /// Lanes in two registers.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2(__m256, __m256);

    /// A mask in two registers, all bits of a lane set or clear.
    #[derive(Clone, Copy)]
    pub(crate) struct Mask2(__m256, __m256);

    /// For each choice of eight lanes, where packed ones come from.
    static PACKING: [[u8; 8]; 256] = {
        let mut table = [[0; 8]; 256];
        let mut bits = 0;
        while bits < 256 {
            let (mut lane, mut place) = (0, 0);
            while lane < 8 {
                if bits >> lane & 1 == 1 {
                    table[bits][place] = lane as u8;
                    place += 1;
                }
                lane += 1;
            }
            bits += 1;
        }
        table
    };

    #[inline(always)]
    fn bits_of_halves(bits: u16) -> (usize, usize) {
        (usize::from(bits & 0xff), usize::from(bits >> 8))
    }

    /// Where the lanes of `bits`, below 256, come from once they are packed.
    #[inline(always)]
    unsafe fn packing(bits: usize) -> __m256i {
        // SAFETY: see the head of the module; the row holds eight bytes, any alignment.
        unsafe { _mm256_cvtepu8_epi32(_mm_loadl_epi64(PACKING[bits].as_ptr().cast())) }
    }

    impl Avx2 {
        #[inline(always)]
        fn exp2_half(p: __m256, n: __m256) -> __m256 {
            // SAFETY: see the head of the module.
            unsafe {
                let exponent = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
                _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(p), exponent))
            }
        }
    }

    impl Lanes for Avx2 {
        type Mask = Mask2;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_set1_ps(x), _mm256_set1_ps(x)) }
        }
        #[inline(always)]
        fn load(row: &Row) -> Self {
            let (low, high) = row.0.split_at(8);
            // SAFETY: see the head of the module; each half holds eight numbers.
            unsafe { Avx2(_mm256_load_ps(low.as_ptr()), _mm256_load_ps(high.as_ptr())) }
        }
        #[inline(always)]
        fn load_front(values: &[f32]) -> Self {
            let Some((low, high)) = values.first_chunk::<LANES>().map(|values| values.split_at(8)) else {
                return Self::splat(0.0);
            };
            // SAFETY: see the head of the module; each half holds eight numbers, aligned or not.
            unsafe { Avx2(_mm256_loadu_ps(low.as_ptr()), _mm256_loadu_ps(high.as_ptr())) }
        }
        #[inline(always)]
        fn store(self, row: &mut Row) {
            let (low, high) = row.0.split_at_mut(8);
            // SAFETY: see the head of the module; each half holds eight numbers.
            unsafe {
                _mm256_store_ps(low.as_mut_ptr(), self.0);
                _mm256_store_ps(high.as_mut_ptr(), self.1);
            }
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_add_ps(self.0, b.0), _mm256_add_ps(self.1, b.1)) }
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_sub_ps(self.0, b.0), _mm256_sub_ps(self.1, b.1)) }
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_mul_ps(self.0, b.0), _mm256_mul_ps(self.1, b.1)) }
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_div_ps(self.0, b.0), _mm256_div_ps(self.1, b.1)) }
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_min_ps(self.0, b.0), _mm256_min_ps(self.1, b.1)) }
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_max_ps(self.0, b.0), _mm256_max_ps(self.1, b.1)) }
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_fmadd_ps(self.0, b.0, c.0), _mm256_fmadd_ps(self.1, b.1, c.1)) }
        }
        #[inline(always)]
        fn neg_mul_add(self, b: Self, c: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_fnmadd_ps(self.0, b.0, c.0), _mm256_fnmadd_ps(self.1, b.1, c.1)) }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
        }
        #[inline(always)]
        fn rsqrt(self) -> Self {
            // SAFETY: see the head of the module.
            let y = unsafe { Avx2(_mm256_rsqrt_ps(self.0), _mm256_rsqrt_ps(self.1)) };
            let half = self.mul(Self::splat(0.5)).mul(y);
            y.mul(half.neg_mul_add(y, Self::splat(1.5)))
        }
        #[inline(always)]
        fn exp2(self) -> Self {
            let x = self.max(Self::splat(EXP2_MIN));
            // SAFETY: see the head of the module.
            let n = unsafe { Avx2(_mm256_round_ps::<NEAREST>(x.0), _mm256_round_ps::<NEAREST>(x.1)) };
            let p = exp2_fraction(x.sub(n));
            Avx2(Self::exp2_half(p.0, n.0), Self::exp2_half(p.1, n.1))
        }
        #[inline(always)]
        fn less(self, b: Self) -> Mask2 {
            // SAFETY: see the head of the module.
            unsafe { Mask2(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0), _mm256_cmp_ps::<_CMP_LT_OQ>(self.1, b.1)) }
        }
        #[inline(always)]
        fn less_equal(self, b: Self) -> Mask2 {
            // SAFETY: see the head of the module.
            unsafe { Mask2(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, b.0), _mm256_cmp_ps::<_CMP_LE_OQ>(self.1, b.1)) }
        }
        #[inline(always)]
        fn and(a: Mask2, b: Mask2) -> Mask2 {
            // SAFETY: see the head of the module.
            unsafe { Mask2(_mm256_and_ps(a.0, b.0), _mm256_and_ps(a.1, b.1)) }
        }
        #[inline(always)]
        fn bits(mask: Mask2) -> u16 {
            // SAFETY: see the head of the module.
            unsafe { (_mm256_movemask_ps(mask.0) | _mm256_movemask_ps(mask.1) << 8) as u16 }
        }
        #[inline(always)]
        fn mask(bits: u16) -> Mask2 {
            // SAFETY: see the head of the module.
            unsafe {
                let low = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let high = _mm256_slli_epi32::<8>(low);
                let all = _mm256_set1_epi32(i32::from(bits));
                Mask2(
                    _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(all, low), low)),
                    _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(all, high), high)),
                )
            }
        }
        #[inline(always)]
        fn select(self, mask: Mask2, other: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_blendv_ps(other.0, self.0, mask.0), _mm256_blendv_ps(other.1, self.1, mask.1)) }
        }
        #[inline(always)]
        fn keep(self, mask: Mask2) -> Self {
            // SAFETY: see the head of the module.
            unsafe { Avx2(_mm256_and_ps(self.0, mask.0), _mm256_and_ps(self.1, mask.1)) }
        }
        #[inline(always)]
        fn sum(self) -> f32 {
            let mut row = Row([0.0; LANES]);
            self.store(&mut row);
            row.0.iter().sum()
        }
        #[inline(always)]
        fn largest(self) -> f32 {
            let mut row = Row([0.0; LANES]);
            self.store(&mut row);
            row.0.iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b))
        }
        #[inline(always)]
        fn compress(self, bits: u16, out: &mut [f32; LANES]) {
            let (low, high) = bits_of_halves(bits);
            // SAFETY: see the head of the module; `out` holds sixteen numbers, any alignment, and the upper half's
            // eight begin behind at most eight.
            unsafe {
                let second = out.as_mut_ptr().add(low.count_ones() as usize);
                _mm256_storeu_ps(out.as_mut_ptr(), _mm256_permutevar8x32_ps(self.0, packing(low)));
                _mm256_storeu_ps(second, _mm256_permutevar8x32_ps(self.1, packing(high)));
            }
        }
        #[inline(always)]
        fn compress_indices(values: &[u32; LANES], bits: u16, out: &mut [u32; LANES]) {
            let (low, high) = bits_of_halves(bits);
            // SAFETY: as above; `values` holds sixteen numbers, any alignment.
            unsafe {
                let (first, second) = (values.as_ptr().cast::<__m256i>(), values.as_ptr().add(8).cast::<__m256i>());
                let first = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(first), packing(low));
                let second = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(second), packing(high));
                _mm256_storeu_si256(out.as_mut_ptr().cast(), first);
                _mm256_storeu_si256(out.as_mut_ptr().add(low.count_ones() as usize).cast(), second);
            }
        }
    }

    /// Lanes in four registers, of the instructions that every x86-64 has.
    #[derive(Clone, Copy)]
    pub(crate) struct Sse2([__m128; 4]);

    impl Sse2 {
        #[inline(always)]
        fn zip(self, b: Self, f: impl Fn(__m128, __m128) -> __m128) -> Self {
            let ([x0, x1, x2, x3], [y0, y1, y2, y3]) = (self.0, b.0);
            Sse2([f(x0, y0), f(x1, y1), f(x2, y2), f(x3, y3)])
        }

        #[inline(always)]
        fn row(self) -> [f32; LANES] {
            let mut row = Row([0.0; LANES]);
            self.store(&mut row);
            row.0
        }
    }

    impl Lanes for Sse2 {
        /// All bits of a lane are set or clear.
        type Mask = Sse2;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            Sse2([unsafe { _mm_set1_ps(x) }; 4])
        }
        #[inline(always)]
        fn load(row: &Row) -> Self {
            let start = row.0.as_ptr();
            // SAFETY: a row holds sixteen numbers, aligned.
            unsafe {
                Sse2([
                    _mm_load_ps(start),
                    _mm_load_ps(start.add(4)),
                    _mm_load_ps(start.add(8)),
                    _mm_load_ps(start.add(12)),
                ])
            }
        }
        #[inline(always)]
        fn load_front(values: &[f32]) -> Self {
            let Some(values) = values.first_chunk::<LANES>() else { return Self::splat(0.0) };
            let start = values.as_ptr();
            // SAFETY: sixteen numbers lie there, aligned or not.
            unsafe {
                Sse2([
                    _mm_loadu_ps(start),
                    _mm_loadu_ps(start.add(4)),
                    _mm_loadu_ps(start.add(8)),
                    _mm_loadu_ps(start.add(12)),
                ])
            }
        }
        #[inline(always)]
        fn store(self, row: &mut Row) {
            let start = row.0.as_mut_ptr();
            let [a, b, c, d] = self.0;
            // SAFETY: a row holds sixteen numbers, aligned.
            unsafe {
                _mm_store_ps(start, a);
                _mm_store_ps(start.add(4), b);
                _mm_store_ps(start.add(8), c);
                _mm_store_ps(start.add(12), d);
            }
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_add_ps(x, y) })
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_sub_ps(x, y) })
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_mul_ps(x, y) })
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_div_ps(x, y) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_min_ps(x, y) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_max_ps(x, y) })
        }
        // Not fused: SSE2 has no such instruction.
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
            // SAFETY: SSE2 is part of x86-64.
            self.zip(self, |x, _| unsafe { _mm_sqrt_ps(x) })
        }
        #[inline(always)]
        fn rsqrt(self) -> Self {
            Self::splat(1.0).div(self.sqrt())
        }
        #[inline(always)]
        fn exp2(self) -> Self {
            let x = self.max(Self::splat(EXP2_MIN));
            let shifted = x.add(Self::splat(ROUND));
            let n = shifted.sub(Self::splat(ROUND));
            exp2_fraction(x.sub(n)).zip(shifted, |p, s| {
                // Bits of `ROUND` above the integer's are shifted out.
                // SAFETY: SSE2 is part of x86-64.
                unsafe {
                    let exponent = _mm_slli_epi32::<23>(_mm_castps_si128(s));
                    _mm_castsi128_ps(_mm_add_epi32(_mm_castps_si128(p), exponent))
                }
            })
        }
        #[inline(always)]
        fn less(self, b: Self) -> Sse2 {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_cmplt_ps(x, y) })
        }
        #[inline(always)]
        fn less_equal(self, b: Self) -> Sse2 {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(b, |x, y| unsafe { _mm_cmple_ps(x, y) })
        }
        #[inline(always)]
        fn and(a: Sse2, b: Sse2) -> Sse2 {
            // SAFETY: SSE2 is part of x86-64.
            a.zip(b, |x, y| unsafe { _mm_and_ps(x, y) })
        }
        #[inline(always)]
        fn bits(mask: Sse2) -> u16 {
            // SAFETY: SSE2 is part of x86-64.
            let [a, b, c, d] = mask.0.map(|lanes| unsafe { _mm_movemask_ps(lanes) });
            (a | b << 4 | c << 8 | d << 12) as u16
        }
        #[inline(always)]
        fn mask(bits: u16) -> Sse2 {
            // SAFETY: SSE2 is part of x86-64.
            let four = |bits: i32| unsafe {
                let lanes = _mm_setr_epi32(1, 2, 4, 8);
                _mm_castsi128_ps(_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32(bits), lanes), lanes))
            };
            let bits = i32::from(bits);
            Sse2([four(bits), four(bits >> 4), four(bits >> 8), four(bits >> 12)])
        }
        #[inline(always)]
        fn select(self, mask: Sse2, other: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            let rest = other.zip(mask, |x, m| unsafe { _mm_andnot_ps(m, x) });
            // SAFETY: SSE2 is part of x86-64.
            self.keep(mask).zip(rest, |x, y| unsafe { _mm_or_ps(x, y) })
        }
        #[inline(always)]
        fn keep(self, mask: Sse2) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            self.zip(mask, |x, m| unsafe { _mm_and_ps(x, m) })
        }
        #[inline(always)]
        fn sum(self) -> f32 {
            self.row().iter().sum()
        }
        #[inline(always)]
        fn largest(self) -> f32 {
            self.row().iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b))
        }
        #[inline(always)]
        fn compress(self, bits: u16, out: &mut [f32; LANES]) {
            compress_scalar(&self.row(), bits, out);
        }
        #[inline(always)]
        fn compress_indices(values: &[u32; LANES], bits: u16, out: &mut [u32; LANES]) {
            compress_scalar(values, bits, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What every operation makes of rows of numbers.
    struct Operations<'a>(&'a [Row; 3]);

    impl Task for Operations<'_> {
        type Output = Vec<[f32; LANES]>;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Output {
            let [a, b, c] = load3::<L>(self.0);
            let (less, at_most) = (a.less(b), a.less_equal(b));
            let mut packed = [[0.0; LANES]; 2];
            a.compress(L::bits(less), &mut packed[0]);
            let mut indices = [0; LANES];
            L::compress_indices(&std::array::from_fn(|lane| lane as u32), L::bits(at_most), &mut indices);
            packed[1] = indices.map(|index| index as f32);
            for (row, mask) in packed.iter_mut().zip([less, at_most]) {
                // What lies behind the packed lanes may be anything.
                row[L::bits(mask).count_ones() as usize..].fill(0.0);
            }
            let made = [
                a.add(b),
                a.sub(b),
                a.mul(b),
                a.div(b),
                a.min(b),
                a.max(b),
                a.mul_add(b, c),
                a.neg_mul_add(b, c),
                b.sqrt(),
                b.min(L::splat(1e30)).rsqrt(),
                a.exp2(),
                a.select(less, b),
                a.keep(at_most),
                a.keep(L::and(L::mask(0x9a5c), at_most)),
                L::splat(a.sum()),
                L::splat(a.largest()),
                L::load_front(&self.0[1].0),
            ];
            let rows = made.map(|lanes| {
                let mut row = Row([0.0; LANES]);
                lanes.store(&mut row);
                row.0
            });
            rows.into_iter().chain(packed).collect()
        }
    }

    /// All instruction sets agree with arrays to a few roundings, ties, infinities and small numbers included.
    #[test]
    fn instruction_sets_compute_the_same() {
        let a = std::array::from_fn(|lane| [-130.0, -3.5, 0.5, 1e-30, 7.25, 100.0, 0.0, -0.125][lane % 8]);
        let b = std::array::from_fn(|lane| [2.0, 3.5, 0.5, 1e30, 0.25, f32::INFINITY, 9.0][lane % 7]);
        let c = std::array::from_fn(|lane| lane as f32 - 8.0);
        let rows = [Row(a), Row(b), Row(c)];
        let expected = Operations(&rows).run::<Portable>();
        for isa in Isa::available() {
            for (number, (found, expected)) in isa.run(Operations(&rows)).iter().zip(&expected).enumerate() {
                for (x, y) in found.iter().zip(expected) {
                    let close = (x - y).abs() <= 1e-6 * y.abs() + 1e-36;
                    assert!(close || x == y || (x.is_nan() && y.is_nan()), "{isa:?}, operation {number}: {x} {y}");
                }
            }
        }
    }
}
