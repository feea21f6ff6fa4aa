use super::mirror::reflect;
use super::{Incidence, Lobe, Onward, Side, Straight, fresnel};
use crate::math::{DVec3, Rgb, Stream};

/// A sheet of a dielectric without thickness, as of window glass or soap: light is reflected or goes straight on, after any number
/// of reflections between its two faces: R = F + (1 − F)² F/(1 − F²) = 2F/(1 + F). Nothing is absorbed.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Thin {
    /// The sheet's index of refraction by channel, above 0, relative to what is around.
    pub index: Rgb,
}

impl Thin {
    /// The part of each channel that is reflected, and about which normal: the same from both ends of a way.
    fn reflected(&self, at: &Incidence) -> (DVec3, Rgb) {
        let normal = at.specular_normal(|normal| Some(reflect(at.direction, normal)), true);
        let reflected = self.index.map(|index| {
            let once = fresnel(-at.direction.dot(normal), 1.0, index);
            2.0 * once / (1.0 + once)
        });
        (normal, reflected)
    }

    /// Where it mirrors an eye path to, and how much of it.
    pub(super) fn mirrored(&self, at: &Incidence) -> (DVec3, Rgb) {
        let (normal, reflected) = self.reflected(at);
        (reflect(at.direction, normal), reflected)
    }

    /// What passes, all of it straight on.
    pub(super) fn straight(&self, at: &Incidence) -> Straight {
        Straight { passed: Rgb::ONE - self.reflected(at).1, longer: Rgb::ONE }
    }

    /// Reflects or passes, by chance or as `lobe` says. Shading normals turn what is reflected only.
    pub(super) fn onward(
        &self,
        at: &Incidence,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<Onward> {
        let (normal, reflected) = self.reflected(at);
        if Lobe::take(lobe, reflected, weight, stream) == Lobe::Refracted {
            return Some(Onward { direction: at.direction, density: 0.0 });
        }
        let direction = reflect(at.direction, normal);
        *weight *= at.adjoint(side, normal, direction);
        Some(Onward { direction, density: 0.0 })
    }
}
