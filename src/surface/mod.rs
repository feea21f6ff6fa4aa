//! What surfaces do with light: one file a material.
//!
//! A scene file names a [`Material`], and so does its [description](crate::scene::Description). Where light meets it, it acts
//! by a [`Bsdf`], which answers what everyone asks: its [`Nature`], its albedo, what goes [toward](Bsdf::toward) a direction
//! (value and density), and where light goes [onward](Bsdf::onward) (a draw). What is drawn and what is said to be drawn
//! agree: tests hold every kind to that.
//!
//! A new material that reflects is one file, with its parameters, `value` and `sample`, and its lines where kinds are listed: in
//! [`Reflector`], and among the readers of scene files in `scene/read/materials.rs`. Coats, and mixtures that
//! are asked as a whole, are made of such; a [`Mixture`] is of anything, and drawn from where light meets it. A [`Paint`] puts textures in place of a material's constants where light meets it.

mod coat;
mod coated;
mod conductor;
mod dielectric;
mod fresnel;
mod ggx;
mod glaze;
mod incidence;
mod lambert;
mod mirror;
mod mix;
mod mixture;
mod nature;
mod oren_nayar;
mod phong;
mod pyramid;
mod reflector;
mod rough;
mod schlick;
mod smooth;
mod texture;
mod thin;
mod transmittance;

pub use coat::{Coat, Varnish};
pub use coated::Coated;
pub use conductor::{Conductor, Fresnel};
pub use dielectric::{Dielectric, Lobe};
pub use fresnel::{fresnel, reflectance};
pub use incidence::{Incidence, Side};
pub use lambert::Lambert;
pub use mirror::Mirror;
pub use mix::Mix;
pub use mixture::Mixture;
pub use nature::{Boundary, Drawn, Nature, Onward, Scattering, Straight};
pub use oren_nayar::OrenNayar;
pub use phong::Phong;
pub use pyramid::Pyramid;
pub use reflector::Reflector;
pub use rough::Rough;
pub use schlick::Schlick;
pub use smooth::Smooth;
pub use texture::{
    Checker, Constituent, ImageTexture, NoiseTexture, Paint, Parameter, Relief, Slot, Space, Texture, TexturePoint,
    Wrap,
};
pub use thin::Thin;

use crate::math::{DVec3, Rgb, Stream};

/// What a scene file says a surface is made of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Material {
    /// A closed boundary around another index of refraction.
    Dielectric(Dielectric),
    /// No surface, but an index-matched boundary: light passes, only the medium changes.
    None,
    /// One of two materials, by chance wherever light meets it.
    Mixture(Mixture),
    /// Reflects; of light that is asked for, only a sheet lets some pass.
    // Serialised as scene files say it: `lambert`, not `opaque.lambert`. Serde wants such a variant last.
    #[serde(untagged)]
    Opaque(Bsdf),
}

impl Material {
    /// An opaque surface that reflects nothing.
    pub const BLACK: Material =
        Material::Opaque(Bsdf::Reflector(Reflector::Lambert(Lambert { reflectance: Rgb::ZERO })));

    /// Whether no light passes through that is asked for.
    pub fn is_opaque(&self) -> bool {
        match self {
            Material::Opaque(bsdf) => !bsdf.is_sheet(),
            Material::Mixture(mixture) => !mixture.has_holes && !mixture.has_sheets,
            Material::Dielectric(_) | Material::None => false,
        }
    }

    /// Whether nothing passes as if it were not there, so that light on its one side is not that on the other.
    pub fn is_wall(&self) -> bool {
        match self {
            Material::Opaque(_) => true,
            Material::Mixture(mixture) => !mixture.has_holes,
            Material::Dielectric(_) | Material::None => false,
        }
    }

    /// Whether it may keep off light that is asked for.
    pub fn shades(&self) -> bool {
        matches!(self, Material::Opaque(_) | Material::Mixture(_))
    }

    /// Whether it mirrors or refracts a part of the light in single directions; of a mixture, its parts must be asked.
    pub fn is_partly_specular(&self) -> bool {
        match self {
            Material::Opaque(bsdf) => bsdf.is_partly_specular(),
            Material::Dielectric(dielectric) => dielectric.roughness == 0.0,
            Material::None | Material::Mixture(_) => false,
        }
    }

    /// Whether it sends light, or a part of it, into single directions or into few; of a mixture, its parts must be asked.
    pub fn is_narrow(&self) -> bool {
        match self {
            Material::Opaque(bsdf) => bsdf.nature() == Nature::Narrow || bsdf.is_partly_specular(),
            Material::Dielectric(_) => true,
            Material::None | Material::Mixture(_) => false,
        }
    }

    /// The index of refraction inside, if it has one.
    pub fn index(&self) -> Option<Rgb> {
        match self {
            Material::Dielectric(dielectric) => Some(dielectric.index),
            Material::Opaque(_) | Material::None | Material::Mixture(_) => None,
        }
    }
}

