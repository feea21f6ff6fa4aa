//! Half spaces of isotropic scattering, which Chandrasekhar's H function solves.

/// The H function of an albedo Λ.
pub struct H {
    albedo: f64,
}

impl H {
    pub fn new(albedo: f64) -> Self {
        H { albedo }
    }

    /// H at the cosine μ > 0: ln H = −(μ/π) ∫₀^{π/2} ln(1 − Λθ cot θ)/(cos² θ + μ² sin² θ) dθ (Stibbs and Weir, "On the H-functions for
    /// isotropic scattering", Monthly Notices of the Royal Astronomical Society 119, 1959), by the midpoint rule in √θ, which flattens the logarithm of a
    /// lossless half space.
    pub fn at(&self, mu: f64) -> f64 {
        const N: usize = 4000;
        let step = std::f64::consts::FRAC_PI_2.sqrt() / N as f64;
        let value = |i: usize| {
            let x = (i as f64 + 0.5) * step;
            let (sin, cos) = (x * x).sin_cos();
            // 1 − θ cot θ by its series where it would cancel.
            let lost = if x < 0.1 { x.powi(4) / 3.0 * (1.0 + x.powi(4) / 15.0) } else { 1.0 - x * x * cos / sin };
            2.0 * x * (1.0 - self.albedo + self.albedo * lost).ln() / (cos * cos + mu * mu * sin * sin)
        };
        (-mu / std::f64::consts::PI * step * (0..N).map(value).sum::<f64>()).exp()
    }

    /// The share of a beam's power that a half space reflects.
    pub fn reflected(&self, mu: f64) -> f64 {
        1.0 - (1.0 - self.albedo).sqrt() * self.at(mu)
    }
}
