use super::mirror::reflect;
use super::{Boundary, Dielectric, Incidence, Lobe, Onward, Side, Straight, reflectance};
use crate::math::{DVec3, Rgb, Stream};

/// A smooth boundary between two indices of refraction, met from one side.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Smooth {
    /// The index of refraction on the side of arrival, by channel.
    pub from: Rgb,
    /// The index of refraction beyond the boundary, by channel.
    pub to: Rgb,
}

impl Smooth {
    /// The part of each channel that is reflected, and about which normal.
    fn reflected(&self, at: &Incidence) -> (DVec3, Rgb) {
        let normal = at.specular_normal(|normal| Some(reflect(at.direction, normal)), true);
        (normal, reflectance(-at.direction.dot(normal), self.from, self.to))
    }

    pub(super) fn boundary(&self, at: &Incidence) -> Boundary {
        Boundary { from: self.from, reflected: Some(self.reflected(at).1) }
    }

    /// What passes along a straight line (Jensen 2001, §10.8.2): 1 − F as light sees it that comes from beyond. If the index is
    /// lower there, refracted light takes another way through the medium on this side, longer by Eq. 10.31.
    pub(super) fn straight(&self, at: &Incidence) -> Straight {
        let cos = at.normal.dot(at.direction).abs();
        let mut longer = Rgb::ONE;
        for channel in 0..3 {
            let (here, beyond) = (self.from[channel], self.to[channel]);
            if here > beyond {
                longer[channel] = cos / (1.0 - (beyond / here).powi(2) * (1.0 - cos * cos)).sqrt();
            }
        }
        Straight { passed: Rgb::ONE - reflectance(cos, self.to, self.from), longer }
    }

    /// Reflects or refracts, by chance or as `lobe` says.
    pub(super) fn onward(
        &self,
        at: &Incidence,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<Onward> {
        let (normal, reflected) = self.reflected(at);
        if Lobe::take(lobe, reflected, weight, stream) == Lobe::Reflected {
            let direction = reflect(at.direction, normal);
            *weight *= at.adjoint(side, normal, direction);
            return Some(Onward { direction, density: 0.0 });
        }
        let channel = Dielectric::channel(self.from, self.to, weight, stream)?;
        let (from, to) = (self.from[channel], self.to[channel]);
        let bend = |normal| Dielectric::refract(at.direction, normal, from, to);
        let normal = at.specular_normal(bend, false);
        let direction = bend(normal)?;
        *weight *= at.adjoint(side, normal, direction);
        if side == Side::Eye {
            *weight *= (from / to).powi(2);
        }
        Some(Onward { direction, density: 0.0 })
    }
}
