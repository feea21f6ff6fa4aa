//! Who renders a scene that leaves that to the plan: photons, or paths, where these leave hardly any noise.

use rayon::prelude::*;

use super::air;
use super::camera::Camera;
use super::eye::{Component, Context, Eye, Path};
use super::limits::Limits;
use super::numbers::{global_photons, volume_photons};
use super::plan::Plan;
use super::tile::{by_paths, eye_settings, set_out};
use crate::Result;
use crate::gather::Queue;
use crate::math::Stream;
use crate::math::random::{Purpose, mix};
use crate::scene::description::{Method, Render};
use crate::scene::{Scene, Settings, Surface};
use crate::surface::Material;
use crate::transport::{Parts, Tally};

/// A method, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The method.
    pub method: Method,
    /// The reason, as the rest of a sentence that begins with the method.
    pub why: String,
}

/// The relative squared error that photons leave where they fare best. Paths that cost so much less leave so much more at the same product of error and time,
const PHOTONS_LEAVE: f64 = 0.001;
/// but are good enough with the first of these, and with the second at most: that is grain which one sees.
const GOOD: [f64; 2] = [0.002, 0.005];
/// A light is wide if its part of what it might send to a place comes from so many steradians: paths then meet it by chance often enough for a pilot to tell what
/// noise caustics are.
const WIDE: f64 = 0.05;
/// Draws of each light that tell its width,
const DRAWS: u64 = 16;
/// from so many of the shapes that mirror or refract, at most,
const CASTERS: usize = 16;
/// and with so many lights, at most.
const LIGHTS: usize = 64;
/// What photons would gather.
const GATHERED: [Component; 4] =
    [Component::Indirect, Component::Caustic, Component::VolumeSingle, Component::VolumeMultiple];
/// A photon costs about as much as so many camera samples.
const A_PHOTON: f64 = 1.0;
/// Pixels of a pilot: looked at by so many together, until these tell that paths are not good enough, or there are
const BATCH: u64 = 64;
/// so many.
const PIXELS: u64 = 512;
/// Each is looked at twice, apart, with the picture's samples, but so many at most: samples of a pixel are spread evenly, which leaves less noise than as many
/// by chance.
const SAMPLES: u32 = 64;
/// A pilot traces no more than one of so many paths that the picture would have.
const SHARE: u64 = 4;
/// A pixel's squared mean is added to this share of the picture's: in the dark, what counts is how much brighter the rest is.
const DARK: f64 = 0.01;

/// Chooses between paths and photons for a scene that leaves the method to the plan ([`Render::automatic`]); `None` where it names one. The choice depends
/// on scene, seed and settings alone.
///
/// Paths are chosen where nothing mirrors or refracts a light of less than 0.05 sr, which may throw caustics that a few paths do not tell of, and where photons from infinity
/// would be traced through [wide air](Scene::has_wide_air), or air is seen beyond where they are; or where a pilot of paths finds that the picture's camera samples leave a relative squared error of 0.002 or less, or, where N photons cost more than the S samples of P pixels, 0.001 (1 + N/P S), up
/// to 0.005; or that, of the noise they leave, so little is of light that photons would gather, V_g against V of all other, that photons cost more than they save: V_g P S < V N.
///
/// # Errors
/// As [`Plan::new`].
pub fn choose(scene: &Scene, settings: &Settings) -> Result<Option<Choice>> {
    if !settings.render.automatic {
        return Ok(None);
    }
    let photons = |why: &str| Ok(Some(Choice { method: Method::Photon, why: why.to_string() }));
    if throws_narrow_caustics(scene, settings.render.seed) {
        return photons("as what mirrors or refracts a narrow light may throw caustics, which paths find by chance");
    }
    let by_paths = Settings { render: Render { method: Method::Path, ..settings.render.clone() }, ..settings.clone() };
    let camera = Camera::new(&scene.camera, &settings.film);
    if let Some(why) = air::left_to_paths(scene, &camera) {
        return Ok(Some(Choice { method: Method::Path, why }));
    }
    let plan = Plan::new(scene, &by_paths, &camera, &Limits::default())?;
    let (width, height) = camera.size();
    let all = u64::from(width) * u64::from(height);
    let twice = 2 * u64::from(plan.samples.min(SAMPLES));
    let pixels = (all.saturating_mul(plan.samples.into()) / (SHARE * twice)).min(PIXELS).min(all);
    if pixels < BATCH {
        return photons("as the picture is too small for a pilot of paths");
    }
    // Of one pass: more of them change no method.
    let samples = u64::from(plan.samples);
    let photons = volume_photons(scene, settings) + global_photons(scene, settings);
    let worth = A_PHOTON * photons as f64 / (all as f64 * samples as f64);
    let good = (PHOTONS_LEAVE * (1.0 + worth)).clamp(GOOD[0], GOOD[1]);
    Ok(Some(match noise((scene, &camera, plan), pixels, samples, (good, worth)) {
        Some(Noise { all, .. }) if all <= good => Choice {
            method: Method::Path,
            why: format!("as {samples} paths a pixel leave a relative squared error of {all:.1e}"),
        },
        Some(Noise { all, gathered }) if gathered < worth * (all - gathered) => Choice {
            method: Method::Path,
            why: format!("as {:.0} % of their noise is of light that photons would gather", 100.0 * gathered / all),
        },
        Some(Noise { all, .. }) => Choice {
            method: Method::Photon,
            why: format!("as {samples} paths a pixel would leave a relative squared error of {all:.1e}"),
        },
        None => Choice { method: Method::Photon, why: "as paths have no end in sight".to_string() },
    }))
}

