use super::lambert::{cosine, cosine_density};
use super::{Drawn, Incidence, Scattering};
use crate::math::{DVec3, Rgb, Stream};
use std::f64::consts::PI;

/// A rough diffuse surface, of grooves with Lambertian walls, whose slopes have the standard deviation σ (Oren and Nayar 1994,
/// the qualitative model of Eq. 30):
///
/// f = ρ/π (A + B max(0, cos(φ_i − φ_o)) sin α tan β), A = 1 − σ²/2(σ² + 0.33), B = 0.45 σ²/(σ² + 0.09),
///
/// with α the larger and β the smaller of the angles to the normal. Light between grooves is left out, as in their
/// formula: the albedo is ρ (A + B g(θ)), at most ρ, and 0.72 ρ or less for the roughest.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct OrenNayar {
    /// ρ, the share of light that the walls of grooves reflect, by channel in \[0, 1\].
    pub reflectance: Rgb,
    /// σ in radians, in \[0, π/2\]; 0 is Lambert's surface.
    pub sigma: f64,
}

impl OrenNayar {
    fn coefficients(&self) -> (f64, f64) {
        let square = self.sigma * self.sigma;
        (1.0 - 0.5 * square / (square + 0.33), 0.45 * square / (square + 0.09))
    }

    /// A + B max(0, cos(φ_i − φ_o)) sin α tan β: what it reflects where Lambert's surface would reflect 1.
    fn relative(&self, at: &Incidence, o: DVec3) -> f64 {
        let (a, b) = self.coefficients();
        let (n, i) = (at.shading_normal, -at.direction);
        let (cos_i, cos_o) = (n.dot(i), n.dot(o));
        // cos(φ_i − φ_o) sin θ_i sin θ_o; sin α tan β is sin θ_i sin θ_o over the larger cosine.
        let across = (i.dot(o) - cos_i * cos_o).max(0.0);
        a + b * across / cos_i.max(cos_o).max(f64::MIN_POSITIVE)
    }

    /// f cos θ with density cos θ/π.
    pub(super) fn value(&self, at: &Incidence, o: DVec3) -> Scattering {
        let density = cosine_density(at.shading_normal, o);
        Scattering { value: self.reflectance * (self.relative(at, o) * density), ahead: Rgb::splat(density) }
    }

    /// A direction drawn in proportion to the cosine.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Drawn {
        let normal = at.shading_normal;
        let (direction, density) = cosine(normal, stream);
        Drawn { direction, normal, factor: self.reflectance * self.relative(at, direction), density }
    }

    /// ∫ f cos θ_o dω_o = ρ (A + B g), g = 2/π (sin θ (θ − sin θ cos θ)/2 + tan θ (1 − sin³ θ)/3), with θ the angle of
    /// incidence.
    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        let (a, b) = self.coefficients();
        let cos = (-at.shading_normal.dot(at.direction)).clamp(0.0, 1.0);
        let sin = (1.0 - cos * cos).sqrt();
        // tan θ (1 − sin³ θ) without cancellation at grazing angles: 1 − s³ = (1 − s²) (1 + s + s²)/(1 + s).
        let beyond = sin * cos * (1.0 + sin + sin * sin) / (1.0 + sin);
        let g = 2.0 / PI * (0.5 * sin * (cos.acos() - sin * cos) + beyond / 3.0);
        self.reflectance * (a + b * g)
    }
}
