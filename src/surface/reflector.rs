use super::{Conductor, Drawn, Incidence, Lambert, Mirror, Nature, OrenNayar, Phong, Scattering, Schlick};
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
    pub(super) fn nature(&self) -> Nature {
        match self {
            Reflector::Lambert(_) | Reflector::OrenNayar(_) => Nature::Diffuse,
            Reflector::Mirror(_) => Nature::Specular,
            Reflector::Phong(phong) if phong.diffuse.max_element() > 0.0 => Nature::Diffuse,
            Reflector::Phong(_) => Nature::Glossy,
            Reflector::Conductor(conductor) if conductor.facets().is_some() => Nature::Glossy,
            Reflector::Conductor(_) => Nature::Specular,
            Reflector::Schlick(schlick) => schlick.nature(),
        }
    }

    /// The share of light that is not absorbed; at most that, and that straight on, where lobes or facets reflect.
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
}
