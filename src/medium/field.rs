//! What varies over a medium besides its density: numbers and colours that grids tell, of the density's own file.

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
            Albedo::Varying(_) => None,
        }
    }

    /// The least and the most that it may be, by channel.
    pub fn range(&self) -> (Rgb, Rgb) {
        match self {
            Albedo::Even(albedo) => (*albedo, *albedo),
            Albedo::Varying(varying) => (varying.least, varying.most),
        }
    }

    pub(super) fn grids(&self) -> Vec<&Grid> {
        match self {
            Albedo::Even(_) => Vec::new(),
            Albedo::Varying(varying) => varying.field.grids(),
        }
    }

    pub(super) fn moved(&self, transform: DAffine3) -> Albedo {
        match self {
            Albedo::Even(_) => self.clone(),
            Albedo::Varying(varying) => {
                let field = varying.field.moved(transform);
                Albedo::Varying(Box::new(VaryingAlbedo { field, ..**varying }))
            }
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

    /// The greatest |g| anywhere.
    pub fn largest(&self) -> f64 {
        self.largest
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
            Phases::HenyeyGreenstein(_) => None,
        }
    }

    /// The greatest mean cosine that it has anywhere, forward or backward.
    pub fn greatest_cosine(&self) -> f64 {
        match self {
            Phases::Even(phase) => phase.mean_cosine().abs(),
            Phases::HenyeyGreenstein(asymmetry) => asymmetry.largest,
        }
    }

    /// The value per steradian at the point `p` for light that travelled along `before` and goes on along `after`.
    pub fn value(&self, p: DVec3, before: DVec3, after: DVec3) -> f64 {
        match self {
            Phases::Even(phase) => phase.value(before, after),
            Phases::HenyeyGreenstein(asymmetry) => Phase::from(asymmetry.at(p)).value(before, after),
        }
    }

    /// A new direction at the point `p` for light that travelled along `before`, and its density per steradian: see [`Phase::sample`].
    pub fn sample(&self, p: DVec3, before: DVec3, stream: &mut Stream) -> (DVec3, f64) {
        match self {
            Phases::Even(phase) => phase.sample(before, stream),
            Phases::HenyeyGreenstein(asymmetry) => Phase::from(asymmetry.at(p)).sample(before, stream),
        }
    }

    /// The direction, and a factor of the power, with which a photon at the point `p` is kept.
    ///
    /// Where g varies these hold the phase function of the place: with v = g d, a photon that travels along d sends
    /// (1 − g²)/4π |v + ω|³ against the direction ω, as cos θ = −d·ω. So v is kept in place of d, and 1 − g² goes into the power.
    pub(crate) fn kept(&self, p: DVec3, direction: DVec3) -> (DVec3, f64) {
        match self {
            Phases::Even(_) => (direction, 1.0),
            Phases::HenyeyGreenstein(asymmetry) => {
                let g = asymmetry.at(p).g;
                (g * direction, (1.0 - g) * (1.0 + g))
            }
        }
    }

    /// What [`Phases::kept`] multiplied the power of a photon by that is kept with this direction.
    pub(crate) fn factor(&self, direction: DVec3) -> f64 {
        match self {
            Phases::Even(_) => 1.0,
            Phases::HenyeyGreenstein(_) => 1.0 - direction.length_squared(),
        }
    }

    pub(super) fn grid(&self) -> Option<&Grid> {
        match self {
            Phases::Even(_) => None,
            Phases::HenyeyGreenstein(asymmetry) => Some(&asymmetry.shifted),
        }
    }

    pub(super) fn moved(&self, transform: DAffine3) -> Phases {
        match self {
            Phases::Even(_) => self.clone(),
            Phases::HenyeyGreenstein(asymmetry) => {
                let shifted = asymmetry.shifted.moved(transform);
                Phases::HenyeyGreenstein(Box::new(Asymmetry { shifted, ..**asymmetry }))
            }
        }
    }
}

impl From<Phase> for Phases {
    fn from(phase: Phase) -> Phases {
        Phases::Even(phase)
    }
}
