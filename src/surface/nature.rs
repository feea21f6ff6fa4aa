use crate::math::{DVec3, Rgb};

/// How a surface or a medium spreads light over directions: decides what is asked for, stored and split there, so that
/// no one need ask for a material by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Nature {
    /// Over so many that light can be asked for there, and photons be stored to be looked up.
    Diffuse,
    /// Over few, where light can be asked for.
    Glossy,
    /// Over so few that what lights bring by them is a caustic to where it lands; so it is of rough glass, through both sides of which no light
    /// can be asked for at once. Light can be asked for.
    Narrow,
    /// Over single ones, with no density: light can only be met by chance.
    Specular,
}

impl Nature {
    /// Of facets that reflect, of which GGX's α is this (of others the α as wide as their lobe). From α = 0.3 on light straight on is sent
    /// nowhere with more than three times the density of a diffuse surface: there photons tell it as well. Below α = 0.15 gather rays that find
    /// a lamp in it do so rarely: beside a golden ball, photons reach half their squared error or less, but at three to four times the time.
    pub(super) fn of_facets(alpha: f64) -> Nature {
        const WIDE: f64 = 0.3;
        const NARROW: f64 = 0.15;
        match alpha {
            WIDE.. => Nature::Diffuse,
            NARROW.. => Nature::Glossy,
            _ if alpha > 0.0 => Nature::Narrow,
            _ => Nature::Specular,
        }
    }
}

/// What a vertex sends from one direction to another.
#[derive(Clone, Copy, Debug)]
pub struct Scattering {
    /// The share of what arrives that leaves per steradian, by channel: f |cos θ| of a surface, with Veach's correction for
    /// shading normals and the change of radiance by refraction; albedo times phase function in a medium.
    pub value: Rgb,
    /// The density per steradian with which the outgoing direction is drawn by chance, for sharing with whoever else
    /// might find it: by channel, since where channels are bent differently each goes its own way. A function of the two
    /// directions and the vertex alone, whatever weight a path brings.
    pub ahead: Rgb,
}

/// A direction that a reflecting surface has drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// The unit direction of travel.
    pub direction: DVec3,
    /// The normal it was drawn about.
    pub normal: DVec3,
    /// Value over density: what a weight is multiplied by.
    pub factor: Rgb,
    /// The density per steradian; 0 for a specular reflection, which has none.
    pub density: f64,
}

/// Where light goes on from a vertex.
#[derive(Clone, Copy, Debug)]
pub struct Onward {
    /// The unit direction of travel.
    pub direction: DVec3,
    /// Its density per steradian, as [`Scattering::ahead`] gives it for the channels that go there; 0 where light from there
    /// cannot be asked for.
    pub density: f64,
}

/// The two ways that light takes at a boundary between two indices of refraction.
#[derive(Clone, Copy, Debug)]
pub struct Boundary {
    /// The index on the side of arrival, by channel.
    pub from: Rgb,
    /// The part of each channel that is reflected, where the boundary is smooth; unknown before a facet is drawn on
    /// rough ones.
    pub reflected: Option<Rgb>,
}

/// What comes straight on through a boundary, if it does not bend it.
#[derive(Clone, Copy, Debug)]
pub struct Straight {
    /// The part of each channel that passes.
    pub passed: Rgb,
    /// By how much longer, in each channel, the refracted way through the medium before the boundary is than the straight
    /// one.
    pub longer: Rgb,
}
