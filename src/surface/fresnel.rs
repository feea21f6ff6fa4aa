//! Fresnel's equations.

use crate::math::Rgb;

/// The share of unpolarised light that is reflected where it meets a boundary from index `from` into
/// index `to` at an angle of this cosine (Fresnel's equations; Jensen 2001, Eq. 2.28–2.29 with the
/// denominator of ρ⊥ put right). 0 for equal indices, 1 beyond the critical angle.
pub fn fresnel(cos: f64, from: f64, to: f64) -> f64 {
    if from == to {
        return 0.0;
    }
    let cos = cos.clamp(0.0, 1.0);
    let sin2 = (from / to).powi(2) * (1.0 - cos * cos);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2).sqrt();
    let parallel = (to * cos - from * cos_t) / (to * cos + from * cos_t);
    let perpendicular = (from * cos - to * cos_t) / (from * cos + to * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// What [`fresnel`] gives for the indices of each channel.
pub fn reflectance(cos: f64, from: Rgb, to: Rgb) -> Rgb {
    Rgb::from_array(std::array::from_fn(|c| fresnel(cos, from[c], to[c])))
}

/// The share of diffuse light that passes a smooth boundary from index `from` into index `to`: 2∫(1 − F(μ)) μ dμ over cosines
/// from 0 to 1. From the rarer side in closed form (Walsh 1926; Dunkle 1963); from the denser side n⁻² times that, since as
/// much comes back as went in.
pub fn mean_transmittance(from: f64, to: f64) -> f64 {
    let n = (from / to).max(to / from);
    let passed = if n < NEARLY_EQUAL {
        let slope = (1.0 - passed_into_denser(NEARLY_EQUAL)) / (NEARLY_EQUAL - 1.0);
        1.0 - slope * (n - 1.0)
    } else {
        passed_into_denser(n)
    };
    if from > to { passed / (n * n) } else { passed }
}

/// Below this ratio of indices, differences of the closed form's terms lose too many digits, and what is reflected grows in
/// proportion to n − 1 to 10⁻⁶ of all light.
const NEARLY_EQUAL: f64 = 1.001;

fn passed_into_denser(n: f64) -> f64 {
    let (n2, n4) = (n.powi(2), n.powi(4));
    let reflected = 0.5
        + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0).powi(2))
        + n2 * (n2 - 1.0).powi(2) / (n2 + 1.0).powi(3) * ((n - 1.0) / (n + 1.0)).ln()
        - 2.0 * n * n2 * (n2 + 2.0 * n - 1.0) / ((n2 + 1.0) * (n4 - 1.0))
        + 8.0 * n4 * (n4 + 1.0) / ((n2 + 1.0) * (n4 - 1.0).powi(2)) * n.ln();
    (1.0 - reflected).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums of Fresnel's equations over cos² of equal steps, from both sides.
    #[test]
    fn diffuse_light_passes() {
        const N: usize = 100_000;
        for n in [1.0, 1.0004, 1.01, 1.33, 1.5, 2.5, 30.0] {
            for (from, to) in [(1.0, n), (n, 1.0)] {
                let passed = |i: usize| 1.0 - fresnel(((i as f64 + 0.5) / N as f64).sqrt(), from, to);
                let sum = (0..N).map(passed).sum::<f64>() / N as f64;
                let closed = mean_transmittance(from, to);
                assert!((closed - sum).abs() < 1e-5 + 1e-4 * (1.0 - sum), "{from} to {to}: {closed}, summed {sum}");
            }
        }
    }

    #[test]
    fn fresnel_limits() {
        assert!((fresnel(1.0, 1.0, 1.5) - 0.04).abs() < 1e-12);
        assert!((fresnel(1.0, 1.5, 1.0) - 0.04).abs() < 1e-12);
        assert_eq!(fresnel(0.0, 1.0, 1.5), 1.0);
        assert_eq!(fresnel(0.3, 1.3, 1.3), 0.0);
        // Brewster's angle: tan θ = n; the parallel part vanishes.
        let cos = (1.0 / (1.0 + 1.5f64 * 1.5)).sqrt();
        let s = (1.0f64 - 1.5 * 1.5) / (1.0 + 1.5 * 1.5);
        assert!((fresnel(cos, 1.0, 1.5) - 0.5 * s * s).abs() < 1e-12);
        // Just inside and beyond the critical angle.
        let critical = (1.0 - 1.0 / 2.25f64).sqrt();
        assert_eq!(fresnel(critical - 1e-9, 1.5, 1.0), 1.0);
        assert!(fresnel(critical + 1e-6, 1.5, 1.0) < 1.0);
    }
}
