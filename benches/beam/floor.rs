//! The least a beam query can cost: the photons that a ray gathers, found beforehand and laid out one after the
//! other, evaluated exactly.

use glam::Vec3;
use volpm::math::{Frame, Ray};
use volpm::photon::Disc;

/// The photons of one ray, by field: position, 1/r², direction, power. Padded to whole vectors.
pub struct List {
    fields: [Vec<f32>; 10],
    len: usize,
}

/// A ray, ω and two directions across it, and what is to be added to a place's coordinates along them.
pub struct Prepared {
    axes: [Vec3; 3],
    offsets: [f32; 3],
}

impl Prepared {
    pub fn new(ray: &Ray) -> Self {
        let frame = Frame::around(ray.direction);
        let axes = [ray.direction, frame.x, frame.y];
        Prepared { axes: axes.map(|axis| axis.as_vec3()), offsets: axes.map(|axis| -axis.dot(ray.origin) as f32) }
    }
}

/// Photons per vector.
const WIDTH: usize = 16;

impl List {
    /// Those of `discs` that the ray meets.
    pub fn of(discs: &[Disc], ray: &Ray) -> Self {
        let (origin, omega) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let mut fields: [Vec<f32>; 10] = Default::default();
        let met = discs.iter().filter(|disc| {
            let to = disc.photon.position - origin;
            let t = to.dot(omega);
            t > 0.0 && (to - t * omega).length_squared() < disc.radius * disc.radius
        });
        for disc in met {
            let inverse_square = 1.0 / (disc.radius * disc.radius);
            let power = disc.photon.power * (3.0 * std::f32::consts::FRAC_1_PI * inverse_square);
            let (x, d) = (disc.photon.position, disc.photon.direction);
            let values = [x.x, x.y, x.z, inverse_square, d.x, d.y, d.z, power.x, power.y, power.z];
            fields.iter_mut().zip(values).for_each(|(field, value)| field.push(value));
        }
        let len = fields[0].len();
        for field in &mut fields {
            field.resize(len.next_multiple_of(WIDTH), 0.0);
        }
        List { fields, len }
    }

    /// Photons, padding left out.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Radiance in a homogeneous grey medium under Henyey and Greenstein's phase function, along a ray with two
    /// directions across it, by an instruction set that this machine has; `None` for those without a floor.
    pub fn evaluate(&self, ray: &Prepared, sigma: f32, g: f32, instructions: &str) -> Option<Vec3> {
        match instructions {
            // SAFETY: the features are there.
            #[cfg(target_arch = "x86_64")]
            "AVX-512" => Some(unsafe { avx512::evaluate(&self.fields, ray, sigma, g) }),
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            "AVX2" => Some(unsafe { avx2::evaluate(&self.fields, ray, sigma, g) }),
            _ => None,
        }
    }
}

