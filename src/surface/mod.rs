//! What surfaces do with light: one file a material.

mod dielectric;
mod lambert;
mod mirror;
mod rough;

pub use dielectric::{Dielectric, Lobe, fresnel, reflectance};
pub use lambert::Lambert;
pub use mirror::Mirror;
pub use rough::{Facet, Leaving, Rough};

use crate::math::Rgb;

/// One of the materials a scene file can name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Material {
    /// Diffuse reflection.
    Lambert(Lambert),
    /// Specular reflection.
    Mirror(Mirror),
    /// A boundary between indices of refraction.
    Dielectric(Dielectric),
    /// No surface: light passes, only the medium changes.
    None,
}

impl Material {
    /// Whether light never passes through.
    pub fn is_opaque(&self) -> bool {
        matches!(self, Material::Lambert(_) | Material::Mirror(_))
    }

    /// The index of refraction inside, if it has one.
    pub fn index(&self) -> Option<Rgb> {
        match self {
            Material::Dielectric(dielectric) => Some(dielectric.index),
            _ => None,
        }
    }

    /// The share of light that an opaque material reflects.
    pub fn reflectance(&self) -> Option<Rgb> {
        match self {
            Material::Lambert(lambert) => Some(lambert.reflectance),
            Material::Mirror(mirror) => Some(mirror.reflectance),
            Material::Dielectric(_) | Material::None => None,
        }
    }
}
