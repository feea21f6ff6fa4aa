//! What a user should know of a render.

use super::camera::Camera;
use super::eye::BRIGHTEST;
use super::maps::{Summary, medium_of, tells_fluence};
use super::plan::Plan;
use crate::photon::Traced;
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

/// Whether photons are spread so wide that the picture is wrong: of each medium, where they are widest. `extinctions` are by region.
pub(super) fn wide_discs(scene: &Scene, maps: &[(u32, Summary)], extinctions: &[f64], beams: bool) -> Vec<String> {
    let mut warnings: Vec<(&str, f64, String)> = Vec::new();
    for (region, map) in maps {
        let Some(medium) = medium_of(scene, *region) else { continue };
        let share = map.radii.mean as f64 * extinctions[*region as usize];
        let (most, wrong) = match beams && *region != scene.world_region {
            true => (WIDE_LEANING, "blurred, and wrong near edges"),
            false if tells_fluence(scene, *region) => (WIDE_ALONG_FLIGHTS, "blurred"),
            false => (WIDE, "blurred and too dark"),
        };
        let (name, mean) = (medium.name.as_str(), map.radii.mean);
        let place = warnings.iter().position(|(of, ..)| *of == name).unwrap_or(warnings.len());
        if share > most && warnings.get(place).is_none_or(|(_, widest, _)| share > *widest) {
            let text = format!(
                "medium {name}: photons are spread over {mean:.3e} on average, which is {share:.2} mean free paths; above {most} its lit surface is {wrong}: raise photons.volume, lower volume.neighbours or volume.radius, or use method \"path\""
            );
            match warnings.get_mut(place) {
                Some(warning) => *warning = (name, share, text),
                None => warnings.push((name, share, text)),
            }
        }
    }
    warnings.into_iter().map(|(_, _, text)| text).collect()
}

/// Where about this share of a medium's light is lost as discs that lean are wider than its solids, it is worth a warning.
const LOST: f64 = 0.03;

/// Media in solids so small that discs, which lean on their surface, reach beyond them, and how much of the light is lost so: by q²/(4 + q²)
/// where discs are q times as wide as solids, as was found in balls of 20 mean free paths (21 % at q = 1.2, 52 % at 2.1).
pub(super) fn small_solids(scene: &Scene, maps: &[(u32, Summary)]) -> Option<String> {
    if !maps.iter().any(|(_, map)| map.leans) {
        return None;
    }
    let mut sizes = vec![0.0f64; scene.regions as usize];
    for solid in &scene.solids {
        let size = &mut sizes[solid.region as usize];
        *size = size.max(0.5 * scene.geometry.bounds(solid.shape).size().min_element());
    }
    let leaning = || maps.iter().filter(|(region, map)| map.leans && *region != scene.world_region);
    let lost = |(region, map): &(u32, Summary)| {
        let squared = (f64::from(map.radii.mean) / sizes[*region as usize]).powi(2);
        map.photons as f64 * squared / (4.0 + squared)
    };
    let photons: usize = leaning().map(|(_, map)| map.photons).sum();
    let share = leaning().map(lost).sum::<f64>() / photons.max(1) as f64;
    let (region, widest) = leaning().max_by(|a, b| lost(a).total_cmp(&lost(b)))?;
    (share > LOST).then(|| {
        format!(
            "medium {}: photons are spread over {:.3e} on average in dense solids whose half width is {:.3e}: about {:.0} % of what they scatter is lost; raise photons.volume, lower volume.neighbours or volume.radius, or use method \"path\"",
            medium_of(scene, *region).map_or("", |medium| &medium.name),
            widest.radii.mean,
            sizes[*region as usize],
            100.0 * share
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
