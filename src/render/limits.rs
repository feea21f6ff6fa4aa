//! How far a render goes.

use std::ops::RangeInclusive;
use std::time::Duration;

use super::exact;
use super::eye::Component;
use super::film::{Film, Layers};
use super::forced::Forced;
use super::numbers::{caustic_photons, global_photons, shadow_photons};
use super::splat::Splats;
use crate::medium;
use crate::scene::description::{Estimate, Kernel, Method, Volume};
use crate::scene::{Scene, Settings};
use crate::{Error, Result};

/// When a render ends, what it may take, and what it does beyond what it needs. By default: after the scene's own passes.
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// The passes to make, counted from 1: those of a longer render, radii included. `None`: the scene's own;
    /// where there is a limit of time or error, as many as it takes.
    pub passes: Option<RangeInclusive<u32>>,
    /// Wall-clock time after which no more is computed.
    pub time: Option<Duration>,
    /// The relative standard error ([`Film::error`]) that is good enough.
    pub target_error: Option<f64>,
    /// Bytes of memory that the render should stay below. Where photons do not fit, passes are split into parts.
    pub memory: Option<u64>,
    /// Whether the sums are to be written to a checkpoint.
    pub resumable: bool,
    /// The components that the image is the sum of; `None`: all.
    pub shown: Option<Vec<Component>>,
    /// What it does though its plan would leave it out. `memory` does not count photons that are forced.
    pub forced: Vec<Forced>,
}

/// Sub-passes for the standard error of a single pass.
const SUB_PASSES: u32 = 8;
/// The most bytes that a photon takes, be it as traced, in a map, or while that is built; measured in fog without walls.
const PHOTON_BYTES: u64 = 48;
/// What is added by radii that are looked for.
const RADIUS_BYTES: u64 = 8;
/// What is added by walls around all of them.
const WALL_BYTES: u64 = 48;
/// What is added where discs follow the density of a solid.
const DENSITY_BYTES: u64 = 16;
/// The most bytes that a photon on a surface takes: as traced and in its map, while that is built.
const SURFACE_PHOTON_BYTES: u64 = 96;
/// What the program takes without film, photons and densities.
const PROGRAM_BYTES: u64 = 32 << 20;
/// Parts of a pass with fewer photons than this are not worth their cost.
const FEWEST_PHOTONS: u64 = 10_000;
/// Photons that take more than this are refused unless passes may be split.
const MOST_PHOTON_BYTES: u64 = 64 << 30;
/// A film larger than this is refused.
const MOST_FILM_BYTES: u64 = 16 << 30;

impl Limits {
    /// The passes to make.
    pub fn passes(&self, settings: &Settings) -> RangeInclusive<u32> {
        match &self.passes {
            Some(passes) => passes.clone(),
            None if self.time.is_some() || self.target_error.is_some() => 1..=exact::MOST,
            None => 1..=settings.render.passes,
        }
    }

    /// The passes to make as a film counts them, where each is made in so many parts.
    pub fn counted(&self, settings: &Settings, parts: u32) -> RangeInclusive<u32> {
        let passes = self.passes(settings);
        let first = passes.start().saturating_sub(1).saturating_mul(parts).saturating_add(1);
        first..=passes.end().saturating_mul(parts).min(exact::MOST)
    }

    /// Whether there is only one pass, and nothing it could be continued by but its repetition.
    fn single(&self, settings: &Settings) -> bool {
        self.passes.is_none() && self.passes(settings) == (1..=1)
    }

    /// What the film keeps, and whether of several passes, `parts` of which make one.
    fn film_of(&self, settings: &Settings, parts: u32) -> (Layers, bool) {
        let forced = |of| self.forced.contains(&of);
        let several = parts > 1 || self.resumable || self.passes(settings) != (1..=1) || forced(Forced::PassSums);
        (Layers { components: settings.film.layers || forced(Forced::FilmLayers) }, several)
    }

    /// The film that the render needs, black.
    ///
    /// # Errors
    /// [`Error::Limit`] for more memory than any film should take.
    pub fn film(&self, settings: &Settings, parts: u32) -> Result<Film> {
        let (width, height) = settings.film.size();
        let (layers, several) = self.film_of(settings, parts);
        let bytes = film_bytes(settings, layers, several);
        if bytes > MOST_FILM_BYTES {
            return Err(Error::Limit(format!(
                "a film of {width} × {height} pixels takes {} of memory, more than {}: render it in parts, or without film.layers",
                size(bytes),
                size(MOST_FILM_BYTES)
            )));
        }
        Ok(if several { Film::of_passes(width, height, layers) } else { Film::new(width, height, layers) })
    }

