//! What a render may be made to do though its plan leaves it out: for the time and memory that leaving it out saves.

use std::fmt;

use super::eternity::why_no_pilot;
use super::importons;
use super::limits::Limits;
use super::numbers::{chosen, on_surfaces};
use super::pilot::Pilot;
use super::plan::Plan;
use crate::gather::GlobalSettings;
use crate::scene::Settings;

/// A pass or a structure that a plan leaves out where a scene does not need it, and that can be had nevertheless. The picture's expectation
/// stays the same: nothing reads it, or what it tells means the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Forced {
    /// Walks that tell whether light comes to an end; nobody asks what they found.
    EternityPilot,
    /// Paths from the camera that tell where photons count. Photons are drawn and kept by them, where there are any.
    Importons,
    /// Photons in media and their map, which is not read.
    VolumePhotons,
    /// Photons of caustics and their map, which is not read.
    CausticPhotons,
    /// Photons on surfaces and their map, which is not read.
    GlobalPhotons,
    /// Shadow photons and their cells, which are not read.
    ShadowPhotons,
    /// Irradiances at photons of a global map that is made for them, and not read.
    Irradiances,
    /// From where light comes to surfaces, of a global map that is made for it, and not read.
    FluxMap,
    /// A second map of a part of the volume photons, for rays that surfaces spread.
    SparseVolumeMap,
    /// Paths go on both past and from each collision.
    PathSplitting,
    /// A film with a sum for each kind of light, and photons that remember their events for it.
    FilmLayers,
    /// Exact sums, as of several passes.
    PassSums,
}

impl Forced {
    /// All that can be forced.
    pub const ALL: [Forced; 12] = [
        Forced::EternityPilot,
        Forced::Importons,
        Forced::VolumePhotons,
        Forced::CausticPhotons,
        Forced::GlobalPhotons,
        Forced::ShadowPhotons,
        Forced::Irradiances,
        Forced::FluxMap,
        Forced::SparseVolumeMap,
        Forced::PathSplitting,
        Forced::FilmLayers,
        Forced::PassSums,
    ];

    /// The name of its item in a [`Forecast`](super::Forecast).
    pub fn name(self) -> &'static str {
        match self {
            Forced::EternityPilot => "eternity_pilot",
            Forced::Importons => "importons",
            Forced::VolumePhotons => "volume_photons",
            Forced::CausticPhotons => "caustic_photons",
            Forced::GlobalPhotons => "global_photons",
            Forced::ShadowPhotons => "shadow_photons",
            Forced::Irradiances => "irradiances",
            Forced::FluxMap => "flux_map",
            Forced::SparseVolumeMap => "sparse_volume_map",
            Forced::PathSplitting => "path_splitting",
            Forced::FilmLayers => "film_layers",
            Forced::PassSums => "pass_sums",
        }
    }

    /// That of an item, if it can be forced.
    pub fn of_name(name: &str) -> Option<Forced> {
        Forced::ALL.into_iter().find(|forced| forced.name() == name)
    }
}

impl fmt::Display for Forced {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl Plan {
    /// Whether this is there for no reason but that it is forced.
    pub(super) fn only_forces(&self, forced: Forced) -> bool {
        self.forced.contains(&forced)
    }

    /// Adds what is to be forced, where it was left out.
    pub(super) fn force(&mut self, pilot: &Pilot<'_>, settings: &Settings, limits: &Limits) {
        let is_left_out = |forced: &Forced| match forced {
            Forced::EternityPilot => why_no_pilot(self.method, self.max_events).is_some(),
            Forced::Importons => self.importons.is_none(),
            Forced::VolumePhotons => self.volume_photons == 0,
            Forced::CausticPhotons => self.caustic_photons == 0,
            Forced::GlobalPhotons => self.global_photons == 0,
            Forced::ShadowPhotons => self.shadow_photons == 0,
            Forced::Irradiances => self.global_photons == 0 || self.global.precomputed == 0,
            Forced::FluxMap => self.global_photons == 0 || !self.global.flux,
            Forced::SparseVolumeMap => !self.spreads,
            Forced::PathSplitting => !self.split,
            Forced::FilmLayers => !settings.film.layers,
            Forced::PassSums => !Limits { forced: Vec::new(), ..limits.clone() }.sums_passes(settings, self.parts),
        };
        // Each once, and in one order, however they were asked for.
        let all = Forced::ALL.into_iter().filter(|forced| limits.forced.contains(forced));
        let forced: Vec<Forced> = all.filter(is_left_out).collect();

        let each = |photons: u64| photons.div_ceil(u64::from(self.parts));
        let wanted = |said: Option<u64>| each(said.filter(|photons| *photons > 0).unwrap_or(on_surfaces(settings)));
        let [mut volume, mut caustic, mut global, mut shadow] = [0; 4];
        for forced in &forced {
            match forced {
                Forced::EternityPilot => {
                    let _unasked = pilot.refuse_eternity();
                }
                Forced::Importons => {
                    self.importons = Some(importons::trace(pilot, settings.surface.indirect).into());
                }
                Forced::VolumePhotons => {
                    volume = each(settings.photons.volume.unwrap_or_else(|| chosen(pilot.scene, settings)));
                }
                Forced::CausticPhotons => caustic = wanted(settings.photons.caustic),
                Forced::GlobalPhotons | Forced::Irradiances | Forced::FluxMap => {
                    global = wanted(settings.photons.global);
                }
                Forced::ShadowPhotons => shadow = each(on_surfaces(settings)),
                Forced::SparseVolumeMap => self.spreads = true,
                Forced::PathSplitting => self.split = true,
                Forced::FilmLayers => self.tagged = true,
                // By the film, which the limits make.
                Forced::PassSums => {}
            }
        }
        if volume + caustic + global + shadow > 0 {
            let with = |of| forced.contains(&of);
            let precomputed =
                if with(Forced::Irradiances) { settings.surface.precomputed_irradiance.max(1) } else { 0 };
            self.unread = Some(Box::new(Plan {
                volume_photons: volume,
                caustic_photons: caustic,
                global_photons: global,
                global: GlobalSettings { precomputed, flux: with(Forced::FluxMap), ..self.global },
                shadow_photons: shadow,
                seen: if shadow > 0 { pilot.seen() } else { None },
                ..self.clone()
            }));
        }
        self.forced = forced;
    }
}
