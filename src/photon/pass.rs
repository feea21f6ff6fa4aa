//! The photon pass: pilots tell how photons are to be emitted, and how many; then all are traced.

use rayon::prelude::*;

use super::Photon;
use super::budget::{self, Budget};
use super::control::{Filled, RICHER, hand_over};
use super::pilot;
use super::tracer::{CHUNK, Pass, Tracer};
use crate::Result;
use crate::math::random::Purpose;
use crate::scene::Scene;
use crate::transport::Tally;

/// What a photon pass found.
#[derive(Debug, Default)]
pub struct Traced {
    /// The photons by region, powers divided by the number of emitted photons, times the albedo; in a medium of uneven density
    /// what it scatters, by volume, where the density is 1.
    pub regions: Vec<Vec<Photon>>,
    /// Photons emitted.
    pub emitted: u64,
    /// Photons that a whole pass emits: more than that, of a [sample].
    pub planned: u64,
    /// Events of an emission on average, as a pilot counted them.
    pub events: f64,
    /// Whether most of them were aimed at media.
    pub aimed: bool,
    /// Whether first collisions were forced.
    pub forced: bool,
    /// Whether there are fewer photons than were asked for as more would change nothing.
    pub enough: bool,
    /// Counts of mishaps.
    pub tally: Tally,
}

impl Traced {
    /// Photons stored.
    pub fn stored(&self) -> u64 {
        self.regions.iter().map(|photons| photons.len() as u64).sum()
    }
}

/// Never fewer photons than this are emitted.
const FEWEST: u64 = 10_000;
/// Emissions are traced in so many parts at most,
const PARTS: u64 = 16;
/// and parts of no fewer, so that threads seldom wait for one another.
const LEAST_PART: u64 = 128 * CHUNK;
/// A map expected to hold more than this many times its target thins itself.
const CROWDED: f64 = 1.5;

/// Where lights are asked for what is scattered once, the map holds a part s of the light, and its noise is a part of the picture's.
/// As many emissions as would fill it with all light make that √s of what it would be then; in thin media, where s is small,
/// there are no more than so many times as many,
const RARE: f64 = 4.0;
/// or as these.
const FEW: f64 = 4e6;

/// Of so many emissions, those that are traced at once: for so long, their photons are held twice.
pub(crate) fn at_once(emitted: u64) -> u64 {
    emitted.div_ceil(PARTS).next_multiple_of(CHUNK).max(LEAST_PART)
}

