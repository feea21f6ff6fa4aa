//! Mixtures of materials, where light meets them.

use super::Scene;
use crate::math::choose;
use crate::surface::{Material, Mixture, Parameter, TexturePoint};

/// A material, and what changes over it.
#[derive(Clone, Copy, Debug)]
pub struct Finish {
    /// What it does with light.
    pub material: Material,
    /// What changes over it: an index into [`Scene::paints`].
    pub paint: Option<u32>,
}

impl Scene {
    /// The two parts of a mixture with their shares at a place.
    fn parts(&self, mixture: &Mixture, paint: Option<u32>, at: &TexturePoint) -> [(f64, Finish); 2] {
        let weight = paint
            .map_or(mixture.weight, |paint| self.paints[paint as usize].number(Parameter::Weight, mixture.weight, at));
        let part = |index: u32| self.finishes[index as usize];
        [(1.0 - weight, part(mixture.a)), (weight, part(mixture.b))]
    }

    /// Whether any shape is of a material for which `holds` is true, or of a mixture with such a part.
    pub fn any_material(&self, holds: &impl Fn(&Material) -> bool) -> bool {
        self.surfaces.iter().any(|surface| self.any_part(&surface.material, holds))
    }

    /// Whether `holds` is true of a material, or of one that it is a mixture of.
    pub fn any_part(&self, material: &Material, holds: &impl Fn(&Material) -> bool) -> bool {
        match material {
            Material::Mixture(mixture) => {
                let part = |index: u32| self.any_part(&self.finishes[index as usize].material, holds);
                part(mixture.a) || part(mixture.b)
            }
            _ => holds(material),
        }
    }

    /// The share of light that meets a material at a place for which `holds` is true.
    pub fn share(&self, finish: &Finish, at: &TexturePoint, holds: &impl Fn(&Finish) -> bool) -> f64 {
        match &finish.material {
            Material::Mixture(mixture) => {
                let parts = self.parts(mixture, finish.paint, at);
                parts.iter().map(|(share, part)| share * self.share(part, at, holds)).sum()
            }
            _ => f64::from(u8::from(holds(finish))),
        }
    }

    /// The share of light that passes through it at a place as if it were not there.
    pub fn passes(&self, finish: &Finish, at: &TexturePoint) -> f64 {
        match &finish.material {
            Material::None => 1.0,
            Material::Mixture(mixture) if mixture.has_holes => {
                self.parts(mixture, finish.paint, at).iter().map(|(share, part)| share * self.passes(part, at)).sum()
            }
            _ => 0.0,
        }
    }

    /// Chooses by a uniform number from [0, 1) which material is met at a place, of light that does not pass; `None` where there is
    /// none. With it comes what turns the normal: its own relief, or else that of the mixture.
    pub fn met(&self, finish: &Finish, at: &TexturePoint, mut u: f64) -> Option<(Finish, Option<u32>)> {
        let mut finish = *finish;
        let has_relief = |paint: &u32| self.paints[*paint as usize].relief.is_some();
        let mut relief = finish.paint.filter(has_relief);
        while let Material::Mixture(mixture) = &finish.material {
            let parts = self.parts(mixture, finish.paint, at);
            let kept =
                parts.map(|(share, part)| if share > 0.0 { share * (1.0 - self.passes(&part, at)) } else { 0.0 });
            let choice = choose(kept, kept[0] + kept[1], u)?;
            finish = parts[choice.index].1;
            relief = finish.paint.filter(has_relief).or(relief);
            u = choice.rest;
        }
        Some((finish, relief))
    }
}
