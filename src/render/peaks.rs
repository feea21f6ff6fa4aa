//! Which media leave the peaks of their phase functions to paths.

use super::plan::bounds_of_medium;
use crate::light::Light;
use crate::medium::Medium;
use crate::medium::phase::Peak;
use crate::scene::Scene;
use crate::scene::description::{Peaks, Volume};
use crate::surface::Material;

/// The broad part of a phase function is at most so many times an isotropic one.
const CEILING: f64 = 4.0;

/// Phase functions with less than so many times the second moment of an isotropic one have no peak: Henyey–Greenstein's up to
/// g = 0.62.
const MILD: f64 = 4.0;

/// In media of fewer mean free paths than this across light that was scattered several times is no large part of the picture.
const THIN: f64 = 10.0;

/// Phase functions with more than so many times the second moment of an isotropic one have a sharp peak: Henyey–Greenstein's from g = 0.83 on, and those of
/// droplets.
const SHARP: f64 = 16.0;

/// By medium, the peak that photons leave to paths. Unless the scene says otherwise these are those of clouds and smoke, which are thick media of voxels, and sharp ones of
/// other media, where lamps light all around: in rooms of fog of g = 0.9, 0.97 and of droplets, lit by an area and 1 or 10 mean free paths wide, the product of error and
/// time is 0.04 to 0.22 of what it is with photons alone, with a point lamp 0.57. Where a spot shines through fog, or glass sends light on, it is 1.7 to 10 times: paths ask for
/// light at places that it does not reach. Milk in a glass gains nothing.
pub(super) fn of_media(scene: &Scene, volume: &Volume) -> Vec<Option<Peak>> {
    let lit_all_around = !scene.lights.iter().any(Light::is_beam) && !scene.any_material(&Material::is_narrow);
    // The least second moment of a peak.
    let least = |index: u32| match volume.peaks {
        Peaks::Photons => None,
        Peaks::Paths => Some(MILD),
        Peaks::Auto if scene.uneven(index).is_some() && thickness(scene, index) >= THIN => Some(MILD),
        Peaks::Auto => lit_all_around.then_some(SHARP),
    };
    let of = |(index, medium): (u32, &Medium)| {
        let least = least(index)?;
        // What g is elsewhere, a photon's own peak does not tell.
        let phase = medium.phase.even().filter(|_| medium.scatters())?;
        let peak = Peak::new(phase, CEILING);
        (peak.second_moment() > least).then_some(peak)
    };
    (0..).zip(&scene.media).map(of).collect()
}

/// Why no medium leaves a peak to paths, where none does.
pub(super) fn why_none(volume: &Volume) -> &'static str {
    match volume.peaks {
        Peaks::Photons => "volume.peaks is \"photons\"",
        Peaks::Paths => "no phase function has a narrow peak",
        Peaks::Auto => {
            "no thick medium of voxels has a narrow phase function, nor another a sharp one without spots and glass"
        }
    }
}

/// Mean free paths across a medium where it is densest.
fn thickness(scene: &Scene, index: u32) -> f64 {
    let (medium, bounds) = (&scene.media[index as usize], bounds_of_medium(scene, index));
    medium.max_extinction() * bounds.diagonal()
}
