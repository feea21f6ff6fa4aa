//! What a camera sample finds, by the kind of light.

use crate::math::{DVec3, Rgb};

/// The components of light transport, by the first event on the eye's side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Component {
    /// Emitters and the environment, seen directly.
    Emission,
    /// Light that reflects once, diffusely.
    Direct,
    /// What else a diffuse surface reflects.
    Indirect,
    /// What a mirror or a refracting boundary shows.
    Specular,
    /// Light that a diffuse surface reflects after specular events, and no other.
    Caustic,
    /// What media emit, seen directly.
    VolumeEmission,
    /// Light that scatters once, in a medium.
    VolumeSingle,
    /// What else a medium scatters.
    VolumeMultiple,
}

impl Component {
    /// All of them, in order.
    pub const ALL: [Component; 8] = [
        Component::Emission,
        Component::Direct,
        Component::Indirect,
        Component::Specular,
        Component::Caustic,
        Component::VolumeEmission,
        Component::VolumeSingle,
        Component::VolumeMultiple,
    ];

    /// The name of its layer in files.
    pub fn name(self) -> &'static str {
        match self {
            Component::Emission => "emission",
            Component::Direct => "direct",
            Component::Indirect => "indirect",
            Component::Specular => "specular",
            Component::Caustic => "caustic",
            Component::VolumeEmission => "volume_emission",
            Component::VolumeSingle => "volume_single",
            Component::VolumeMultiple => "volume_multiple",
        }
    }

    /// The component of light that a path finds which had so many events, the `first` of that kind: `straight` from a light, or
    /// from a glowing medium; and whether, between that light and the first event, all were `specular`.
    pub(in crate::render) fn of(first: Option<First>, events: u64, straight: bool, specular: bool) -> Component {
        match (first, events) {
            (None, _) if straight => Component::Emission,
            (None, _) => Component::VolumeEmission,
            (Some(First::Specular), _) => Component::Specular,
            (Some(First::Diffuse), 1) if straight => Component::Direct,
            (Some(First::Diffuse), _) if straight && specular => Component::Caustic,
            (Some(First::Diffuse), _) => Component::Indirect,
            (Some(First::Medium), 1) => Component::VolumeSingle,
            (Some(First::Medium), _) => Component::VolumeMultiple,
        }
    }
}

/// The kind of a path's first event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::render) enum First {
    /// At a surface that reflects diffusely.
    Diffuse,
    /// At a mirror or a refracting boundary.
    Specular,
    /// In a medium.
    Medium,
}

/// What one camera sample saw.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Radiance by [`Component`].
    pub radiance: [Rgb; Component::ALL.len()],
    /// Albedo of the first surface.
    pub albedo: Rgb,
    /// Normal of the first surface, facing the eye.
    pub normal: DVec3,
    /// Distance of the first surface; infinite if there is none.
    pub depth: f64,
    /// Whether its path was broken off, so that it does not count.
    pub is_broken_off: bool,
}

impl Default for Sample {
    fn default() -> Self {
        Sample {
            radiance: Default::default(),
            albedo: Rgb::ZERO,
            normal: DVec3::ZERO,
            depth: f64::INFINITY,
            is_broken_off: false,
        }
    }
}
