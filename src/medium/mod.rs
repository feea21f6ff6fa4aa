//! What fills space: coefficients, densities, phase functions and glow.
//!
//! A medium's coefficients are given per unit of density and multiplied by the density ρ(x):
//! σ_t,c(x) = σ_t,c ρ(x). So the albedo and the phase function are the same everywhere in it, and one
//! number along a ray, the depth D = ∫ρ dt, gives the transmittance of every channel,
//! T_c = e^{−σ_t,c D}.

pub mod black_body;
pub mod density;
pub mod phase;
pub mod presets;

use crate::math::{DVec3, Rgb};
use black_body::BlackBody;
use density::{Coarse, Density, Grid};
use phase::Phase;

/// A participating medium.
#[derive(Clone, Debug)]
pub struct Medium {
    /// Its name in the scene file.
    pub name: String,
    /// σ_t per unit of density, per unit of length.
    pub extinction: Rgb,
    /// σ_s/σ_t; 0 where σ_t is 0.
    pub albedo: Rgb,
    /// Over which directions it scatters light, as probability per steradian.
    pub phase: Phase,
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
}

impl Medium {
    /// Whether it scatters at all.
    pub fn scatters(&self) -> bool {
        (self.extinction * self.albedo).max_element() > 0.0 && self.density.max() > 0.0
    }

    /// Its largest channel's extinction where it is densest.
    pub fn max_extinction(&self) -> f64 {
        self.extinction.max_element() * self.density.max()
    }

    /// About how dense it is, if it scatters and is made of voxels.
    pub fn uneven(&self) -> Option<&Coarse> {
        self.density.voxels().filter(|_| self.scatters()).and_then(Grid::coarse)
    }

    /// Whether it neither absorbs, scatters nor glows.
    pub fn is_clear(&self) -> bool {
        self.extinction.max_element() <= 0.0 || self.density.max() <= 0.0
    }

    /// Whether it glows: it needs absorption to do so (Kirchhoff's law).
    pub fn glows(&self) -> bool {
        let absorbs = (self.extinction * (Rgb::ONE - self.albedo)).max_element() > 0.0;
        absorbs && !self.is_clear() && !matches!(self.emission, Emission::None)
    }

    /// e^{−σ_t,c D} for a depth D, infinite ones included.
    pub fn transmittance(&self, depth: f64) -> Rgb {
        transmittance(self.extinction, depth)
    }

    /// σ_a L_e/ρ at `p`: radiance per unit of length and density.
    pub fn emitted(&self, p: DVec3) -> Rgb {
        let absorption = self.extinction * (Rgb::ONE - self.albedo);
        match &self.emission {
            Emission::None => Rgb::ZERO,
            Emission::Uniform(radiance) => absorption * *radiance,
            Emission::BlackBody { temperature, kelvin_scale, scale, table } => {
                absorption * *scale * table.radiance(temperature.at(p) * kelvin_scale)
            }
        }
    }
}

/// e^{−σ D} per channel; 1 in a channel without extinction, however deep.
pub fn transmittance(extinction: Rgb, depth: f64) -> Rgb {
    let passed = |sigma: f64| if sigma == 0.0 { 1.0 } else { (-sigma * depth).exp() };
    if extinction == Rgb::splat(extinction.x) { Rgb::splat(passed(extinction.x)) } else { extinction.map(passed) }
}
