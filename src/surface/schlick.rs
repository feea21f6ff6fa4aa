use super::lambert::{cosine, cosine_density};
use super::{Conductor, Drawn, Fresnel, Incidence, Nature, Scattering};
use crate::math::{DVec3, Rgb, Stream};

/// Schlick's surface of one layer (Schlick 1994; Jensen 2001, Eq. 2.33–2.41): from a mirror to a diffuse one by one number.
///
/// Of the light a share s = (1 − 2σ)² is reflected specularly where σ < ½, or diffusely where σ > ½, and the share g = 4σ(1 − σ) by
/// facets, all of them times S(u) = f₀ + (1 − f₀)(1 − u)⁵, with u the cosine to the half vector.
///
/// As printed, the glossy part makes light at grazing angles and loses it elsewhere. Its density Z/π of facets is GGX's with
/// α² = σ, so facets are masked by Smith's function and what they send onto one another is followed, as by [`Conductor`]: where
/// S = 1 the albedo is 1. The isotropy ψ stretches them by α_x/α_y = ψ, α_x α_y = σ: then azimuths of half vectors are distributed by
/// A(w)², of which A as printed is the root.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Schlick {
    /// f₀, the share of light that is reflected straight back, by channel in \[0, 1\].
    pub f0: Rgb,
    /// σ, in \[0, 1\]: 0 is a mirror, 1 diffuse.
    pub roughness: f64,
    /// ψ, in (0, 1\]: 1 is the same in all directions; less stretches highlights across u.
    pub isotropy: f64,
}

impl Schlick {
    fn fresnel(&self) -> Fresnel {
        Fresnel::Schlick { f0: self.f0 }
    }

    /// The shares that facets reflect and that are reflected diffusely; what is left is specular.
    fn shares(&self) -> [f64; 2] {
        let sigma = self.roughness;
        let glossy = 4.0 * sigma * (1.0 - sigma);
        [glossy, if sigma > 0.5 { 1.0 - glossy } else { 0.0 }]
    }

    fn facets(&self) -> Conductor {
        let (alpha, stretch) = (self.roughness.sqrt(), self.isotropy.sqrt());
        Conductor { fresnel: self.fresnel(), roughness: [alpha * stretch, alpha / stretch] }
    }

    pub(super) fn nature(&self) -> Nature {
        match self.shares() {
            [_, diffuse] if diffuse > 0.0 => Nature::Diffuse,
            [glossy, _] if glossy > 0.0 => Nature::Glossy,
            _ => Nature::Specular,
        }
    }

    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        self.fresnel().reflected(-at.direction.dot(at.shading_normal))
    }

    fn diffuse(&self, at: &Incidence, o: DVec3) -> Scattering {
        let density = cosine_density(at.shading_normal, o);
        let half = (o - at.direction).try_normalize().unwrap_or(at.shading_normal);
        Scattering { value: self.fresnel().reflected(o.dot(half)) * density, ahead: Rgb::splat(density) }
    }

    /// What each part sends; each is drawn with its share as probability.
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        let [glossy, diffuse] = self.shares();
        let mut tell = |share: f64, weight: Rgb, Scattering { value, ahead }: Scattering| {
            part(weight, Scattering { value: share * value, ahead: share * ahead });
        };
        if diffuse > 0.0 {
            tell(diffuse, weight, self.diffuse(at, o));
        }
        if glossy > 0.0 {
            self.facets().toward(at, o, weight, stream, |weight, sent| tell(glossy, weight, sent));
        }
    }

    /// A draw from one of the parts.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Option<Drawn> {
        let [glossy, diffuse] = self.shares();
        let u = stream.uniform();
        if u < diffuse {
            let (direction, density) = cosine(at.shading_normal, stream);
            let factor = self.diffuse(at, direction).value / density.max(f64::MIN_POSITIVE);
            return Some(Drawn { direction, normal: at.shading_normal, factor, density: diffuse * density });
        }
        if u < diffuse + glossy {
            let drawn = self.facets().sample(at, stream)?;
            return Some(Drawn { density: glossy * drawn.density, ..drawn });
        }
        Conductor { fresnel: self.fresnel(), roughness: [0.0; 2] }.sample(at, stream)
    }
}
