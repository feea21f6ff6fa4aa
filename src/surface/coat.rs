use super::fresnel::mean_transmittance;
use super::ggx::MOST_FACETS;
use super::rough::Rough;
use super::transmittance::Transmittance;
use super::{Dielectric, Incidence, Lobe, Nature, Parameter, Scattering, Schlick, fresnel};
use crate::math::{DVec3, Rgb, Stream};

/// What lies over the base of a [`Coated`](super::Coated) surface, without thickness. Directions are in coordinates whose z points out of it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Coat {
    /// A dielectric, at whose boundary light is reflected and refracted.
    Dielectric(Varnish),
    /// Schlick's upper layer: what it does not reflect passes straight on.
    Schlick(Schlick),
}

/// A dielectric coat.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Varnish {
    /// Its index of refraction, above 0.
    #[serde(rename = "ior")]
    pub index: f64,
    /// GGX's α of its boundary, in \[0, 1\]; 0 is smooth.
    pub roughness: f64,
    /// The index of refraction of what is around.
    #[serde(skip)]
    pub(super) outside: f64,
    /// The share of diffuse light that passes its smooth boundary from inside: follows from the indices.
    #[serde(skip)]
    pub(super) passes: f64,
}

/// Where light goes that met a coat.
pub(super) struct Crossed {
    pub travel: DVec3,
    pub through: bool,
    /// The density with which it was sent there; 0 for a specular event.
    pub density: f64,
}

/// In coordinates whose z points out of the coat.
pub(super) fn flipped(v: DVec3) -> DVec3 {
    DVec3::new(v.x, v.y, -v.z)
}

/// How a plane is met by light that travels along `travel`.
pub(super) fn met(travel: DVec3) -> Incidence {
    Incidence { direction: travel, normal: DVec3::Z, shading_normal: DVec3::Z, tangent: DVec3::X }
}

impl Varnish {
    /// Of this index and roughness, with an index of 1 around.
    pub fn new(index: f64, roughness: f64) -> Self {
        Varnish { index, roughness, outside: 1.0, passes: mean_transmittance(index, 1.0) }
    }

    /// Puts it where this index of refraction is around.
    pub fn put_in(&mut self, outside: f64) {
        if outside != self.outside {
            (self.outside, self.passes) = (outside, mean_transmittance(self.index, outside));
        }
    }

    /// What passes its rough boundary from outside, where that is known.
    pub(super) fn transmittance(&self) -> Option<Transmittance> {
        Transmittance::new(self.roughness, self.index / self.outside)
    }

    /// The indices on the side of arrival and beyond.
    fn indices(&self, inside: bool) -> [f64; 2] {
        if inside { [self.index, self.outside] } else { [self.outside, self.index] }
    }

    /// The boundary as it is met from outside or from inside.
    fn boundary(&self, inside: bool) -> Rough {
        let [from, to] = self.indices(inside);
        Rough { from: Rgb::splat(from), to: Rgb::splat(to), alpha: self.roughness }
    }
}

impl Coat {
    pub(super) fn nature(&self) -> Nature {
        match self {
            Coat::Dielectric(varnish) => Nature::of_facets(varnish.roughness),
            Coat::Schlick(schlick) => Nature::of_facets(schlick.alpha()),
        }
    }

    /// Puts a texture's value in place of a constant.
    pub(super) fn set(&mut self, parameter: Parameter, value: Rgb) {
        let share = value.clamp(Rgb::ZERO, Rgb::ONE);
        match (self, parameter) {
            (Coat::Dielectric(varnish), Parameter::Roughness) => varnish.roughness = share.element_sum() / 3.0,
            (Coat::Dielectric(_), _) => {}
            (Coat::Schlick(schlick), _) => schlick.set(parameter, share),
        }
    }

    /// Whether it sends light in single directions only.
    pub(super) fn is_smooth(&self) -> bool {
        self.nature() == Nature::Specular
    }

    /// Whether what passes goes in a single direction.
    pub(super) fn passes_in_one_direction(&self) -> bool {
        matches!(self, Coat::Schlick(_)) || self.is_smooth()
    }

    /// α of what it sends.
    pub(super) fn roughness(&self) -> f64 {
        match self {
            Coat::Dielectric(varnish) => varnish.roughness,
            Coat::Schlick(schlick) => schlick.roughness.sqrt(),
        }
    }

