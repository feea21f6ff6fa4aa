//! What fills space: coefficients, densities, phase functions and glow.
//!
//! A medium's coefficients are given per unit of density and multiplied by the density ρ(x):
//! σ_t,c(x) = σ_t,c ρ(x). So one number along a ray, the depth D = ∫ρ dt, gives the transmittance of every
//! channel, T_c = e^{−σ_t,c D}. The albedo, the phase function and the glow are the same everywhere, or told by
//! grids beside the density's, or by the media that fill the same space together.

pub mod black_body;
pub mod density;
mod field;
mod parts;
pub mod phase;
pub mod presets;

use std::sync::Arc;

use crate::math::{DAffine3, DVec3, Rgb};
use black_body::BlackBody;
use density::{Density, Grid};
pub use field::{Albedo, Asymmetry, Field, Phases, VaryingAlbedo};
pub use parts::Parts;
pub(crate) use parts::share;

/// A participating medium.
#[derive(Clone, Debug)]
pub struct Medium {
    /// Its name in the scene file.
    pub name: String,
    /// σ_t per unit of density, per unit of length.
    pub extinction: Rgb,
    /// σ_s/σ_t; 0 where σ_t is 0.
    pub albedo: Albedo,
    /// Over which directions it scatters light, as probability per steradian.
    pub phase: Phases,
    /// Its density over space, by which the coefficients are multiplied.
    pub density: Density,
    /// The light that its particles send out.
    pub emission: Emission,
}

/// The radiance L_e of a medium's particles; σ_a L_e is emitted per unit of length (Jensen 2001, Eq. 10.5).
#[derive(Clone, Debug)]
pub enum Emission {
    /// None is sent out.
    None,
    /// A radiance that all its particles have.
    Uniform(Rgb),
    /// A black body with a grid of temperatures.
    BlackBody {
        /// The grid of temperatures, before their scale.
        temperature: Box<Grid>,
        /// Kelvin per voxel value.
        kelvin_scale: f64,
        /// A factor of the radiance.
        scale: f64,
        /// Planck's radiance, by temperature.
        table: BlackBody,
    },
    /// A radiance that voxels tell.
    Grid(Box<Field>),
    /// That of several media, by how much each absorbs at a place.
    Mixed(Arc<Parts>),
}

impl Medium {
    /// The grids that it is made of.
    fn grids(&self) -> impl Iterator<Item = &Grid> {
        let glow = match &self.emission {
            Emission::None | Emission::Uniform(_) => Vec::new(),
            Emission::BlackBody { temperature, .. } => vec![&**temperature],
            Emission::Grid(field) => field.grids(),
            Emission::Mixed(parts) => parts.media().iter().flat_map(Medium::grids).collect(),
        };
        self.density.grids().chain(self.albedo.grids()).chain(self.phase.grids()).chain(glow)
    }

    /// Whether it scatters at all.
    pub fn scatters(&self) -> bool {
        (self.extinction * self.albedo.range().1).max_element() > 0.0 && self.density.max() > 0.0
    }

    /// The albedo at the point `p`.
    #[inline]
    pub fn albedo_at(&self, p: DVec3) -> Rgb {
        match &self.albedo {
            Albedo::Even(albedo) => *albedo,
            Albedo::Varying(albedo) => albedo.at(p, || self.density.at(p)),
            Albedo::Mixed(parts) => parts.albedo(p),
        }
    }

    /// Carried along by a transform of the scene.
    pub(crate) fn moved(&self, transform: DAffine3) -> Medium {
        let emission = match &self.emission {
            Emission::None => Emission::None,
            Emission::Uniform(radiance) => Emission::Uniform(*radiance),
            Emission::BlackBody { temperature, kelvin_scale, scale, table } => Emission::BlackBody {
                temperature: Box::new(temperature.moved(transform)),
                kelvin_scale: *kelvin_scale,
                scale: *scale,
                table: table.clone(),
            },
            Emission::Grid(field) => Emission::Grid(Box::new(field.moved(transform))),
            Emission::Mixed(parts) => Emission::Mixed(Arc::new(parts.moved(transform))),
        };
        Medium {
            name: self.name.clone(),
            extinction: self.extinction,
            albedo: self.albedo.moved(transform),
            phase: self.phase.moved(transform),
            density: self.density.moved(transform),
            emission,
        }
    }

