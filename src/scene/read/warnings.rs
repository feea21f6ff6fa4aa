//! What is allowed in a scene file but probably not meant.

use crate::math::Rgb;
use crate::scene::description::{
    Description, EnvironmentSource, Light, LightKind, Medium, MediumEmission, Method, Place, ProfileStrength, Shape,
    Strength,
};
use crate::surface::Material;

pub(super) fn warnings(scene: &Description) -> Vec<String> {
    let mut warnings = Vec::new();
    no_light(scene, &mut warnings);
    cold_media(scene, &mut warnings);
    light_from_infinity(scene, &mut warnings);
    shapes_without_effect(scene, &mut warnings);
    lights_without_size(scene, &mut warnings);
    unseen_by_light_tracing(scene, &mut warnings);
    warnings
}

fn no_light(scene: &Description, warnings: &mut Vec<String>) {
    let lit = scene.lights.iter().any(shines)
        || scene.shapes.iter().any(|shape| shape.visible && emits(shape))
        || scene.media.iter().any(|medium| glows(medium) && medium.may_absorb());
    if !lit {
        let path = scene.path.display();
        warnings.push(format!(
            "{path}: nothing gives light, the image will be black; add [[lights]], or `emission` to a shape or medium"
        ));
    }
}

fn shines(light: &Light) -> bool {
    let strength = match &light.kind {
        LightKind::Point { intensity, .. } | LightKind::Spot { intensity, .. } => *intensity,
        LightKind::Profile { strength: ProfileStrength::Intensity(all) | ProfileStrength::Power(all), .. } => *all,
        LightKind::Directional { irradiance, .. } => *irradiance,
        LightKind::Environment { source: EnvironmentSource::Constant(radiance), scale, .. } => *radiance * *scale,
        LightKind::Environment { source: EnvironmentSource::Image(_), scale, .. } | LightKind::Sky { scale, .. } => {
            *scale
        }
    };
    strength != Rgb::ZERO
}

fn emits(shape: &Shape) -> bool {
    shape.emission.as_ref().is_some_and(|emission| match emission.strength {
        Strength::Radiance(strength) | Strength::Power(strength) => strength != Rgb::ZERO,
    })
}

fn glows(medium: &Medium) -> bool {
    match &medium.emission {
        Some(MediumEmission::Constant { radiance }) => *radiance != Rgb::ZERO,
        Some(MediumEmission::BlackBody { scale, .. }) => *scale != 0.0,
        Some(MediumEmission::Grid { radiance }) => radiance.scale != 0.0,
        None => false,
    }
}

fn cold_media(scene: &Description, warnings: &mut Vec<String>) {
    for medium in scene.media.iter().filter(|medium| glows(medium) && !medium.may_absorb()) {
        let message = "has an emission but does not glow: what it emits is multiplied by sigma_a, which is 0";
        warnings.push(medium.place.told(message));
    }
}

/// A world medium that is the same everywhere is black to infinity.
fn light_from_infinity(scene: &Description, warnings: &mut Vec<String>) {
    let Some(world) = &scene.world.medium else { return };
    let medium = &scene.media[world.value];
    let thick = medium.density.even().is_some_and(|value| value > 0.0);
    if !thick || medium.sigma_t() == Rgb::ZERO {
        return;
    }
    let from_infinity = |light: &&Light| match light.kind {
        LightKind::Environment { .. } | LightKind::Sky { .. } => true,
        LightKind::Directional { beam, .. } => beam.is_none(),
        _ => false,
    };
    for light in scene.lights.iter().filter(from_infinity) {
        warnings.push(light.place.told(format_args!(
            "light from infinity does not get through the world's medium {:?} and is black where that absorbs or scatters",
            medium.name,
        )));
    }
}

fn shapes_without_effect(scene: &Description, warnings: &mut Vec<String>) {
    let idle = |shape: &&Shape| {
        let material = scene.materials[shape.material.value].kind;
        shape.visible && material == Material::None && shape.interior.is_none() && shape.emission.is_none()
    };
    warn_of_some(
        scene.shapes.iter().filter(idle).map(|shape| &shape.place),
        "has material \"none\" but neither `interior` nor `emission`: it has no effect",
        warnings,
    );
}