    /// The share of light from outside that a plane of it reflects.
    pub(super) fn reflected(&self, cos: f64) -> Rgb {
        match self {
            Coat::Dielectric(varnish) => Rgb::splat(fresnel(cos, varnish.outside, varnish.index)),
            Coat::Schlick(schlick) => schlick.reflected(cos),
        }
    }

    /// The share of light that it reflects in a single direction.
    pub(super) fn specular(&self, inside: bool, cos: f64) -> Rgb {
        match self {
            Coat::Dielectric(varnish) if varnish.roughness > 0.0 => Rgb::ZERO,
            Coat::Dielectric(varnish) => {
                let [from, to] = varnish.indices(inside);
                Rgb::splat(fresnel(cos, from, to))
            }
            Coat::Schlick(schlick) => schlick.specular(cos),
        }
    }

    /// By what solid angles grow that light leaves it in, per cosine: (n₁/n₂)².
    pub(super) fn spreads(&self) -> f64 {
        match self {
            Coat::Dielectric(varnish) => (varnish.outside / varnish.index).powi(2),
            Coat::Schlick(_) => 1.0,
        }
    }

    /// Light that arrives from outside along `travel`, inside; `None` where it does not get in.
    pub(super) fn enter(&self, travel: DVec3, weight: &mut Rgb, stream: &mut Stream) -> Option<DVec3> {
        if !self.is_smooth() {
            let crossed = self.cross(Some(1.0), travel, weight, stream, None, |_, _| {})?;
            return crossed.through.then_some(crossed.travel);
        }
        *weight *= Rgb::ONE - self.specular(false, -travel.z);
        match self {
            Coat::Dielectric(Varnish { index, outside, .. }) => Dielectric::refract(travel, DVec3::Z, *outside, *index),
            Coat::Schlick(_) => Some(travel),
        }
    }

    /// Meets it from inside, or from outside with `passing`: what light that a dielectric's first facet lets in counts in the chance for
    /// that, against what is reflected. `part` is told what it sends along `asked`, with the weight that comes to each part: all that a
    /// dielectric sends there, what Schlick's layer reflects there.
    pub(super) fn cross(
        &self,
        passing: Option<f64>,
        travel: DVec3,
        weight: &mut Rgb,
        stream: &mut Stream,
        asked: Option<DVec3>,
        mut part: impl FnMut(Rgb, Scattering),
    ) -> Option<Crossed> {
        let inside = passing.is_none();
        let turned = |v: DVec3| if inside { flipped(v) } else { v };
        let (travel, asked) = (turned(travel), asked.map(turned));
        let varnish = match self {
            Coat::Dielectric(varnish) => varnish,
            Coat::Schlick(schlick) => {
                if let Some(leaving) = asked {
                    // Of what comes, about as much is drawn as is reflected: the rest passes.
                    schlick.toward(&met(travel), leaving, *weight, stream, |weight, sent| {
                        part(weight, Scattering { ahead: Rgb::splat(sent.value.element_sum() / 3.0), ..sent });
                    });
                }
                let crossed = schlick.cross(travel, weight, stream)?;
                return Some(Crossed { travel: turned(crossed.travel), ..crossed });
            }
        };
        if varnish.roughness == 0.0 {
            let [from, to] = varnish.indices(inside);
            let reflected = Rgb::splat(fresnel(-travel.z, from, to));
            let through = Lobe::take(None, reflected, weight, stream) == Lobe::Refracted;
            let travel = if through { Dielectric::refract(travel, DVec3::Z, from, to)? } else { flipped(travel) };
            return Some(Crossed { travel: turned(travel), through, density: 0.0 });
        }
        let boundary = varnish.boundary(inside);
        let mut visit = boundary.arrive(travel);
        visit.passing = passing.unwrap_or(1.0);
        for _ in 0..MOST_FACETS {
            if let Some(leaving) = asked {
                part(*weight, boundary.sends(&visit, leaving, false));
            }
            let arriving = visit;
            if boundary.meet(&mut visit, None, weight, stream)? {
                let leaving = visit.turned(visit.travel);
                let density = boundary.sends(&arriving, leaving, false).ahead.x;
                return Some(Crossed { travel: turned(leaving), through: leaving.z < 0.0, density });
            }
        }
        None
    }
}