impl From<Bsdf> for Material {
    fn from(bsdf: Bsdf) -> Material {
        Material::Opaque(bsdf)
    }
}

impl From<Reflector> for Bsdf {
    fn from(reflector: Reflector) -> Bsdf {
        Bsdf::Reflector(reflector)
    }
}

impl From<Reflector> for Material {
    fn from(reflector: Reflector) -> Material {
        Material::Opaque(reflector.into())
    }
}

/// How a surface scatters light (its bidirectional scattering distribution function), where light meets it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Bsdf {
    /// A coat over a reflector.
    Coated(Coated),
    /// Two reflectors side by side.
    Mix(Mix),
    /// A sheet that reflects specularly and lets the rest pass straight on.
    #[serde(rename = "thin_dielectric")]
    Thin(Thin),
    /// A smooth boundary between two indices of refraction, where light meets a [`Dielectric`].
    Smooth(Smooth),
    /// A rough boundary between two indices of refraction, where light meets a [`Dielectric`].
    Rough(Rough),
    /// What reflects, and no more.
    #[serde(untagged)]
    Reflector(Reflector),
}

impl Bsdf {
    /// How it spreads light over directions: of kinds that do it in several ways, the most diffuse one.
    #[inline]
    pub fn nature(&self) -> Nature {
        match self {
            Bsdf::Reflector(reflector) => reflector.nature(),
            Bsdf::Coated(coated) => coated.nature(),
            Bsdf::Mix(mix) => mix.nature(),
            Bsdf::Rough(_) => Nature::Narrow,
            Bsdf::Smooth(_) | Bsdf::Thin(_) => Nature::Specular,
        }
    }

    /// The share of light that is not absorbed, of all that arrives as `at` says. Where facets, lobes or coats reflect, it is that of a
    /// plane with the same colours.
    #[inline]
    pub fn albedo(&self, at: &Incidence) -> Rgb {
        match self {
            Bsdf::Reflector(reflector) => reflector.albedo(at),
            Bsdf::Coated(coated) => coated.albedo(at),
            Bsdf::Mix(mix) => mix.albedo(at),
            Bsdf::Smooth(_) | Bsdf::Rough(_) | Bsdf::Thin(_) => Rgb::ONE,
        }
    }

