//! Lanes in the registers of x86-64: AVX-512's, AVX2's, or SSE2's.

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
            Sse2([_mm_load_ps(start), _mm_load_ps(start.add(4)), _mm_load_ps(start.add(8)), _mm_load_ps(start.add(12))])
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
}