/// Whether something mirrors or refracts light that comes from few directions.
fn throws_narrow_caustics(scene: &Scene, seed: u64) -> bool {
    let casts = |surface: &Surface| scene.any_part(&surface.material, &Material::is_narrow);
    let casters: Vec<u32> = (0..).zip(&scene.surfaces).filter(|(_, surface)| casts(surface)).map(|(i, _)| i).collect();
    if !casters.is_empty() && (scene.lights.len() > LIGHTS || !scene.glows.is_empty()) {
        return true;
    }
    casters.iter().step_by(casters.len().div_ceil(CASTERS).max(1)).any(|&shape| {
        let bounds = scene.geometry.bounds(shape).intersection(scene.near_bounds());
        let center = 0.5 * (bounds.min + bounds.max);
        (0..).zip(&scene.lights).any(|(index, light)| {
            if !light.has_size() {
                return true;
            }
            // 1/∫ p² dω: the solid angle, of light that comes evenly from it.
            let (mut drawn, mut density) = (0.0, 0.0);
            for draw in 0..DRAWS {
                let mut stream = Stream::new(seed, Purpose::Choice, u64::from(shape), index * DRAWS + draw);
                if let Some(arrival) = light.arrive(&scene.geometry, None, center, &mut stream) {
                    (drawn, density) = (drawn + 1.0, density + arrival.density);
                }
            }
            density * WIDE > drawn
        })
    })
}

/// The relative squared error that paths leave,
struct Noise {
    /// of all light,
    all: f64,
    /// and of what photons would gather.
    gathered: f64,
}

/// What so many paths a pixel leave, from so many pixels at most, and fewer where there is no doubt that photons are better; `None` where a path has no end in
/// sight. `good`: what noise is good enough, `worth`: what photons cost against camera samples.
fn noise(
    (scene, camera, plan): (&Scene, &Camera, Plan),
    pixels: u64,
    samples: u64,
    (good, worth): (f64, f64),
) -> Option<Noise> {
    let (width, height) = camera.size();
    // Apart: of another seed.
    let looks = [plan.clone(), Plan { seed: mix(plan.seed), ..plan }];
    // Whether to break off is asked after thousands of events of one path.
    let eyes =
        looks.each_ref().map(|plan| Eye::new(scene, eye_settings(plan, camera, (by_paths(plan), None), &|| true)));
    let taken = looks[0].samples.min(SAMPLES);
    // By the plastic number, which is to the plane what the golden ratio is to the line: the first are spread over the film as all are.
    let place = |number: u64| {
        const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
        let [x, y] = STEPS.map(|step| (number as f64 * step).fract());
        (((x * f64::from(width)) as u32).min(width - 1), ((y * f64::from(height)) as u32).min(height - 1))
    };
    let (mut found, mut noise) = (Vec::new(), Noise { all: 0.0, gathered: 0.0 });
    for first in (0..pixels).step_by(BATCH as usize) {
        let batch: Vec<Option<Pixel>> = (first..pixels.min(first + BATCH))
            .into_par_iter()
            .map(|number| two_looks((scene, camera), (&looks, &eyes), taken, place(number)))
            .collect();
        for pixel in batch {
            found.push(pixel?);
        }
        let mean = found.iter().map(|pixel| pixel.mean).sum::<f64>() / found.len() as f64;
        let relative = |of: fn(&Pixel) -> f64| {
            let each = found.iter().map(|pixel| {
                let scale = pixel.mean * pixel.mean + DARK * mean * mean;
                if scale > 0.0 { of(pixel) / scale } else { 0.0 }
            });
            each.sum::<f64>() / found.len() as f64 * f64::from(taken) / samples as f64
        };
        noise = Noise { all: relative(|pixel| pixel.all), gathered: relative(|pixel| pixel.gathered) };
        if noise.all > 2.0 * good && noise.gathered > 2.0 * worth * (noise.all - noise.gathered) {
            break;
        }
    }
    Some(noise)
}

