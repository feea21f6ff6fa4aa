//! What varies over a medium besides its density: numbers and colours that grids tell, of the density's own file.

use std::sync::Arc;

use super::Parts;
use super::density::Grid;
use super::phase::{HenyeyGreenstein, Phase};
use crate::math::{DAffine3, DVec3, Rgb, Stream};

/// A colour over space, from voxels, at least 0.
#[derive(Clone, Debug)]
pub struct Field {
    channels: Channels,
    scale: Rgb,
}

/// One grid for all channels, or one for each, in the same place.
#[derive(Clone, Debug)]
enum Channels {
    Grey(Grid),
    Colour(Box<[Grid; 3]>),
}

impl Field {
    /// A grid that tells all channels alike, multiplied by `scale`.
    pub fn grey(grid: Grid, scale: Rgb) -> Field {
        Field { channels: Channels::Grey(grid), scale }
    }

    /// A grid for each channel, multiplied by `scale`.
    pub fn colour(grids: [Grid; 3], scale: Rgb) -> Field {
        Field { channels: Channels::Colour(Box::new(grids)), scale }
    }

    /// The colour at the point `p`.
    pub fn at(&self, p: DVec3) -> Rgb {
        self.scale * self.each(|grid| grid.at(p))
    }

    /// Of each channel what is asked of its grid.
    fn each(&self, ask: impl Fn(&Grid) -> f64) -> Rgb {
        match &self.channels {
            Channels::Grey(grid) => Rgb::splat(ask(grid)),
            Channels::Colour(grids) => Rgb::from_array(grids.each_ref().map(ask)),
        }
    }

    /// The greatest value of a voxel, by channel.
    fn most(&self) -> Rgb {
        self.scale * self.each(Grid::max)
    }

    /// Carried along by a transform of the scene.
    pub(super) fn moved(&self, transform: DAffine3) -> Field {
        let channels = match &self.channels {
            Channels::Grey(grid) => Channels::Grey(grid.moved(transform)),
            Channels::Colour(grids) => Channels::Colour(Box::new(grids.each_ref().map(|grid| grid.moved(transform)))),
        };
        Field { channels, ..*self }
    }

    /// The grids that it is made of.
    pub(super) fn grids(&self) -> Vec<&Grid> {
        match &self.channels {
            Channels::Grey(grid) => vec![grid],
            Channels::Colour(grids) => grids.iter().collect(),
        }
    }
}

/// The share of extinction that scatters, σ_s/σ_t by channel; 0 where σ_t is 0.
#[derive(Clone, Debug)]
pub enum Albedo {
    /// The same everywhere.
    Even(Rgb),
    /// Told by voxels.
    Varying(Box<VaryingAlbedo>),
    /// That of several media, by how dense each is at a place.
    Mixed(Arc<Parts>),
}

/// An albedo that voxels tell.
#[derive(Clone, Debug)]
pub struct VaryingAlbedo {
    field: Field,
    /// Whether the field is σ_s by unit of σ_t where the density is 1: a coefficient, to be divided by the density.
    is_scattering: bool,
    least: Rgb,
    most: Rgb,
}

impl Albedo {
    /// Told by a field, which is the albedo itself; voxels have `least` to `most` of it.
    pub(crate) fn of_field(field: Field, least: Rgb) -> Albedo {
        let most = field.most();
        Albedo::Varying(Box::new(VaryingAlbedo { field, is_scattering: false, least, most }))
    }

    /// Told by the field of a scattering coefficient, by unit of the extinction where the density is 1; voxels have
    /// shares from `least` to `most`.
    pub(crate) fn of_scattering(field: Field, least: Rgb, most: Rgb) -> Albedo {
        Albedo::Varying(Box::new(VaryingAlbedo { field, is_scattering: true, least, most }))
    }

