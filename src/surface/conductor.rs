use super::ggx::{Ggx, MOST_FACETS};
use super::mirror::reflect;
use super::{Drawn, Incidence, Scattering};
use crate::math::{DVec3, Rgb, Stream};

/// A metal, smooth or of mirror-like facets by GGX. Light that a facet sends onto others is followed until it leaves, as
/// [`Rough`](super::Rough) boundaries do: where facets absorb nothing, nothing is lost.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Conductor {
    /// What a facet reflects.
    pub fresnel: Fresnel,
    /// GGX's α along the surface's u and v, each in \[0, 1\]; smooth where either is 0.
    pub roughness: [f64; 2],
}

/// The share of light that a plane reflects, by its angle.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fresnel {
    /// By Fresnel's equations for a complex index of refraction η + ik, relative to what is around.
    Complex {
        /// η by channel, above 0.
        eta: Rgb,
        /// k by channel, at least 0.
        k: Rgb,
    },
    /// By Schlick's approximation, f₀ + (1 − f₀)(1 − cos θ)⁵ (Schlick 1994).
    Schlick {
        /// The share of light that is reflected straight back, by channel in \[0, 1\].
        f0: Rgb,
    },
}

/// η and k of metals for red, green and blue: gold, silver and copper by Johnson and Christy (1972, Table I) at 2.01, 2.26 and
/// 2.75 eV (617, 549 and 451 nm); aluminium by Shiles, Sasaki, Inokuti and Smith (1980) at 2.0, 2.2 and 2.8 eV.
const METALS: [(&str, [f64; 3], [f64; 3]); 4] = [
    ("Ag", [0.06, 0.06, 0.04], [4.152, 3.586, 2.657]),
    ("Al", [1.304, 1.018, 0.598], [7.479, 6.846, 5.385]),
    ("Au", [0.21, 0.43, 1.38], [3.272, 2.455, 1.914]),
    ("Cu", [0.30, 1.02, 1.24], [3.205, 2.577, 2.397]),
];

impl Fresnel {
    /// The metals that there are, by their chemical symbols.
    pub fn metals() -> impl Iterator<Item = (&'static str, Fresnel)> {
        METALS
            .iter()
            .map(|&(name, eta, k)| (name, Fresnel::Complex { eta: Rgb::from_array(eta), k: Rgb::from_array(k) }))
    }

    /// The share that is reflected at an angle of this cosine.
    pub fn reflected(&self, cos: f64) -> Rgb {
        let cos = cos.clamp(0.0, 1.0);
        match *self {
            Fresnel::Complex { eta, k } => Rgb::from_array(std::array::from_fn(|c| complex(cos, eta[c], k[c]))),
            Fresnel::Schlick { f0 } => f0 + (Rgb::ONE - f0) * (1.0 - cos).powi(5),
        }
    }
}

/// Fresnel's equations for a complex index, unpolarised (Born and Wolf 1999, §14.2, with Re and Im of √(η² − k² − sin² θ + 2iηk)).
fn complex(cos: f64, eta: f64, k: f64) -> f64 {
    let (cos2, sin2) = (cos * cos, 1.0 - cos * cos);
    let (e2, k2) = (eta * eta, k * k);
    let real = e2 - k2 - sin2;
    let modulus = real.hypot(2.0 * eta * k);
    // The larger half by a sum, the other one by the product: no cancellation.
    let a = if real >= 0.0 { (0.5 * (modulus + real)).sqrt() } else { eta * k / (0.5 * (modulus - real)).sqrt() };
    let perpendicular = ((modulus + cos2) - 2.0 * a * cos) / ((modulus + cos2) + 2.0 * a * cos).max(f64::MIN_POSITIVE);
    let (sum, twice) = (cos2 * modulus + sin2 * sin2, 2.0 * a * cos * sin2);
    let parallel = perpendicular * (sum - twice) / (sum + twice).max(f64::MIN_POSITIVE);
    (0.5 * (parallel + perpendicular)).clamp(0.0, 1.0)
}

impl Conductor {
    /// The normals of its facets, if it is rough.
    pub(super) fn facets(&self) -> Option<Ggx> {
        (self.roughness[0] > 0.0 && self.roughness[1] > 0.0).then_some(Ggx { alpha: self.roughness })
    }

    /// α of facets that are the same in all directions, with as high a peak; 0 if it is smooth.
    pub(super) fn alpha(&self) -> f64 {
        // The roots first: a product might vanish where neither is 0.
        self.roughness[0].sqrt() * self.roughness[1].sqrt()
    }

    /// What facets send along `o`, one part a facet: see [`Bsdf::toward`](super::Bsdf::toward).
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        mut weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        let Some(facets) = self.facets() else { return };
        let frame = at.frame();
        let (mut travel, leaving) = (frame.to_local(at.direction), frame.to_local(o));
        if leaving.z <= 0.0 {
            return;
        }
        for _ in 0..MOST_FACETS {
            if let Some((density, cos)) = facets.reflection(-travel, leaving) {
                part(weight, Scattering { value: self.fresnel.reflected(cos) * density, ahead: Rgb::splat(density) });
            }
            if self.meet(&facets, &mut travel, &mut weight, stream) || weight.max_element() <= 0.0 {
                return;
            }
        }
    }

    /// Where facets send light, or the plane.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Option<Drawn> {
        let Some(facets) = self.facets() else {
            let normal = at.specular_normal(|normal| Some(reflect(at.direction, normal)), true);
            let factor = self.fresnel.reflected(-at.direction.dot(normal));
            return Some(Drawn { direction: reflect(at.direction, normal), normal, factor, density: 0.0 });
        };
        let frame = at.frame();
        let (mut travel, mut factor) = (frame.to_local(at.direction), Rgb::ONE);
        for _ in 0..MOST_FACETS {
            let arriving = travel;
            if self.meet(&facets, &mut travel, &mut factor, stream) {
                let density = facets.reflection(-arriving, travel).map_or(0.0, |(density, _)| density);
                let direction = frame.to_world(travel).normalize();
                return Some(Drawn { direction, normal: at.shading_normal, factor, density });
            }
        }
        None
    }

    /// Meets a facet. Returns whether light leaves then.
    fn meet(&self, facets: &Ggx, travel: &mut DVec3, weight: &mut Rgb, stream: &mut Stream) -> bool {
        let (cos, leaves) = facets.bounce(travel, stream);
        *weight *= self.fresnel.reflected(cos);
        leaves
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::fresnel;

    /// Without absorption the complex index is a real one; straight on the formula is ((η − 1)² + k²)/((η + 1)² + k²), along the
    /// surface everything is reflected.
    #[test]
    fn complex_indices_have_their_limits() {
        for cos in [1.0, 0.7, 0.3, 1e-3] {
            assert!((complex(cos, 1.5, 0.0) - fresnel(cos, 1.0, 1.5)).abs() < 1e-12);
            assert!((complex(cos, 0.8, 0.0) - fresnel(cos, 1.0, 0.8)).abs() < 1e-12);
        }
        for (_, metal) in Fresnel::metals() {
            let Fresnel::Complex { eta, k } = metal else { panic!("measured") };
            let straight =
                ((eta - Rgb::ONE) * (eta - Rgb::ONE) + k * k) / ((eta + Rgb::ONE) * (eta + Rgb::ONE) + k * k);
            assert!((metal.reflected(1.0) - straight).abs().max_element() < 1e-12);
            assert!((metal.reflected(0.0) - Rgb::ONE).abs().max_element() < 1e-9);
        }
    }
}