/// What two looks at a pixel tell.
struct Pixel {
    mean: f64,
    /// The variance of what one of them sees,
    all: f64,
    /// and of what photons would gather of that.
    gathered: f64,
}

/// Looks at a pixel twice, by so many paths each; `None` if one of them has no end in sight.
fn two_looks<'s>(
    (scene, camera): (&'s Scene, &Camera),
    (looks, eyes): (&[Plan; 2], &[Eye<'s>; 2]),
    samples: u32,
    pixel: (u32, u32),
) -> Option<Pixel> {
    let look = |of: usize| {
        let (plan, eye) = (&looks[of], &eyes[of]);
        let (mut queue, mut parts, mut tally) = (Queue::default(), Parts::<'_, Path>::new(), Tally::default());
        let [mut all, mut gathered] = [0.0; 2];
        for sample in 0..samples {
            let (mut stream, ray, inside) = set_out((scene, camera, plan), pixel, (0, sample));
            let mut context =
                Context { stream: &mut stream, queue: &mut queue, pixel: 0, tally: &mut tally, parts: &mut parts };
            let seen = eye.look(ray, inside, &mut context);
            if seen.is_broken_off {
                return None;
            }
            for (component, radiance) in Component::ALL.into_iter().zip(seen.radiance) {
                let grey = radiance.element_sum() / 3.0 / f64::from(samples);
                all += grey;
                gathered += if GATHERED.contains(&component) { grey } else { 0.0 };
            }
        }
        Some([all, gathered])
    };
    let [first, second] = [0, 1].map(look);
    let (first, second) = (first?, second?);
    let variance = |of: usize| 0.5 * (first[of] - second[of]).powi(2);
    Some(Pixel { mean: 0.5 * (first[0] + second[0]), all: variance(0), gathered: variance(1) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;

    /// A ball on a plane.
    const BALL: &str = r#"
film = { width = 120, height = 90 }
camera = { position = [0, 1, 6], target = [0, 0, 0] }
materials.white = { type = "lambert", reflectance = 0.5 }
materials.glass = { type = "dielectric", ior = 1.5 }
[media.fog]
sigma_s = 0.2
sigma_a = 0.01
[[shapes]]
type = "disk"
center = [0, -1, 0]
normal = [0, 1, 0]
radius = 20
material = "white"
"#;
    const SKY: &str = "\n[[lights]]\ntype = \"environment\"\nradiance = 1.0\n";
    const LAMP: &str = "\n[[lights]]\ntype = \"point\"\nposition = [1, 2, 1]\nintensity = 5\n";
    const FOG: &str = "\n[world]\nmedium = \"fog\"\n";
    const PEBBLE: &str = "\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = ";

    /// An even sky on a plane is for paths, and so is glass under it; fog around a lamp, and glass beside one, are for photons, and so is whatever says how photons are to be used; a method that is
    /// named stays.
    #[test]
    fn paths_are_chosen_where_they_have_little_noise() {
        let chosen = |parts: &[&str]| {
            let (scene, settings) = scene::from_text(&format!("{BALL}{}", parts.concat()));
            choose(&scene, &settings).unwrap().map(|choice| choice.method)
        };
        let ball = format!("{PEBBLE}\"white\"\n");
        let glass = format!("{PEBBLE}\"glass\"\n");
        assert_eq!(chosen(&[&ball, SKY]), Some(Method::Path));
        assert_eq!(chosen(&[&glass, SKY]), Some(Method::Path));
        assert_eq!(chosen(&[&glass, SKY, LAMP]), Some(Method::Photon));
        assert_eq!(chosen(&[FOG, &ball, LAMP]), Some(Method::Photon));
        let says = ["[photons]\nvolume = 1000", "[volume]\nneighbours = 50", "[surface]\nindirect = \"map\""];
        for says in says.into_iter().chain(["[render]\nmethod = \"path\""]) {
            assert_eq!(chosen(&[&ball, SKY, says]), None, "{says}");
        }
    }
}