    /// Tells `part` what goes on along `o` of light that arrives as `at` says with `weight`: the weight that comes to a part,
    /// and what that sends. One part for most kinds; rough boundaries follow light from facet to facet, and each of these
    /// is one. On average, weights times values add up to all that goes there. Light from that direction may be
    /// asked for while it might also be found by chance, each share weighted by its part's density. Where a path follows
    /// both lobes of a boundary, `both` says so, and densities are those of each lobe alone. Nothing is told of what is specular.
    #[allow(clippy::too_many_arguments, reason = "one question, asked in one place")]
    #[inline]
    pub fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        side: Side,
        both: bool,
        weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        if let Bsdf::Rough(rough) = self {
            return rough.toward(at, o, side, both, weight, stream, part);
        }
        // A shading normal may lead below the surface.
        if o.dot(at.normal) <= 0.0 {
            return;
        }
        let adjoint = at.adjoint(side, at.shading_normal, o);
        let reflects = |weight: Rgb, sent: Scattering| {
            if sent.ahead.x > 0.0 {
                part(weight, Scattering { value: sent.value * adjoint, ..sent });
            }
        };
        match self {
            Bsdf::Reflector(reflector) => reflector.toward(at, o, weight, stream, reflects),
            Bsdf::Coated(coated) => coated.toward(at, o, both, weight, stream, reflects),
            Bsdf::Mix(mix) => mix.toward(at, o, weight, stream, reflects),
            Bsdf::Smooth(_) | Bsdf::Rough(_) | Bsdf::Thin(_) => {}
        }
    }

    /// Draws where light goes on that arrives as `at` says, and weights `weight` for it; `None` where it ends. What a boundary
    /// does is left to chance, or given as `lobe`. `survives` applies the factor by which a reflection scales the weight, with
    /// roulette or without, and says whether light goes on; boundaries absorb nothing and ask for none.
    #[inline]
    pub fn onward(
        &self,
        at: &Incidence,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
        survives: impl FnOnce(&mut Rgb, Rgb, &mut Stream) -> bool,
    ) -> Option<Onward> {
        let drawn = match self {
            Bsdf::Reflector(reflector) => reflector.sample(at, stream),
            Bsdf::Coated(coated) => coated.sample(at, lobe, stream),
            Bsdf::Mix(mix) => mix.sample(at, stream),
            Bsdf::Thin(thin) => return thin.onward(at, side, lobe, weight, stream),
            Bsdf::Smooth(smooth) => return smooth.onward(at, side, lobe, weight, stream),
            Bsdf::Rough(rough) => return rough.onward(at, side, lobe, weight, stream),
        };
        let Drawn { direction, normal, factor, density } = drawn?;
        // A shading normal may lead below the surface.
        if direction.dot(at.normal) <= 0.0 {
            return None;
        }
        let factor = factor * at.adjoint(side, normal, direction);
        survives(weight, factor, stream).then_some(Onward { direction, density })
    }

    /// Where what also spreads light, or lets it pass straight on, mirrors an eye path to, and the factor that it leaves of its weight: all
    /// that [`onward`](Self::onward) draws with density 0 on this side, on average. `None` where there is no such part, or more of them.
    #[inline]
    pub fn mirrored(&self, at: &Incidence) -> Option<(DVec3, Rgb)> {
        let (direction, factor) = match self {
            Bsdf::Thin(thin) => thin.mirrored(at),
            Bsdf::Coated(coated) => {
                let Drawn { direction, factor, .. } = coated.mirrored(at)?;
                (direction, factor)
            }
            _ => return None,
        };
        (direction.dot(at.normal) > 0.0).then_some((direction, factor))
    }

    /// Whether a part of the light goes on in single directions, where it cannot be asked for.
    pub fn is_partly_specular(&self) -> bool {
        match self {
            Bsdf::Reflector(reflector) => reflector.is_partly_specular(),
            Bsdf::Coated(coated) => coated.is_partly_specular(),
            Bsdf::Mix(mix) => mix.a.is_partly_specular() || mix.b.is_partly_specular(),
            Bsdf::Thin(_) | Bsdf::Smooth(_) => true,
            Bsdf::Rough(_) => false,
        }
    }

    /// Whether what it sends along a direction is found by walks, from facet to facet or between layers: an estimate, and dear.
    #[inline]
    pub fn is_walked(&self) -> bool {
        match self {
            Bsdf::Reflector(reflector) => reflector.is_walked(),
            Bsdf::Coated(coated) => coated.is_walked(),
            Bsdf::Mix(mix) => mix.a.is_walked() || mix.b.is_walked(),
            Bsdf::Rough(_) => true,
            Bsdf::Thin(_) | Bsdf::Smooth(_) => false,
        }
    }

    /// Whether it is not the same when turned about the normal.
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        match self {
            Bsdf::Reflector(reflector) => reflector.is_anisotropic(),
            Bsdf::Coated(coated) => coated.is_anisotropic(),
            Bsdf::Mix(mix) => mix.a.is_anisotropic() || mix.b.is_anisotropic(),
            Bsdf::Thin(_) | Bsdf::Smooth(_) | Bsdf::Rough(_) => false,
        }
    }

    /// Puts a texture's value in place of a constant.
    fn set(&mut self, Slot { constituent, parameter }: Slot, value: Rgb) {
        let number = (value.element_sum() / 3.0).clamp(0.0, 1.0);
        match (self, constituent, parameter) {
            (Bsdf::Reflector(reflector), ..) => reflector.set(parameter, value),
            (Bsdf::Coated(coated), Constituent::Whole, _) => coated.coat.set(parameter, value),
            (Bsdf::Coated(coated), Constituent::First, _) => coated.base.set(parameter, value),
            (Bsdf::Mix(mix), Constituent::Whole, Parameter::Weight) => mix.weight = number,
            (Bsdf::Mix(mix), Constituent::First, _) => mix.a.set(parameter, value),
            (Bsdf::Mix(mix), Constituent::Second, _) => mix.b.set(parameter, value),
            _ => {}
        }
    }

    /// The reflectance of a surface that sends light equally in all directions.
    pub fn lambertian(&self) -> Option<Rgb> {
        match self {
            Bsdf::Reflector(Reflector::Lambert(lambert)) => Some(lambert.reflectance),
            _ => None,
        }
    }

    /// Whether it sends light so evenly in all directions that the cosine draws them well.
    pub fn is_matte(&self) -> bool {
        matches!(self, Bsdf::Reflector(Reflector::Lambert(_) | Reflector::OrenNayar(_)))
    }

    /// Whether it is a sheet: what passes goes on in the direction it had.
    pub fn is_sheet(&self) -> bool {
        matches!(self, Bsdf::Thin(_))
    }

    /// The boundary between two indices of refraction that it is, if it is one: light takes two ways there.
    #[inline]
    pub fn boundary(&self, at: &Incidence) -> Option<Boundary> {
        match self {
            Bsdf::Smooth(smooth) => Some(smooth.boundary(at)),
            Bsdf::Rough(rough) => Some(Boundary { from: rough.from, reflected: None }),
            _ => None,
        }
    }

    /// What passes if light goes straight on through a smooth boundary or a sheet; `None` where nothing does.
    pub fn straight(&self, at: &Incidence) -> Option<Straight> {
        match self {
            Bsdf::Smooth(smooth) => Some(smooth.straight(at)),
            Bsdf::Thin(thin) => Some(thin.straight(at)),
            _ => None,
        }
    }
}