    /// Whether the film sums several passes, where each is made in so many parts.
    pub(super) fn sums_passes(&self, settings: &Settings, parts: u32) -> bool {
        self.film_of(settings, parts).1
    }

    /// Bytes that the film takes at most, where passes are made in so many parts.
    pub fn film_bytes(&self, settings: &Settings, parts: u32) -> u64 {
        let (layers, several) = self.film_of(settings, parts);
        film_bytes(settings, layers, several)
    }

    /// Bytes that the film takes without the picture that is made of it in the end.
    pub(super) fn sums_bytes(&self, settings: &Settings, parts: u32) -> u64 {
        let (width, height) = settings.film.size();
        let (layers, _) = self.film_of(settings, parts);
        self.film_bytes(settings, parts) - Film::picture_bytes(width, height, layers)
    }

    /// The parts that each pass is split into where memory does not matter: several for the standard error of a single pass.
    pub(super) fn parts_for_error(&self, settings: &Settings) -> u32 {
        if settings.film.standard_error && self.single(settings) { SUB_PASSES } else { 1 }
    }

    /// The parts that each pass is split into, alike but for their share of `photons` and samples: several for
    /// the standard error of a single pass, or where memory does not hold all photons at once.
    ///
    /// # Errors
    /// [`Error::Limit`] where not even a small part would fit.
    pub fn parts(&self, scene: &Scene, settings: &Settings, photons: u64) -> Result<u32> {
        let parts = self.parts_for_error(settings);
        let each = photon_bytes(scene, &settings.volume);
        let Some(memory) = self.memory else {
            let bytes = photons.saturating_mul(each);
            if bytes > MOST_PHOTON_BYTES {
                return Err(Error::Limit(format!(
                    "{photons} photons take {} of memory, more than {}: ask for fewer, or say by --memory how much there is, so that passes are made in parts",
                    size(bytes),
                    size(MOST_PHOTON_BYTES)
                )));
            }
            return Ok(parts);
        };
        let (layers, several) = self.film_of(settings, parts);
        let film = |several| film_bytes(settings, layers, several);
        let surfaces =
            caustic_photons(scene, settings) + global_photons(scene, settings) + shadow_photons(scene, settings);
        let surfaces = surfaces * SURFACE_PHOTON_BYTES;
        let fixed = PROGRAM_BYTES + surfaces + medium::bytes(&scene.media);
        let bytes = |parts: u64| {
            (fixed + film(several || parts > 1)).saturating_add(photons.div_ceil(parts).saturating_mul(each))
        };
        if bytes(parts as u64) <= memory {
            return Ok(parts);
        }
        let rest = memory.saturating_sub(fixed + film(true));
        let needed = photons.saturating_mul(each).div_ceil(rest.max(1));
        let most = (photons / FEWEST_PHOTONS).max(1);
        if needed > most {
            return Err(Error::Limit(format!(
                "{} of memory are not enough: the image takes {}, the least part of {photons} photons {}, densities, surfaces and program {}; allow {}, or make a smaller image, or one without film.layers",
                size(memory),
                size(film(true)),
                size(photons.min(FEWEST_PHOTONS) * each),
                size(fixed),
                size(bytes(most)),
            )));
        }
        Ok(parts.max(u32::try_from(needed).unwrap_or(u32::MAX)))
    }
}

/// Bytes that the film takes at most.
fn film_bytes(settings: &Settings, layers: Layers, several: bool) -> u64 {
    let (width, height) = settings.film.size();
    let splats = if settings.render.method == Method::Light { Splats::bytes(layers.components) } else { 0 };
    Film::bytes(width, height, layers, several) + width as u64 * height as u64 * splats as u64
}

/// The most bytes that a volume photon of a scene takes.
fn photon_bytes(scene: &Scene, volume: &Volume) -> u64 {
    let beams = volume.estimate == Estimate::Beam;
    let radius = if beams && volume.kernel == Kernel::Variable { RADIUS_BYTES } else { 0 };
    let walls = if beams && !scene.surfaces.is_empty() { WALL_BYTES } else { 0 };
    let uneven = |medium: Option<u32>| medium.is_some_and(|index| scene.media[index as usize].density.has_voxels());
    let follows = beams && scene.solids.iter().any(|solid| uneven(solid.medium));
    PHOTON_BYTES + radius + walls + if follows { DENSITY_BYTES } else { 0 }
}

/// A number of bytes in words.
fn size(bytes: u64) -> String {
    let mib = bytes as f64 / (1u64 << 20) as f64;
    if mib < 1024.0 { format!("{mib:.1} MiB") } else { format!("{:.1} GiB", mib / 1024.0) }
}