/// Traces photons. `progress` is told how many emissions were done since it was last told, and how many there are to be; `stop` ends
/// the pass early: what it traced until then stands for all the light, except that it may have traced nothing.
///
/// # Errors
/// [`Error::Limit`](crate::Error::Limit) where walks are so long that all of them would take too many events, or leave too many photons.
pub fn trace(
    scene: &Scene,
    pass: &Pass<'_>,
    progress: &(impl Fn(u64, u64) + Sync),
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Traced> {
    trace_some(scene, pass, u64::MAX, progress, stop)
}

/// Traces the first of a pass's photons: as many as are to leave about so many in the map. They tell what all of them come to.
///
/// # Errors
/// As [`trace`], for what the whole pass would take.
pub fn sample(scene: &Scene, pass: &Pass<'_>, photons: u64) -> Result<Traced> {
    trace_some(scene, pass, photons, &|_, _| {}, &|| false)
}

/// Traces the first of a pass's photons, about `most` of those that are stored, or all.
fn trace_some(
    scene: &Scene,
    pass: &Pass<'_>,
    most: u64,
    progress: &(impl Fn(u64, u64) + Sync),
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Traced> {
    let mut tracer = Tracer::new(scene, pass);
    let empty = || Traced { regions: vec![Vec::new(); scene.regions as usize], ..Traced::default() };
    if tracer.sources.is_empty() || !scene.media.iter().any(|medium| medium.scatters()) {
        return Ok(empty());
    }

    // How many to emit, so that the map holds what it should.
    let found = pilot::prepare(&mut tracer, stop);
    tracer.budget.settle()?;
    let asked = pass.single_scattering.asks_lights();
    if found.collided == 0.0 || (found.stored == 0 && !asked) || stop() {
        return Ok(Traced { emitted: found.emitted, planned: found.emitted, forced: tracer.forced, ..empty() });
    }
    let target = pass.target.saturating_mul(if pass.control.is_some() { RICHER } else { 1 });
    let share = found.stored as f64 / found.emitted as f64;
    let crowded = if found.surplus > 1.0 { 1.0 } else { CROWDED };
    let wanted = (target as f64 / share * found.surplus).ceil().max(1.0) as u64;
    let enough = if asked { FEW.max(RARE * target as f64 / found.collisions) } else { f64::INFINITY };
    let is_enough = wanted as f64 > enough;
    let wanted = if is_enough { enough as u64 } else { wanted };
    let planned = wanted.max(budget::fewest(FEWEST, found.events)).min(pass.max_emitted);
    tracer.budget = Budget::of_pass(target);
    tracer.budget.allow(planned, found.events)?;
    let expected = planned as f64 * share;
    if expected > crowded * target as f64 {
        tracer.quota.keep = target as f64 / expected;
    }
    let part = (most as f64 / (expected * tracer.quota.keep)).min(1.0);
    let emitted = (planned as f64 * part).ceil() as u64;

    // A part at a time: photons need not be held twice.
    let (forced, aimed, events) = (tracer.forced, tracer.sources.are_aimed(), found.events);
    let mut traced = Traced { planned, events, aimed, forced, enough: is_enough, ..empty() };
    let wanted = pass.target as f64 * part;
    let part = at_once(emitted);
    for first in (0..emitted).step_by(part as usize) {
        let range = first..(first + part).min(emitted);
        for chunk in tracer.run(Purpose::Photon, (range, emitted), progress, stop) {
            traced.emitted += chunk.emitted;
            traced.tally = traced.tally.merge(chunk.tally);
            for (region, photon) in chunk.volume.photons {
                traced.regions[region as usize].push(photon);
            }
        }
    }
    tracer.budget.settle()?;

    // Each photon stands for its part of the light.
    let scale = (1.0 / traced.emitted.max(1) as f64) as f32;
    let stored = traced.stored();
    for photons in &mut traced.regions {
        if let Some(tagged) = pass.control {
            let target = (wanted * photons.len() as f64 / stored.max(1) as f64).ceil() as u64;
            *photons = hand_over(std::mem::take(photons), target, Filled::Media, tagged);
        }
        photons.par_iter_mut().for_each(|photon| photon.power *= scale);
        photons.shrink_to_fit();
    }
    Ok(traced)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{DVec3, Ray, Rgb, Stream, sampling};
    use crate::photon::{Emission, Importon};
    use crate::scene;
    use crate::scene::description::SingleScattering;
    use crate::transport::Events;
    use std::f64::consts::PI;

    fn stored(text: &str, single_scattering: SingleScattering) -> (Traced, f64) {
        seen(text, single_scattering, None)
    }

    fn seen(text: &str, single_scattering: SingleScattering, importons: Option<&[Importon]>) -> (Traced, f64) {
        let (scene, _) = scene::from_text(text);
        let pass = Pass {
            seed: 3,
            index: 0,
            target: 100_000,
            max_emitted: 400_000,
            emission: Emission::default(),
            max_events: Events::unlimited(),
            single_scattering,
            importons,
            control: None,
        };
        let traced = trace(&scene, &pass, &|_, _| {}, &|| false).unwrap();
        let first = traced.regions.iter().flatten().filter(|photon| photon.events == 0);
        let power = first.map(|photon| f64::from(photon.power.x)).sum();
        (traced, power)
    }

    /// The power that photons leave at their first collisions is what a ball of fog scatters of a lamp's light, however they are
    /// emitted: bare, from the lamp within it, thin, so that collisions are forced, and far, so that they are aimed.
    #[test]
    fn first_collisions_carry_the_light_that_is_scattered() {
        let fog = |sigma: f64, lamp: f64| {
            format!(
                "[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n[media.fog]\nsigma_t = {sigma}\nalbedo = 0.8\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1.5\ninterior = \"fog\"\n\
                 [[lights]]\ntype = \"point\"\nposition = [{lamp}, 0, 0]\nintensity = 2\n"
            )
        };
        let power = 4.0 * PI * 2.0;
        // ∫ dV/r² over a ball seen from outside.
        let outside = |d: f64, r: f64| PI * (2.0 * r - (d * d - r * r) / d * ((d + r) / (d - r)).ln());
        let seen = 2.0 * 0.8 * 1e-3 * outside(40.0, 1.5);
        for (what, sigma, lamp, forced, expected) in [
            ("bare", 1.0, 0.0, false, power * 0.8 * (1.0 - (-1.5f64).exp())),
            ("forced", 1e-4, 0.0, true, power * 0.8 * 1.5e-4),
            ("aimed and forced", 1e-3, 40.0, true, seen),
        ] {
            let (traced, found) = stored(&fog(sigma, lamp), SingleScattering::Photons);
            assert_eq!(traced.forced, forced, "{what}");
            assert!((found / expected - 1.0).abs() < 0.01, "{what}: {found}, not {expected}");
        }
    }

    /// Two lamps light a long box of fog, or of voxels, of which one end is seen: there photons lie much closer than without importance,
    /// and bring as much light, as they do to the rest.
    #[test]
    fn importance_moves_photons_and_no_light() {
        for density in ["", "density = { type = \"noise\", threshold = 0.1, scale = 5 }\n"] {
            let text = format!(
                "[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n[media.fog]\nsigma_t = 0.5\nalbedo = 0.8\n{density}\
                 [[shapes]]\ntype = \"box\"\nmin = [-10, -1, -1]\nmax = [10, 1, 1]\ninterior = \"fog\"\n\
                 [[lights]]\ntype = \"point\"\nposition = [-9, 0, 0]\nintensity = 2\n\
                 [[lights]]\ntype = \"point\"\nposition = [9, 0, 0]\nintensity = 2\n"
            );
            // The end that is seen, in the scene's own coordinates.
            let middle = scene::from_text(&text).0.geometry.all_bounds().center();
            let importon = |i: u32| {
                let [x, y, z] = [0.754_877_7, 0.569_840_3, 0.618_034].map(|step: f64| (f64::from(i) * step).fract());
                let place = middle + DVec3::new(-10.0 + 2.0 * x, 2.0 * y - 1.0, 2.0 * z - 1.0);
                Importon { position: place.as_vec3(), weight: 1.0 }
            };
            let importons: Vec<Importon> = (0..8192).map(importon).collect();
            let of = |importons| {
                let (traced, _) = seen(&text, SingleScattering::Photons, importons);
                // Counts, powers and their squares.
                let mut ends = [[0.0; 3]; 2];
                for photon in traced.regions.iter().flatten() {
                    let end = usize::from(f64::from(photon.position.x) - middle.x > -8.0);
                    let power = f64::from(photon.power.x);
                    [1.0, power, power * power].iter().zip(&mut ends[end]).for_each(|(of, sum)| *sum += of);
                }
                ends
            };
            let (even, important) = (of(None), of(Some(&importons)));
            let share = |ends: &[[f64; 3]; 2]| ends[0][0] / (ends[0][0] + ends[1][0]);
            assert!(share(&important) > 1.7 * share(&even), "{density}: {} of photons", share(&important));
            for (even, important) in even.iter().zip(&important) {
                let [_, light, _] = even;
                // Flights leave some three photons each.
                let error = (3.0 * (even[2] + important[2])).sqrt() / light;
                let off = important[1] / light - 1.0;
                assert!(error < 0.06 && off.abs() < 3.0 * error, "{density}: {off} of the light, {error} expected");
            }
        }
    }

    /// Photons along flights through uneven matter bring to every part of it, times its density, what is scattered there of a
    /// lamp's light: in every channel, and however thin it is.
    #[test]
    fn photons_along_flights_tell_what_is_scattered() {
        for (sigma, forced) in [(6.0, false), (6e-3, true)] {
            let text = format!(
                "[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n[media.cloud]\nsigma_t = [{sigma}, {}, {}]\n\
                 albedo = [0.9, 0.5, 0.7]\ndensity = {{ type = \"noise\", octaves = 2, threshold = 0.4 }}\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1.5\ninterior = \"cloud\"\n\
                 [[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\nintensity = 2\n",
                0.2 * sigma,
                1.4 * sigma
            );
            let (traced, _) = stored(&text, SingleScattering::Photons);
            assert_eq!(traced.forced, forced);
            let (scene, _) = scene::from_text(&text);
            let medium = &scene.media[0];
            // Of directions spread evenly, what collides in two shells.
            let middle = scene.geometry.all_bounds().center();
            let mut expected = [Rgb::ZERO; 2];
            let directions = 40_000;
            let mut stream = Stream::new(43, Purpose::Test, 0, 0);
            for _ in 0..directions {
                let ray = Ray::new(middle, sampling::sphere(stream.uniform2()));
                let passed = [0.0, 0.8, 1.5].map(|t| medium.transmittance(medium.density.depth(&ray, 0.0, t)));
                for (shell, expected) in expected.iter_mut().enumerate() {
                    *expected += (passed[shell] - passed[shell + 1])
                        * medium.albedo_at(DVec3::ZERO)
                        * (8.0 * PI / f64::from(directions));
                }
            }
            let mut found = [Rgb::ZERO; 2];
            for photon in traced.regions.iter().flatten().filter(|photon| photon.events == 0) {
                let p = photon.position.as_dvec3();
                let shell = usize::from(p.distance(middle) > 0.8);
                found[shell] += Rgb::from(photon.power.as_dvec3()) * medium.density.at(p);
            }
            for (found, expected) in found.into_iter().zip(expected) {
                let off = (found / expected).map(|ratio| (ratio - 1.0).abs()).max_element();
                assert!(off < 0.02, "{sigma}: {found}, not {expected}");
            }
        }
    }

    /// What lights are asked for is not stored: no photon comes straight from its lamp.
    #[test]
    fn light_that_is_asked_for_is_not_stored() {
        let text = "[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n[media.fog]\nsigma_s = 2\n\
                    [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\ninterior = \"fog\"\n\
                    [[lights]]\ntype = \"point\"\nposition = [0, 2, 0]\nintensity = 2\n";
        let (all, first) = stored(text, SingleScattering::Photons);
        let (rest, none) = stored(text, SingleScattering::Traced);
        assert!(first > 0.0 && none == 0.0, "{first} {none}");
        let later = |traced: &Traced| -> f64 {
            let photons = traced.regions.iter().flatten().filter(|photon| photon.events > 0);
            photons.map(|photon| f64::from(photon.power.x)).sum()
        };
        let (a, b) = (later(&all), later(&rest));
        assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
    }
}
