//! What a user should know of a render.

use super::camera::Camera;
use super::eye::BRIGHTEST;
use super::maps::{medium_of, tells_fluence};
use super::plan::Plan;
use crate::photon::{Radii, Traced};
use crate::scene::Scene;
use crate::scene::description::Method;
use crate::transport::{SAFETY_STOP, Tally};

/// Whether the map is too thin to be trusted.
pub(super) fn sparse_map(plan: &Plan, traced: &Traced) -> Option<String> {
    let (stored, emitted, wanted) = (traced.stored(), traced.emitted, plan.volume_photons);
    if emitted == 0 {
        // Without a source there is nothing to say about photons.
        None
    } else if stored == 0 {
        Some(format!("none of {emitted} photons met a medium that scatters: media stay dark"))
    } else if stored < wanted / 2 && !traced.enough {
        Some(format!(
            "the volume map holds {stored} of {wanted} photons after {emitted} emissions: raise photons.max_emitted, or aim the lights at the media"
        ))
    } else if emitted < 1000 && emitted < plan.max_emitted {
        Some(format!(
            "the volume map stems from only {emitted} emissions, as light is long on its way: make more passes"
        ))
    } else if emitted < 1000 {
        Some(format!("the volume map stems from only {emitted} emissions: raise photons.max_emitted"))
    } else {
        None
    }
}

/// Whether light paths are connected to a point within a medium: what a collision at distance d sends there grows with 1/d²,
/// and its square is not integrable.
pub(super) fn pinhole_in_medium(scene: &Scene, camera: &Camera) -> Option<String> {
    let medium = &scene.media[scene.medium(&scene.inside(camera.position))? as usize];
    (camera.is_pinhole() && medium.scatters()).then(|| {
        format!(
            "the camera is a pinhole in medium {}: by method \"light\" its picture has infinite variance, however many paths are traced; give it an aperture, put it outside, or use method \"path\"",
            medium.name
        )
    })
}

/// Whether a glowing medium has no end: photons and light paths of a glow start in a box around it.
pub(super) fn endless_glow(scene: &Scene, method: Method) -> Option<String> {
    let medium = &scene.media[scene.world? as usize];
    let endless = medium.glows() && medium.scatters() && !medium.density.support().size().is_finite();
    endless.then(|| {
        format!(
            "medium {} glows and has no end: of its light, method \"{}\" leaves out what is scattered; put it into a shape, or use method \"path\"",
            medium.name,
            method.name()
        )
    })
}

/// Where discs are wider than this many mean free paths, light is blurred across the layer it enters by.
const WIDE: f64 = 0.3;

/// Discs that lean on boundaries blend no depths, but near edges and along the surface they do blur.
const WIDE_LEANING: f64 = 100.0;

/// Photons along flights lie in the thin air around matter, too, where discs are wide.
const WIDE_ALONG_FLIGHTS: f64 = 1.0;

/// Whether a region's photons are spread so wide that its picture is wrong.
pub(super) fn wide_discs(scene: &Scene, region: u32, radii: Radii, extinction: f64, leans: bool) -> Option<String> {
    let share = radii.mean as f64 * extinction;
    let (most, wrong) = match leans {
        true => (WIDE_LEANING, "blurred, and wrong near edges"),
        false if tells_fluence(scene, region) => (WIDE_ALONG_FLIGHTS, "blurred"),
        false => (WIDE, "blurred and too dark"),
    };
    medium_of(scene, region).filter(|_| share > most).map(|medium| {
        format!(
            "medium {}: photons are spread over {:.3e} on average, which is {share:.2} mean free paths; above {most} its lit surface is {wrong}: raise photons.volume, lower volume.neighbours or volume.radius, or use method \"path\"",
            medium.name, radii.mean
        )
    })
}

/// The warnings of mishaps that were counted.
pub(super) fn of_tally(tally: &Tally) -> Vec<String> {
    let Tally { violations, stopped, broken } = *tally;
    let mut warnings = Vec::new();
    if violations > 0 {
        warnings.push(format!("{violations} look-ups exceeded their majorant"));
    }
    if stopped > 0 {
        warnings.push(format!("{stopped} walks were cut off after {SAFETY_STOP} events"));
    }
    if broken > 0 {
        warnings.push(format!("{broken} samples or photons were dropped because a number was not finite or above {BRIGHTEST:e}: the light is too strong for images of 32-bit numbers"));
    }
    warnings
}
