//! How a picture is computed, apart from what is there.

use super::description::{Description, Film, Photons, Render, Surface, Volume};

/// The user's wishes as a scene file states them: what the film holds, and how it is computed. None of it changes what is
/// there, which is the [`Scene`](super::Scene).
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// `[film]`: the image to make.
    pub film: Film,
    /// `[render]`: the method, and how much work it does.
    pub render: Render,
    /// `[photons]`: how many photons are traced and kept.
    pub photons: Photons,
    /// `[volume]`: how the light in media is gathered.
    pub volume: Volume,
    /// `[surface]`: how light on surfaces is gathered.
    pub surface: Surface,
}

impl Settings {
    /// The settings that a scene file states or leaves at their defaults.
    pub fn of(description: &Description) -> Self {
        Settings {
            film: description.film.clone(),
            render: description.render.clone(),
            photons: description.photons.clone(),
            volume: description.volume.clone(),
            surface: description.surface.clone(),
        }
    }
}
