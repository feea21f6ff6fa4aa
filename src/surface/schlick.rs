use super::coat::Crossed;
use super::ggx::MOST_FACETS;
use super::lambert::{cosine, cosine_density};
use super::mirror::reflect;
use super::{Conductor, Drawn, Fresnel, Incidence, Lobe, Parameter, Scattering};
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

    /// α of its facets; 1 if it is diffuse in part.
    pub(super) fn alpha(&self) -> f64 {
        let [_, diffuse] = self.shares();
        if diffuse > 0.0 { 1.0 } else { self.roughness.sqrt() }
    }

    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        self.fresnel().reflected(-at.direction.dot(at.shading_normal))
    }

    /// S(u): the share that a plane reflects at an angle of this cosine.
    pub(super) fn reflected(&self, cos: f64) -> Rgb {
        self.fresnel().reflected(cos)
    }

    /// The share of light at an angle of this cosine that is reflected specularly.
    pub(super) fn specular(&self, cos: f64) -> Rgb {
        let [glossy, diffuse] = self.shares();
        (1.0 - glossy - diffuse).max(0.0) * self.reflected(cos)
    }

    /// Puts a texture's value in place of a constant.
    pub(super) fn set(&mut self, parameter: Parameter, share: Rgb) {
        match parameter {
            Parameter::F0 => self.f0 = share,
            Parameter::Roughness => self.roughness = share.element_sum() / 3.0,
            _ => {}
        }
    }

    pub(super) fn is_partly_specular(&self) -> bool {
        self.roughness < 0.5
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

    /// Light that meets it as a layer over another: what is not reflected passes straight on, wherever on the way between facets that
    /// turns out. So the share that passes depends on the direction alone, and is the same both ways. Coordinates have a z that points
    /// to where light comes from.
    pub(super) fn cross(&self, travel: DVec3, weight: &mut Rgb, stream: &mut Stream) -> Option<Crossed> {
        let [glossy, diffuse] = self.shares();
        let mean = |reflected: Rgb| reflected.element_sum() / 3.0;
        let passes = Crossed { travel, through: true, density: 0.0 };
        let mut reflects =
            |cos: f64, stream: &mut Stream| Lobe::take(None, self.reflected(cos), weight, stream) == Lobe::Reflected;
        let u = stream.uniform();
        if u < diffuse {
            let (direction, density) = cosine(DVec3::Z, stream);
            let half = (direction - travel).try_normalize().unwrap_or(DVec3::Z);
            let cos = direction.dot(half);
            if !reflects(cos, stream) {
                return Some(passes);
            }
            let density = diffuse * density * mean(self.reflected(cos));
            return Some(Crossed { travel: direction, through: false, density });
        }
        let facets = self.facets().facets().filter(|_| u < diffuse + glossy);
        let Some(facets) = facets else {
            let reflected = reflects(-travel.z, stream);
            let mirrored = Crossed { travel: reflect(travel, DVec3::Z), through: false, density: 0.0 };
            return Some(if reflected { mirrored } else { passes });
        };
        let mut onward = travel;
        for _ in 0..MOST_FACETS {
            let arriving = onward;
            let (cos, leaves) = facets.bounce(&mut onward, stream);
            if !reflects(cos, stream) {
                return Some(passes);
            }
            if leaves {
                let sent = facets.reflection(-arriving, onward);
                let density = sent.map_or(0.0, |(density, cos)| glossy * density * mean(self.reflected(cos)));
                return Some(Crossed { travel: onward, through: false, density });
            }
        }
        None
    }
}
