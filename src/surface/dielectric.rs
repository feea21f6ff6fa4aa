use super::Material;
use crate::math::{DVec3, Rgb, Stream, shares};

/// A boundary that reflects and refracts by Fresnel's equations.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Dielectric {
    /// The absolute index of refraction inside, by channel and above 0. Scene files call it `ior`.
    #[serde(rename = "ior")]
    pub index: Rgb,
    /// GGX's α, in \[0, 1\]: see [`Rough`](super::Rough); 0 is smooth.
    pub roughness: f64,
}

impl From<Dielectric> for Material {
    fn from(material: Dielectric) -> Material {
        Material::Dielectric(material)
    }
}

/// Where light goes on from a refracting boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Back from the boundary.
    Reflected,
    /// Through the boundary.
    Refracted,
}

impl Lobe {
    /// Refracted for reflected, and reflected for refracted.
    pub fn other(self) -> Lobe {
        match self {
            Lobe::Reflected => Lobe::Refracted,
            Lobe::Refracted => Lobe::Reflected,
        }
    }

    /// Which light takes that meets a facet: `given`, or drawn by the channels' shares of `weight`. `reflected` is the
    /// part of each channel that is reflected; `weight` is weighted for it.
    pub fn take(given: Option<Lobe>, reflected: Rgb, weight: &mut Rgb, stream: &mut Stream) -> Lobe {
        Lobe::take_by(given, reflected, |share| share, weight, stream)
    }

    /// The same, but with a chance to be reflected that `chance` makes of the share that is.
    pub fn take_by(
        given: Option<Lobe>,
        reflected: Rgb,
        chance: impl FnOnce(f64) -> f64,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Lobe {
        let (lobe, chance) = given.map_or_else(
            || {
                let chance = chance((shares(*weight) * reflected).element_sum());
                if stream.uniform() < chance { (Lobe::Reflected, chance) } else { (Lobe::Refracted, 1.0 - chance) }
            },
            |lobe| (lobe, 1.0),
        );
        *weight *= match lobe {
            Lobe::Reflected => reflected / chance,
            Lobe::Refracted => (Rgb::ONE - reflected) / chance,
        };
        lobe
    }
}

impl Dielectric {
    /// The refracted direction of light that meets a surface, whose unit `normal` faces it, from index
    /// `from` into index `to` (Snell's law); `None` where reflection is total.
    pub fn refract(direction: DVec3, normal: DVec3, from: f64, to: f64) -> Option<DVec3> {
        let cos = -direction.dot(normal);
        let ratio = from / to;
        let sin2 = ratio * ratio * (1.0 - cos * cos).max(0.0);
        (sin2 < 1.0).then(|| (ratio * direction + (ratio * cos - (1.0 - sin2).sqrt()) * normal).normalize())
    }

    /// Whether a boundary between these indices sends the channels different ways.
    pub fn disperses(from: Rgb, to: Rgb) -> bool {
        from != Rgb::splat(from.x) || to != Rgb::splat(to.x)
    }

    /// The channel by whose indices refracted light goes on. Where the channels part, it is drawn by their shares of
    /// `weight`, and carries on with the weight of all; `None` where there is none.
    pub fn channel(from: Rgb, to: Rgb, weight: &mut Rgb, stream: &mut Stream) -> Option<usize> {
        if !Self::disperses(from, to) {
            return Some(0);
        }
        let sum = weight.element_sum();
        let u = stream.uniform() * sum;
        let channel = if u < weight.x {
            0
        } else if u < weight.x + weight.y {
            1
        } else {
            2
        };
        if weight[channel] <= 0.0 {
            return None;
        }
        *weight = Rgb::ZERO;
        weight[channel] = sum;
        Some(channel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refraction_obeys_snell_and_reverses() {
        let normal = DVec3::new(0.0, 0.0, 1.0);
        for sin in [0.0, 0.1, 0.7, 0.999_999] {
            let direction = DVec3::new(sin, 0.0, -(1.0f64 - sin * sin).sqrt());
            let inside = Dielectric::refract(direction, normal, 1.0, 1.5).expect("into the denser side");
            assert!((inside.x * 1.5 - sin).abs() < 1e-12);
            let back = Dielectric::refract(-inside, -normal, 1.5, 1.0).expect("reversible");
            assert!((back + direction).length() < 1e-9);
        }
        assert!(Dielectric::refract(DVec3::new(0.8, 0.0, -0.6), normal, 1.5, 1.0).is_none());
    }
}