    /// That of all places, if it is the same everywhere.
    pub fn even(&self) -> Option<Rgb> {
        match self {
            Albedo::Even(albedo) => Some(*albedo),
            Albedo::Varying(_) | Albedo::Mixed(_) => None,
        }
    }

    /// The least and the most that it may be, by channel.
    pub fn range(&self) -> (Rgb, Rgb) {
        match self {
            Albedo::Even(albedo) => (*albedo, *albedo),
            Albedo::Varying(varying) => (varying.least, varying.most),
            Albedo::Mixed(parts) => parts.albedo_range(),
        }
    }

    pub(super) fn grids(&self) -> Vec<&Grid> {
        match self {
            Albedo::Even(_) => Vec::new(),
            Albedo::Varying(varying) => varying.field.grids(),
            Albedo::Mixed(parts) => parts.media().iter().flat_map(|medium| medium.albedo.grids()).collect(),
        }
    }

    pub(super) fn moved(&self, transform: DAffine3) -> Albedo {
        match self {
            Albedo::Even(_) => self.clone(),
            Albedo::Varying(varying) => {
                let field = varying.field.moved(transform);
                Albedo::Varying(Box::new(VaryingAlbedo { field, ..**varying }))
            }
            Albedo::Mixed(parts) => Albedo::Mixed(Arc::new(parts.moved(transform))),
        }
    }
}

impl VaryingAlbedo {
    /// The albedo at the point `p`, where the density is told by `density`.
    pub(super) fn at(&self, p: DVec3, density: impl FnOnce() -> f64) -> Rgb {
        let value = self.field.at(p);
        if !self.is_scattering {
            return value;
        }
        let density = density();
        // Both are interpolated, and rounded, on their own.
        if density > 0.0 { (value / density).min(Rgb::ONE) } else { Rgb::ZERO }
    }
}

impl From<Rgb> for Albedo {
    fn from(albedo: Rgb) -> Albedo {
        Albedo::Even(albedo)
    }
}

/// A medium's phase function, place by place.
#[derive(Clone, Debug)]
pub enum Phases {
    /// The same everywhere.
    Even(Phase),
    /// Henyey and Greenstein's with a mean cosine g that voxels tell.
    HenyeyGreenstein(Box<Asymmetry>),
    /// Those of several media, by how much each scatters at a place. They are Henyey and Greenstein's, or sums of such.
    Mixed(Arc<Parts>),
}

/// The mean cosine g of a phase function, told by voxels.
#[derive(Clone, Debug)]
pub struct Asymmetry {
    /// 1 + g: voxels are never negative.
    shifted: Grid,
    /// The greatest |g|.
    largest: f64,
}

/// Lobes are no narrower than of this |g|: 1 + g has 24 bits.
const NARROWEST: f64 = 1.0 - 1e-6;

impl Asymmetry {
    /// From a grid of 1 + g, and the greatest |g| in it.
    pub(crate) fn new(shifted: Grid, largest: f64) -> Asymmetry {
        Asymmetry { shifted, largest: largest.min(NARROWEST) }
    }

    /// The phase function at the point `p`.
    fn at(&self, p: DVec3) -> HenyeyGreenstein {
        HenyeyGreenstein { g: (self.shifted.at(p) - 1.0).clamp(-NARROWEST, NARROWEST) }
    }
}

impl Phases {
    /// That of all places, if it is the same everywhere.
    pub fn even(&self) -> Option<&Phase> {
        match self {
            Phases::Even(phase) => Some(phase),
            Phases::HenyeyGreenstein(_) | Phases::Mixed(_) => None,
        }
    }

    /// The greatest mean cosine that it has anywhere, forward or backward; of several media that of the narrowest lobe of one.
    pub fn greatest_cosine(&self) -> f64 {
        match self {
            Phases::Even(phase) => phase.mean_cosine().abs(),
            Phases::HenyeyGreenstein(asymmetry) => asymmetry.largest,
            Phases::Mixed(parts) => parts.greatest_cosine().min(NARROWEST),
        }
    }

