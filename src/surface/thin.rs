use super::mirror::reflect;
use super::{Incidence, Lobe, Onward, Side, fresnel};
use crate::math::{Rgb, Stream};

/// A sheet of a dielectric without thickness, as of window glass or soap: light is reflected or goes straight on, after any number
/// of reflections between its two faces: R = F + (1 − F)² F/(1 − F²) = 2F/(1 + F). Nothing is absorbed.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Thin {
    /// The sheet's index of refraction by channel, above 0, relative to what is around.
    pub index: Rgb,
}

impl Thin {
    fn reflected(&self, cos: f64) -> Rgb {
        self.index.map(|index| {
            let once = fresnel(cos, 1.0, index);
            2.0 * once / (1.0 + once)
        })
    }

    /// Reflects or passes by chance. Shading normals turn what is reflected only.
    pub(super) fn onward(&self, at: &Incidence, side: Side, weight: &mut Rgb, stream: &mut Stream) -> Option<Onward> {
        let normal = at.specular_normal(|normal| Some(reflect(at.direction, normal)), true);
        let reflected = self.reflected(-at.direction.dot(normal));
        if Lobe::take(None, reflected, weight, stream) == Lobe::Refracted {
            return Some(Onward { direction: at.direction, density: 0.0 });
        }
        let direction = reflect(at.direction, normal);
        *weight *= at.adjoint(side, normal, direction);
        Some(Onward { direction, density: 0.0 })
    }
}
