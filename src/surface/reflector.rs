use super::{
    Conductor, Drawn, Fresnel, Incidence, Lambert, Mirror, Nature, OrenNayar, Parameter, Phong, Scattering, Schlick,
};
use crate::math::{DVec3, Rgb, Stream};

/// A surface that reflects light, and is made of nothing else: what coats cover and mixtures are made of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reflector {
    /// Diffuse reflection, equal in all directions.
    Lambert(Lambert),
    /// Diffuse reflection by a rough surface.
    OrenNayar(OrenNayar),
    /// Specular reflection.
    Mirror(Mirror),
    /// A lobe about the mirror direction beside diffuse reflection.
    Phong(Phong),
    /// A metal, smooth or rough.
    Conductor(Conductor),
    /// From a mirror to diffuse by one number.
    Schlick(Schlick),
}

impl Reflector {
    #[inline]
    pub(super) fn nature(&self) -> Nature {
        Nature::of_facets(self.alpha())
    }

    /// GGX's α of its facets, or one as wide as its lobe; 1 where it is diffuse, or in part.
    pub(super) fn alpha(&self) -> f64 {
        match self {
            Reflector::Lambert(_) | Reflector::OrenNayar(_) => 1.0,
            Reflector::Mirror(_) => 0.0,
            Reflector::Phong(phong) => phong.alpha(),
            Reflector::Conductor(conductor) => conductor.alpha(),
            Reflector::Schlick(schlick) => schlick.alpha(),
        }
    }

    /// The share of light that is not absorbed; at most that, and that straight on, where lobes or facets reflect.
    #[inline]
    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        match self {
            Reflector::Lambert(lambert) => lambert.reflectance,
            Reflector::OrenNayar(oren_nayar) => oren_nayar.albedo(at),
            Reflector::Mirror(mirror) => mirror.reflectance,
            Reflector::Phong(phong) => phong.diffuse + phong.specular,
            Reflector::Conductor(conductor) => conductor.fresnel.reflected(-at.direction.dot(at.shading_normal)),
            Reflector::Schlick(schlick) => schlick.albedo(at),
        }
    }

    /// Tells `part` what goes along `o`: see [`Bsdf::toward`](super::Bsdf::toward), before shading normals are made up for.
    #[inline]
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        match self {
            Reflector::Lambert(lambert) => part(weight, lambert.value(at, o)),
            Reflector::OrenNayar(oren_nayar) => part(weight, oren_nayar.value(at, o)),
            Reflector::Phong(phong) => part(weight, phong.value(at, o)),
            Reflector::Conductor(conductor) => conductor.toward(at, o, weight, stream, part),
            Reflector::Schlick(schlick) => schlick.toward(at, o, weight, stream, part),
            Reflector::Mirror(_) => {}
        }
    }

    /// Where light goes on; `None` where it ends.
    #[inline]
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Option<Drawn> {
        match self {
            Reflector::Lambert(lambert) => Some(lambert.sample(at, stream)),
            Reflector::OrenNayar(oren_nayar) => Some(oren_nayar.sample(at, stream)),
            Reflector::Mirror(mirror) => Some(mirror.sample(at)),
            Reflector::Phong(phong) => phong.sample(at, stream),
            Reflector::Conductor(conductor) => conductor.sample(at, stream),
            Reflector::Schlick(schlick) => schlick.sample(at, stream),
        }
    }

    /// The share of light at an angle of this cosine that is reflected specularly.
    pub(super) fn specular(&self, cos: f64) -> Rgb {
        match self {
            Reflector::Mirror(mirror) => mirror.reflectance,
            Reflector::Conductor(conductor) if conductor.facets().is_none() => conductor.fresnel.reflected(cos),
            Reflector::Schlick(schlick) => schlick.specular(cos),
            _ => Rgb::ZERO,
        }
    }

    pub(super) fn is_partly_specular(&self) -> bool {
        match self {
            Reflector::Schlick(schlick) => schlick.is_partly_specular(),
            _ => self.nature() == Nature::Specular,
        }
    }

    #[inline]
    pub(super) fn is_walked(&self) -> bool {
        matches!(self, Reflector::Conductor(_) | Reflector::Schlick(_))
    }

    #[inline]
    pub(super) fn is_anisotropic(&self) -> bool {
        match self {
            Reflector::Conductor(conductor) => conductor.roughness[0] != conductor.roughness[1],
            Reflector::Schlick(schlick) => schlick.isotropy != 1.0,
            Reflector::Lambert(_) | Reflector::OrenNayar(_) | Reflector::Mirror(_) | Reflector::Phong(_) => false,
        }
    }

    /// Puts a texture's value in place of a constant; what comes to more than all light with others is cut off.
    pub(super) fn set(&mut self, parameter: Parameter, value: Rgb) {
        let share = value.clamp(Rgb::ZERO, Rgb::ONE);
        let number = share.element_sum() / 3.0;
        match (self, parameter) {
            (Reflector::Lambert(lambert), Parameter::Reflectance) => lambert.reflectance = share,
            (Reflector::OrenNayar(oren_nayar), Parameter::Reflectance) => oren_nayar.reflectance = share,
            (Reflector::Mirror(mirror), Parameter::Reflectance) => mirror.reflectance = share,
            (Reflector::Phong(phong), Parameter::Diffuse) => {
                phong.diffuse = share;
                phong.specular = phong.specular.min(Rgb::ONE - share);
            }
            (Reflector::Phong(phong), Parameter::Specular) => phong.specular = share.min(Rgb::ONE - phong.diffuse),
            (Reflector::Conductor(conductor), Parameter::F0) => conductor.fresnel = Fresnel::Schlick { f0: share },
            (Reflector::Conductor(conductor), Parameter::Roughness) => conductor.roughness = [number; 2],
            (Reflector::Schlick(schlick), _) => schlick.set(parameter, share),
            _ => {}
        }
    }
}