    /// The value per steradian at the point `p`, by channel, for light that travelled along `before` and goes on along `after`, and the density
    /// per steradian with which [`Phases::sample`] draws that.
    #[inline]
    pub fn value(&self, p: DVec3, before: DVec3, after: DVec3) -> (Rgb, f64) {
        let value = match self {
            Phases::Even(phase) => phase.value(before, after),
            Phases::HenyeyGreenstein(asymmetry) => Phase::from(asymmetry.at(p)).value(before, after),
            Phases::Mixed(parts) => return parts.phase(p, before, after),
        };
        (Rgb::splat(value), value)
    }

    /// A new direction at the point `p` for light that travelled along `before`, and its density per steradian: see [`Phase::sample`]. What
    /// channels that are turned otherwise count there goes into `weight`: for one phase function that is 1.
    #[inline]
    pub fn sample(&self, p: DVec3, before: DVec3, weight: &mut Rgb, stream: &mut Stream) -> (DVec3, f64) {
        match self {
            Phases::Even(phase) => phase.sample(before, stream),
            Phases::HenyeyGreenstein(asymmetry) => Phase::from(asymmetry.at(p)).sample(before, stream),
            Phases::Mixed(parts) => parts.sample(p, before, weight, stream),
        }
    }

    /// The direction, and a factor of the power, with which a photon at the point `p` is kept.
    ///
    /// Where g varies these hold the phase function of the place: with v = g d, a photon that travels along d sends
    /// (1 − g²)/4π |v + ω|³ against the direction ω, as cos θ = −d·ω. So v is kept in place of d, and 1 − g² goes into the power. Of several
    /// media one is drawn by chance, and the power is that over the chance.
    #[inline]
    pub(crate) fn kept(&self, p: DVec3, direction: DVec3, stream: &mut Stream) -> (DVec3, Rgb) {
        match self {
            Phases::Even(_) => (direction, Rgb::ONE),
            Phases::HenyeyGreenstein(asymmetry) => {
                let (direction, factor) = scaled(direction, asymmetry.at(p).g);
                (direction, Rgb::splat(factor))
            }
            Phases::Mixed(parts) => parts.kept(p, direction, stream),
        }
    }

    /// What [`Phases::kept`] multiplied the power of a photon by for its g that is kept with this direction.
    pub(crate) fn factor(&self, direction: DVec3) -> f64 {
        match self {
            Phases::Even(_) => 1.0,
            Phases::HenyeyGreenstein(_) | Phases::Mixed(_) => 1.0 - direction.length_squared(),
        }
    }

    pub(super) fn grids(&self) -> Vec<&Grid> {
        match self {
            Phases::Even(_) => Vec::new(),
            Phases::HenyeyGreenstein(asymmetry) => vec![&asymmetry.shifted],
            Phases::Mixed(parts) => parts.media().iter().flat_map(|medium| medium.phase.grids()).collect(),
        }
    }

    pub(super) fn moved(&self, transform: DAffine3) -> Phases {
        match self {
            Phases::Even(_) => self.clone(),
            Phases::HenyeyGreenstein(asymmetry) => {
                let shifted = asymmetry.shifted.moved(transform);
                Phases::HenyeyGreenstein(Box::new(Asymmetry { shifted, ..**asymmetry }))
            }
            Phases::Mixed(parts) => Phases::Mixed(Arc::new(parts.moved(transform))),
        }
    }
}

/// What is kept of a direction in place of its g, and the factor of the power: see [`Phases::kept`].
pub(super) fn scaled(direction: DVec3, g: f64) -> (DVec3, f64) {
    let g = g.clamp(-NARROWEST, NARROWEST);
    (g * direction, (1.0 - g) * (1.0 + g))
}

impl From<Phase> for Phases {
    fn from(phase: Phase) -> Phases {
        Phases::Even(phase)
    }
}
