use super::lambert::{cosine, cosine_density};
use super::mirror::reflect;
use super::{Drawn, Incidence, Scattering};
use crate::math::{DVec3, Frame, Rgb, Stream, sampling};
use std::f64::consts::{PI, TAU};

/// Phong's lobe about the mirror direction beside diffuse reflection, normalised (Lewis 1993; Lafortune and Willems 1994):
///
/// f = diffuse/π + specular (n + 2)/2π cosⁿ α, with α the angle between `o` and the mirror direction of `i`.
///
/// It is reciprocal, and loses what its formula loses: the albedo is diffuse + specular for light straight on, and less at an
/// angle, where part of the lobe lies below the surface: for n = 1 half of the specular part is left at grazing angles.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Phong {
    /// The share of light that is reflected diffusely, by channel in \[0, 1\].
    pub diffuse: Rgb,
    /// The share of light straight on that the lobe reflects, by channel; with `diffuse` at most 1.
    pub specular: Rgb,
    /// n, at least 0: the higher, the sharper.
    pub exponent: f64,
}

impl Phong {
    /// GGX's α of a lobe that is as wide: cosⁿ falls to a half where α = √(2/(n + 2)); 1 if it is diffuse in part.
    pub(super) fn alpha(&self) -> f64 {
        if self.diffuse.max_element() > 0.0 { 1.0 } else { (2.0 / (self.exponent + 2.0)).sqrt() }
    }

    /// With what probability a draw is diffuse.
    fn diffuse_chance(&self) -> f64 {
        let [diffuse, specular] = [self.diffuse, self.specular].map(|part| part.element_sum());
        if specular > 0.0 { diffuse / (diffuse + specular) } else { 1.0 }
    }

    /// cosⁿ α.
    fn lobe(&self, at: &Incidence, o: DVec3) -> f64 {
        let cos = reflect(at.direction, at.shading_normal).dot(o);
        if cos > 0.0 { cos.powf(self.exponent) } else { 0.0 }
    }

    fn density(&self, at: &Incidence, o: DVec3, lobe: f64) -> f64 {
        let chance = self.diffuse_chance();
        chance * cosine_density(at.shading_normal, o) + (1.0 - chance) * (self.exponent + 1.0) / TAU * lobe
    }

    pub(super) fn value(&self, at: &Incidence, o: DVec3) -> Scattering {
        let (cos, lobe) = (at.shading_normal.dot(o).max(0.0), self.lobe(at, o));
        let value = cos * (self.diffuse / PI + self.specular * ((self.exponent + 2.0) / TAU * lobe));
        Scattering { value, ahead: Rgb::splat(self.density(at, o, lobe)) }
    }

    /// A direction drawn by the cosine or by the lobe; `None` where that lies below the surface.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Option<Drawn> {
        let normal = at.shading_normal;
        let direction = if stream.uniform() < self.diffuse_chance() {
            cosine(normal, stream).0
        } else {
            let [u, v] = stream.uniform2();
            let cos = u.powf(1.0 / (self.exponent + 1.0));
            Frame::around(reflect(at.direction, normal)).to_world(sampling::direction(cos, v)).normalize()
        };
        let Scattering { value, ahead } = self.value(at, direction);
        let density = ahead.x;
        (direction.dot(normal) > 0.0 && density > 0.0).then(|| Drawn {
            direction,
            normal,
            factor: value / density,
            density,
        })
    }
}
