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

#[cfg(test)]
mod tests {
    use super::*;

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