/// One warning for any number of places.
fn warn_of_some<'a>(mut places: impl Iterator<Item = &'a Place>, message: &str, warnings: &mut Vec<String>) {
    let Some(first) = places.next() else { return };
    warnings.push(match places.count() {
        0 => first.told(message),
        others => first.told(format_args!("{message}; so it is with {others} more")),
    });
}

/// The path tracer finds lights behind mirrors and refracting boundaries only by hitting them.
fn lights_without_size(scene: &Description, warnings: &mut Vec<String>) {
    if scene.render.method != Method::Path {
        return;
    }
    let without_size = |light: &&Light| {
        let none = match light.kind {
            LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } => radius == 0.0,
            LightKind::Profile { .. } => true,
            LightKind::Directional { angle, .. } => angle == 0.0,
            LightKind::Environment { .. } | LightKind::Sky { .. } => false,
        };
        none && shines(light)
    };
    let lights: Vec<&str> = scene.lights.iter().filter(without_size).map(|light| light.place.key()).collect();
    let ways = match (shapes_of(scene, &hides_lights), shapes_that_only_mirror(scene)) {
        _ if lights.is_empty() => return,
        (solids, sheets) if solids.is_empty() && sheets.is_empty() => return,
        (solids, sheets) if sheets.is_empty() => format!("by way of {}", some(&solids)),
        (solids, sheets) if solids.is_empty() => format!("that {} mirror", some(&sheets)),
        (solids, sheets) => format!("by way of {}, nor what {} mirror of it", some(&solids), some(&sheets)),
    };
    warnings.push(format!(
        "{}: method \"path\" does not see light of {} {ways}; give the lights a `radius` (or `angle`)",
        scene.path.display(),
        some(&lights),
    ));
}

/// Light paths find no camera by way of mirrors and smooth boundaries.
fn unseen_by_light_tracing(scene: &Description, warnings: &mut Vec<String>) {
    if scene.render.method != Method::Light {
        return;
    }
    let is_smooth = |material: Material| match material {
        Material::Dielectric(dielectric) => dielectric.roughness == 0.0 && hides_lights(material),
        material => hides_lights(material),
    };
    let path = scene.path.display();
    let shapes = shapes_of(scene, &is_smooth);
    if !shapes.is_empty() {
        warnings.push(format!(
            "{path}: method \"light\" does not see what {} mirror or refract towards the camera: they look black",
            some(&shapes),
        ));
    }
    let sheets = shapes_that_only_mirror(scene);
    if !sheets.is_empty() {
        warnings
            .push(format!("{path}: method \"light\" does not see what {} mirror towards the camera", some(&sheets)));
    }
}

/// The visible shapes of a material for which `holds` is true, or of a mixture with such a part.
fn shapes_of<'s>(scene: &'s Description, holds: &impl Fn(Material) -> bool) -> Vec<&'s str> {
    let holds = |shape: &&Shape| shape.visible && any_part(scene, scene.materials[shape.material.value].kind, holds);
    scene.shapes.iter().filter(holds).map(|shape| shape.place.key()).collect()
}

/// Those through which lights are asked for, and that mirror them.
fn shapes_that_only_mirror(scene: &Description) -> Vec<&str> {
    let solids = shapes_of(scene, &hides_lights);
    let mut sheets = shapes_of(scene, &is_sheet);
    sheets.retain(|shape| !solids.contains(shape));
    sheets
}

/// Whether `holds` is true of a material, or of one that it is a mixture of.
fn any_part(scene: &Description, material: Material, holds: &impl Fn(Material) -> bool) -> bool {
    match material {
        Material::Mixture(mixture) => {
            [mixture.a, mixture.b].iter().any(|part| any_part(scene, scene.materials[*part as usize].kind, holds))
        }
        _ => holds(material),
    }
}

/// Whether all light of a light by way of this material is found only by hitting the light.
fn hides_lights(material: Material) -> bool {
    match material {
        Material::Dielectric(dielectric) => dielectric.index != Rgb::ONE,
        _ => material.is_partly_specular() && !is_sheet(material),
    }
}

fn is_sheet(material: Material) -> bool {
    matches!(material, Material::Opaque(bsdf) if bsdf.is_sheet())
}

fn some(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    match names.len() {
        0..=SHOWN => names.join(", "),
        all => format!("{} and {} more", names[..SHOWN].join(", "), all - SHOWN),
    }
}