    /// Its largest channel's extinction where it is densest.
    pub fn max_extinction(&self) -> f64 {
        self.extinction.max_element() * self.density.max()
    }

    /// Its density, if it scatters and is made of voxels whose cells tell about how dense it is.
    pub fn uneven(&self) -> Option<&Density> {
        (self.scatters() && self.density.has_cells()).then_some(&self.density)
    }

    /// Whether it neither absorbs, scatters nor glows.
    pub fn is_clear(&self) -> bool {
        self.extinction.max_element() <= 0.0 || self.density.max() <= 0.0
    }

    /// Whether it glows: it needs absorption to do so (Kirchhoff's law).
    pub fn glows(&self) -> bool {
        let absorbs = (self.extinction * (Rgb::ONE - self.albedo.range().0)).max_element() > 0.0;
        absorbs && !self.is_clear() && !matches!(self.emission, Emission::None)
    }

    /// What its particles send out, if that and what they absorb is the same everywhere: an integral has a closed form then.
    pub fn even_glow(&self) -> Option<Rgb> {
        match self.emission {
            Emission::Uniform(radiance) if self.albedo.even().is_some() => Some(radiance),
            _ => None,
        }
    }

    /// e^{−σ_t,c D} for a depth D, infinite ones included.
    pub fn transmittance(&self, depth: f64) -> Rgb {
        transmittance(self.extinction, depth)
    }

    /// σ_a L_e at `p`: radiance per unit of length.
    pub fn emitted_at(&self, p: DVec3) -> Rgb {
        match &self.emission {
            Emission::None => Rgb::ZERO,
            Emission::Mixed(parts) => parts.emitted(p),
            _ => match self.density.at(p) {
                density if density > 0.0 => self.emitted(p) * density,
                _ => Rgb::ZERO,
            },
        }
    }

    /// σ_a L_e/ρ at `p`: radiance per unit of length and density.
    pub fn emitted(&self, p: DVec3) -> Rgb {
        let absorption = || self.extinction * (Rgb::ONE - self.albedo_at(p));
        match &self.emission {
            Emission::None => Rgb::ZERO,
            Emission::Uniform(radiance) => absorption() * *radiance,
            Emission::BlackBody { temperature, kelvin_scale, scale, table } => {
                absorption() * *scale * table.radiance(temperature.at(p) * kelvin_scale)
            }
            Emission::Grid(field) => absorption() * field.at(p),
            Emission::Mixed(parts) => match self.density.at(p) {
                density if density > 0.0 => parts.emitted(p) / density,
                _ => Rgb::ZERO,
            },
        }
    }
}

/// The memory that the voxels of media take together, in bytes; those that several of them share count once.
pub fn bytes(media: &[Medium]) -> u64 {
    let mut seen = Vec::new();
    let mut bytes = 0;
    for voxels in media.iter().flat_map(Medium::grids).map(Grid::voxels) {
        if !seen.contains(&Arc::as_ptr(voxels)) {
            seen.push(Arc::as_ptr(voxels));
            bytes += voxels.bytes() as u64;
        }
    }
    bytes
}

/// e^{−σ D} per channel; 1 in a channel without extinction, however deep.
pub fn transmittance(extinction: Rgb, depth: f64) -> Rgb {
    let passed = |sigma: f64| if sigma == 0.0 { 1.0 } else { (-sigma * depth).exp() };
    if extinction == Rgb::splat(extinction.x) { Rgb::splat(passed(extinction.x)) } else { extinction.map(passed) }
}
