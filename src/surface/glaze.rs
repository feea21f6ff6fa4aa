use super::coat::Varnish;
use super::fresnel::fresnel;
use super::lambert::{cosine, cosine_density};
use super::{Drawn, Incidence, Lobe, Mirror, Scattering};
use crate::math::{DVec3, Rgb, Stream};

/// A smooth dielectric coat over a Lambertian base, in closed form. Of light that is in the coat, the base returns ρ, diffuse
/// whatever came, and the boundary the share 1 − T of that, so that the sum over all returns is a geometric series:
///
/// f(i→o) = (1 − F(i)) (1 − F(o)) (n₁/n₂)² ρ / (π (1 − ρ (1 − T))),
///
/// beside the mirror's F(i), with Fresnel's F from outside and T the share of diffuse light that the boundary lets out.
pub(super) struct Glaze {
    /// ρ of the base.
    pub reflectance: Rgb,
    /// The coat, of index n₂ and with n₁ around.
    pub varnish: Varnish,
}

/// ρ and all that comes of what a boundary returns that lets this share of diffuse light out.
pub(super) fn returned(reflectance: Rgb, passes: f64) -> Rgb {
    reflectance / (Rgb::ONE - reflectance * (1.0 - passes))
}

impl Glaze {
    /// F of light that meets the boundary from outside.
    fn reflected(&self, cos: f64) -> f64 {
        fresnel(cos, self.varnish.outside, self.varnish.index)
    }

    /// What leaves the base for what first came in.
    fn returned(&self) -> Rgb {
        returned(self.reflectance, self.varnish.passes)
    }

    /// What passes the boundary towards `o`, in radiance.
    fn passed(&self, at: &Incidence, o: DVec3) -> f64 {
        (1.0 - self.reflected(at.shading_normal.dot(o))) * (self.varnish.outside / self.varnish.index).powi(2)
    }

    /// What the boundary mirrors of light that arrives as `at` says, F, and what the coat sends diffusely,
    /// (1 − F) ρ T/(1 − ρ (1 − T)).
    fn parts(&self, at: &Incidence) -> (f64, Rgb) {
        let reflected = self.reflected(-at.direction.dot(at.shading_normal));
        (reflected, (1.0 - reflected) * self.varnish.passes * self.returned())
    }

    /// The probability of the diffuse part: its share of all that is sent.
    fn chance((reflected, diffuse): (f64, Rgb)) -> f64 {
        let diffuse = diffuse.element_sum() / 3.0;
        if diffuse > 0.0 { diffuse / (reflected + diffuse) } else { 0.0 }
    }

    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        let (reflected, diffuse) = self.parts(at);
        Rgb::splat(reflected) + diffuse
    }

    /// f cos θ. Diffuse light is drawn by the cosine, and always where `both` parts are followed.
    pub(super) fn value(&self, at: &Incidence, o: DVec3, both: bool) -> Scattering {
        let parts = self.parts(at);
        let cosine = cosine_density(at.shading_normal, o);
        let value = self.returned() * ((1.0 - parts.0) * self.passed(at, o) * cosine);
        let chance = if both { 1.0 } else { Self::chance(parts) };
        Scattering { value, ahead: Rgb::splat(chance * cosine) }
    }

    /// The mirror direction or one about the normal, each as often as it sends light, or as `lobe` says.
    pub(super) fn sample(&self, at: &Incidence, lobe: Option<Lobe>, stream: &mut Stream) -> Drawn {
        let parts = self.parts(at);
        let reflected = parts.0;
        let (mirrors, chance) = match lobe {
            None => {
                let chance = Self::chance(parts);
                (stream.uniform() >= chance, chance)
            }
            Some(lobe) => (lobe == Lobe::Reflected, if lobe == Lobe::Reflected { 0.0 } else { 1.0 }),
        };
        if mirrors {
            let reflectance = Rgb::splat(reflected / (1.0 - chance));
            return Mirror { reflectance }.sample(at);
        }
        let (direction, density) = cosine(at.shading_normal, stream);
        let factor = self.returned() * ((1.0 - reflected) * self.passed(at, direction) / chance);
        Drawn { direction, normal: at.shading_normal, factor, density: chance * density }
    }
}
