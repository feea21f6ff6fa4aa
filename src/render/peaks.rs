//! Which media leave the peaks of their phase functions to paths.

use super::plan::bounds_of_medium;
use crate::medium::Medium;
use crate::medium::phase::Peak;
use crate::scene::Scene;
use crate::scene::description::{Peaks, Volume};

/// The broad part of a phase function is at most so many times an isotropic one.
const CEILING: f64 = 4.0;

/// Phase functions with less than so many times the second moment of an isotropic one have no peak: Henyey–Greenstein's up to
/// g = 0.62.
const MILD: f64 = 4.0;

/// In media of fewer mean free paths than this across light that was scattered several times is no large part of the picture.
const THIN: f64 = 10.0;

/// By medium, the peak that photons leave to paths. Unless the scene says otherwise these are clouds and smoke: thick media of voxels.
/// A fog of g = 0.9 in a room had as much squared error for its time either way; where a narrow spot shines through such a fog,
/// light that paths ask for was twice as noisy as photons, and milk in a glass gained nothing.
pub(super) fn of_media(scene: &Scene, volume: &Volume) -> Vec<Option<Peak>> {
    let is_left = |index: u32| match volume.peaks {
        Peaks::Photons => false,
        Peaks::Paths => true,
        Peaks::Auto => scene.uneven(index).is_some() && thickness(scene, index) >= THIN,
    };
    let of = |(index, medium): (u32, &Medium)| {
        // What g is elsewhere, a photon's own peak does not tell.
        let phase = medium.phase.even().filter(|_| medium.scatters() && is_left(index));
        let peak = phase.map(|phase| Peak::new(phase, CEILING));
        peak.filter(|peak| peak.second_moment() > MILD)
    };
    (0..).zip(&scene.media).map(of).collect()
}

/// Why no medium leaves a peak to paths, where none does.
pub(super) fn why_none(volume: &Volume) -> &'static str {
    match volume.peaks {
        Peaks::Photons => "volume.peaks is \"photons\"",
        Peaks::Paths => "no phase function has a narrow peak",
        Peaks::Auto => "no thick medium of voxels has a narrow phase function",
    }
}

/// Mean free paths across a medium where it is densest.
fn thickness(scene: &Scene, index: u32) -> f64 {
    let (medium, bounds) = (&scene.media[index as usize], bounds_of_medium(scene, index));
    medium.max_extinction() * bounds.diagonal()
}