/// Minimax coefficients of (2^f − 1)/f on [−½, ½].
const EXP2: [f32; 6] =
    [std::f32::consts::LN_2, 0.240_226_53, 0.055_503_106, 0.009_617_693, 0.001_340_664_4, 0.000_155_946_77];

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use super::{EXP2, Prepared, Vec3, WIDTH};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx512f")]
    fn dot(x: [__m512; 3], v: [__m512; 3], offset: __m512) -> __m512 {
        _mm512_fmadd_ps(x[0], v[0], _mm512_fmadd_ps(x[1], v[1], _mm512_fmadd_ps(x[2], v[2], offset)))
    }

    #[target_feature(enable = "avx512f")]
    fn splat3(v: Vec3) -> [__m512; 3] {
        [_mm512_set1_ps(v.x), _mm512_set1_ps(v.y), _mm512_set1_ps(v.z)]
    }

    #[target_feature(enable = "avx512f")]
    pub fn evaluate(fields: &[Vec<f32>; 10], ray: &Prepared, sigma: f32, g: f32) -> Vec3 {
        let (omega, u, v) = (splat3(ray.axes[0]), splat3(ray.axes[1]), splat3(ray.axes[2]));
        let [t0, a0, b0] = ray.offsets;
        let (t0, a0, b0) = (_mm512_set1_ps(t0), _mm512_set1_ps(a0), _mm512_set1_ps(b0));
        let exponent = _mm512_set1_ps(-sigma * std::f32::consts::LOG2_E);
        let (base, slope) = (_mm512_set1_ps(1.0 + g * g), _mm512_set1_ps(2.0 * g));
        let (zero, one) = (_mm512_setzero_ps(), _mm512_set1_ps(1.0));
        let (mut red, mut green, mut blue) = (zero, zero, zero);
        for at in (0..fields[0].len()).step_by(WIDTH) {
            // SAFETY: every field has a whole vector there.
            let load = |field: usize| unsafe { _mm512_loadu_ps(fields[field].as_ptr().add(at)) };
            let x = [load(0), load(1), load(2)];
            let t = dot(x, omega, t0);
            let a = dot(x, u, a0);
            let b = dot(x, v, b0);
            let q = _mm512_fnmadd_ps(_mm512_fmadd_ps(a, a, _mm512_mul_ps(b, b)), load(3), one);
            let met = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(zero, q) & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(zero, t);
            let base = _mm512_fmadd_ps(dot([load(4), load(5), load(6)], omega, zero), slope, base);
            let y = _mm512_rsqrt14_ps(base);
            let half = _mm512_mul_ps(_mm512_mul_ps(base, _mm512_set1_ps(0.5)), y);
            let y = _mm512_mul_ps(y, _mm512_fnmadd_ps(half, y, _mm512_set1_ps(1.5)));
            let exponents = _mm512_mul_ps(t, exponent);
            let n = _mm512_roundscale_ps::<8>(exponents);
            let f = _mm512_sub_ps(exponents, n);
            let mut p = _mm512_set1_ps(EXP2[5]);
            for index in (0..5).rev() {
                p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(EXP2[index]));
            }
            let passed = _mm512_scalef_ps(_mm512_fmadd_ps(p, f, one), n);
            let weight = _mm512_mul_ps(_mm512_mul_ps(q, q), _mm512_mul_ps(_mm512_mul_ps(y, y), y));
            let weight = _mm512_maskz_mul_ps(met, weight, passed);
            red = _mm512_fmadd_ps(weight, load(7), red);
            green = _mm512_fmadd_ps(weight, load(8), green);
            blue = _mm512_fmadd_ps(weight, load(9), blue);
        }
        let scale = (1.0 - g * g) * 0.25 * std::f32::consts::FRAC_1_PI;
        Vec3::new(_mm512_reduce_add_ps(red), _mm512_reduce_add_ps(green), _mm512_reduce_add_ps(blue)) * scale
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{EXP2, Prepared, Vec3};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx2,fma")]
    fn dot(x: [__m256; 3], v: [__m256; 3], offset: __m256) -> __m256 {
        _mm256_fmadd_ps(x[0], v[0], _mm256_fmadd_ps(x[1], v[1], _mm256_fmadd_ps(x[2], v[2], offset)))
    }

    #[target_feature(enable = "avx2,fma")]
    fn splat3(v: Vec3) -> [__m256; 3] {
        [_mm256_set1_ps(v.x), _mm256_set1_ps(v.y), _mm256_set1_ps(v.z)]
    }

    #[target_feature(enable = "avx2,fma")]
    fn total(lanes: __m256) -> f32 {
        let mut numbers = [0.0; 8];
        // SAFETY: the array holds eight numbers, any alignment.
        unsafe { _mm256_storeu_ps(numbers.as_mut_ptr(), lanes) };
        numbers.iter().sum()
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn evaluate(fields: &[Vec<f32>; 10], ray: &Prepared, sigma: f32, g: f32) -> Vec3 {
        let (omega, u, v) = (splat3(ray.axes[0]), splat3(ray.axes[1]), splat3(ray.axes[2]));
        let [t0, a0, b0] = ray.offsets;
        let (t0, a0, b0) = (_mm256_set1_ps(t0), _mm256_set1_ps(a0), _mm256_set1_ps(b0));
        let exponent = _mm256_set1_ps(-sigma * std::f32::consts::LOG2_E);
        let (base, slope) = (_mm256_set1_ps(1.0 + g * g), _mm256_set1_ps(2.0 * g));
        let (zero, one) = (_mm256_setzero_ps(), _mm256_set1_ps(1.0));
        let (mut red, mut green, mut blue) = (zero, zero, zero);
        for at in (0..fields[0].len()).step_by(8) {
            // SAFETY: every field has whole vectors there.
            let load = |field: usize| unsafe { _mm256_loadu_ps(fields[field].as_ptr().add(at)) };
            let x = [load(0), load(1), load(2)];
            let t = dot(x, omega, t0);
            let a = dot(x, u, a0);
            let b = dot(x, v, b0);
            let q = _mm256_fnmadd_ps(_mm256_fmadd_ps(a, a, _mm256_mul_ps(b, b)), load(3), one);
            let met = _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(zero, q), _mm256_cmp_ps::<_CMP_LT_OQ>(zero, t));
            let base = _mm256_fmadd_ps(dot([load(4), load(5), load(6)], omega, zero), slope, base);
            let y = _mm256_rsqrt_ps(base);
            let half = _mm256_mul_ps(_mm256_mul_ps(base, _mm256_set1_ps(0.5)), y);
            let y = _mm256_mul_ps(y, _mm256_fnmadd_ps(half, y, _mm256_set1_ps(1.5)));
            let exponents = _mm256_max_ps(_mm256_mul_ps(t, exponent), _mm256_set1_ps(-126.0));
            let n = _mm256_round_ps::<8>(exponents);
            let f = _mm256_sub_ps(exponents, n);
            let mut p = _mm256_set1_ps(EXP2[5]);
            for index in (0..5).rev() {
                p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(EXP2[index]));
            }
            let power = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
            let passed = _mm256_castps_si256(_mm256_fmadd_ps(p, f, one));
            let passed = _mm256_castsi256_ps(_mm256_add_epi32(passed, power));
            let weight = _mm256_mul_ps(_mm256_mul_ps(q, q), _mm256_mul_ps(_mm256_mul_ps(y, y), y));
            let weight = _mm256_and_ps(met, _mm256_mul_ps(weight, passed));
            red = _mm256_fmadd_ps(weight, load(7), red);
            green = _mm256_fmadd_ps(weight, load(8), green);
            blue = _mm256_fmadd_ps(weight, load(9), blue);
        }
        let scale = (1.0 - g * g) * 0.25 * std::f32::consts::FRAC_1_PI;
        Vec3::new(total(red), total(green), total(blue)) * scale
    }
}
