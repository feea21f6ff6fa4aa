//! What a scene asks in vain: lights that reach nothing, shapes and media that are never come to, names that are not used.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::names::Names;
use super::probe::{Met, Prober, Seen};
use super::report::{Outcome, Row};
use crate::light::Light;
use crate::math::{DVec3, Ray, Stream};
use crate::photon::Sources;
use crate::scene::{Description, Scene, Settings};
use crate::surface::Material;

/// Walks from the camera.
const WALKS: u64 = 8192;
/// Walks from all lights together, and from one at least.
const FROM_LIGHTS: u64 = 16_384;
const FROM_ONE: u64 = 256;
/// Lines of sight to what walks did not come to.
const LOOKS: usize = 2048;
/// So many names are told of.
const TOLD: usize = 4;

/// The rows.
pub fn rows(
    (scene, description, names): (&Scene, &Description, &Names<'_>),
    settings: &Settings,
    prober: &Prober<'_>,
    stop: &dyn Fn() -> bool,
) -> Vec<Row> {
    let eyes = prober.eyes(settings, WALKS, stop);
    let count = scene.lights.len();
    let each = (FROM_LIGHTS / count.max(1) as u64).max(FROM_ONE);
    let beams: Vec<Seen> = (0..count as u32)
        .map(|light| {
            let sources = Sources::of_some_lights(scene, &[light]);
            prober.lights((&sources, u64::from(light) + 1), each, None, stop)
        })
        .collect();
    if stop() {
        let tests = ["lights reach what is seen", "shapes are seen", "media are entered"];
        return tests.map(|test| Row::not_applicable(test, "there was no time: allow more --time")).into();
    }

    let idle = |light: &u32| !reaches(scene, prober, &eyes, &beams[*light as usize], *light);
    let (dark, lit): (Vec<u32>, Vec<u32>) = (0..count as u32).partition(idle);
    let lights: Vec<String> = dark.into_iter().map(|light| names.light(light)).collect();
    // What only a light meets that reaches nothing is not seen either.
    let beams: Vec<&Seen> = lit.into_iter().map(|light| &beams[light as usize]).collect();
    let shapes = unseen(scene, description, names, prober, &eyes, &beams);
    let media = unentered(scene, names, prober, &eyes, &beams);
    let told = |test: &str, of: usize, what: &str, odd: Vec<String>| match odd.len() {
        _ if of == 0 => Row::not_applicable(test, "there are none"),
        0 => Row::new(test, Outcome::Pass, format!("all {of} {what}")).with(0.0),
        n => Row::new(test, Outcome::Fail, some(&odd)).with(n as f64),
    };
    vec![
        told(
            "lights reach what is seen",
            count,
            "do",
            lights.into_iter().map(|name| name + " reaches nothing that is seen").collect(),
        ),
        told(
            "shapes are seen",
            scene.surfaces.len(),
            "are",
            shapes.into_iter().map(|name| name + " is never seen").collect(),
        ),
        told(
            "media are entered",
            scene.media.len(),
            "are",
            media.into_iter().map(|name| format!("medium {name} is never entered")).collect(),
        ),
        twice(scene, description, names),
        unused(description),
    ]
}

/// Lights that are said twice, and opaque or shining shapes where another is: these double the light, or hide each other.
fn twice(scene: &Scene, description: &Description, names: &Names<'_>) -> Row {
    const TEST: &str = "nothing is there twice";
    let mut odd = Vec::new();
    let mut lights = HashMap::new();
    for light in &description.lights {
        // Equal numbers read alike, wherever in the file they are.
        match lights.entry(format!("{:?}", light.kind)) {
            Entry::Occupied(first) => odd.push(format!("{} is the same as {}", light.place.key(), first.get())),
            Entry::Vacant(free) => _ = free.insert(light.place.key()),
        }
    }
    let mut shapes = HashMap::new();
    let said = description.shapes.iter().filter(|shape| shape.visible).count();
    for (id, surface) in (0..).zip(&scene.surfaces[..said.min(scene.surfaces.len())]) {
        if !surface.material.is_opaque() && surface.light.is_none() {
            continue;
        }
        // Surfaces on which the same numbers find the same points are one.
        let points = [[0.3, 0.6], [0.8, 0.1]].map(|u| scene.geometry.sample_area(id, u).point);
        match shapes.entry(points.map(|point| point.to_array().map(f64::to_bits))) {
            Entry::Occupied(first) => {
                odd.push(format!("{} is where {} is", names.shape(id), names.shape(*first.get())))
            }
            Entry::Vacant(free) => _ = free.insert(id),
        }
    }
    match odd.len() {
        0 => Row::new(TEST, Outcome::Pass, "no light, and no shape that is opaque or shines").with(0.0),
        n => Row::new(TEST, Outcome::Fail, some(&odd)).with(n as f64),
    }
}

/// Whether any light of a light comes to what eyes come to.
fn reaches(scene: &Scene, prober: &Prober<'_>, eyes: &Seen, beam: &Seen, light: u32) -> bool {
    let collided =
        |seen: &Seen, medium: u32| seen.met.iter().any(|met| matches!(met, Met::Medium(of, _) if *of == medium));
    // In media so thin that none of the walks collides they would, sooner or later.
    let thin = |medium: &&u32| {
        scene.media[**medium as usize].scatters() && !collided(eyes, **medium) && !collided(beam, **medium)
    };
    if eyes.lights.contains(&light)
        || eyes.met.intersection(&beam.met).next().is_some()
        || eyes.media.intersection(&beam.media).find(thin).is_some()
    {
        return true;
    }
    let of = &scene.lights[light as usize];
    let free = |position: DVec3| {
        let opaque = |id: u32| scene.surfaces[id as usize].material.is_opaque();
        eyes.places.iter().any(|(from, _)| {
            let distance = from.distance(position);
            let ray = Ray::new(*from, (position - *from) / distance);
            of.importance(*from) > 0.0 && !scene.geometry.occluded(&ray, 0.0, distance * (1.0 - 1e-9), opaque)
        })
    };
    match of {
        Light::Point(point) => free(point.position),
        Light::Spot(spot) => free(spot.position),
        Light::Goniometric(lamp) => free(lamp.position),
        Light::Area(area) => {
            let to = |stream: &mut Stream| scene.geometry.sample_area(area.shape, stream.uniform2()).point;
            prober.finds(eyes, to, |way| way.shapes.contains(&area.shape), LOOKS)
        }
        Light::Environment(_) => eyes.escaped,
        Light::Directional(_) => false,
    }
}

/// Shapes to which neither eyes nor light come.
fn unseen(
    scene: &Scene,
    description: &Description,
    names: &Names<'_>,
    prober: &Prober<'_>,
    eyes: &Seen,
    beams: &[&Seen],
) -> Vec<String> {
    let said = description.shapes.iter().filter(|shape| shape.visible).count();
    let all = || beams.iter().copied().chain([eyes]);
    let is_unseen = |id: &u32| {
        let surface = &scene.surfaces[*id as usize];
        let has_effect = surface.material != Material::None || surface.solid.is_some() || surface.light.is_some();
        let inside = |solids: &[u32]| surface.solid.is_some_and(|solid| solids.contains(&solid));
        let met =
            |seen: &Seen| seen.shapes.contains(id) || surface.solid.is_some_and(|solid| seen.solids.contains(&solid));
        let to = |stream: &mut Stream| scene.geometry.sample_area(*id, stream.uniform2()).point;
        has_effect
            && !all().any(met)
            && !prober.finds(eyes, to, |way| way.shapes.contains(id) || inside(way.solids), LOOKS)
    };
    (0..scene.surfaces.len().min(said) as u32).filter(is_unseen).map(|id| names.shape(id)).collect()
}

/// Media to which neither eyes nor light come.
fn unentered(scene: &Scene, names: &Names<'_>, prober: &Prober<'_>, eyes: &Seen, beams: &[&Seen]) -> Vec<String> {
    let is_unentered = |medium: &u32| {
        let solids: Vec<u32> =
            scene.solids.iter().filter(|solid| solid.medium == Some(*medium)).map(|solid| solid.shape).collect();
        let to = |stream: &mut Stream| {
            let Some(shape) = solids.get((stream.uniform() * solids.len() as f64) as usize) else { return DVec3::ZERO };
            let bounds = scene.geometry.bounds(*shape);
            bounds.min + bounds.size() * DVec3::from([(); 3].map(|()| stream.uniform()))
        };
        !scene.media[*medium as usize].is_clear()
            && !beams.iter().copied().chain([eyes]).any(|seen| seen.media.contains(medium))
            && !prober.finds(eyes, to, |way| way.medium == Some(*medium), LOOKS)
    };
    (0..scene.media.len() as u32).filter(is_unentered).map(|medium| names.medium(medium).to_string()).collect()
}

/// Media and materials that nothing in the file names. They do no harm.
fn unused(description: &Description) -> Row {
    const TEST: &str = "names are used";
    let Ok(text) = std::fs::read_to_string(&description.path) else {
        return Row::not_applicable(TEST, "the file cannot be read again");
    };
    let is_named = |name: &str| [format!("\"{name}\""), format!("'{name}'")].iter().any(|quoted| text.contains(quoted));
    // Where the file says what it is called.
    let heads = |table: &str, name: &str| {
        text.contains(&format!("[{table}.{name}")) || text.contains(&format!("{table}.{name}."))
    };
    let media = description.media.iter().map(|medium| ("media", medium.name.as_str()));
    let materials = description.materials.iter().map(|material| ("materials", material.name.as_str()));
    let idle: Vec<String> = media
        .chain(materials)
        .filter(|(table, name)| !name.is_empty() && heads(table, name) && !is_named(name))
        .map(|(table, name)| format!("{table}.{name}"))
        .collect();
    let found = if idle.is_empty() { "all are".to_string() } else { format!("but for {}", some(&idle)) };
    Row::new(TEST, Outcome::Pass, found).with(idle.len() as f64)
}

/// Some of these names.
fn some(names: &[String]) -> String {
    let shown = names[..names.len().min(TOLD)].join("; ");
    if names.len() > TOLD { format!("{shown}; and {} more", names.len() - TOLD) } else { shown }
}
