//! `[[lights]]`

use std::f64::consts::PI;
use std::path::PathBuf;

use super::{Either, Names, all, either};
use crate::light::Sky;
use crate::math::{DVec3, Rgb};
use crate::medium::black_body;
use crate::scene::description::{Beam, EnvironmentSource, Light, LightKind, Located, ProfileStrength};
use crate::scene::table::{Item, Read, Table, unit};

pub(super) fn lights(items: &[Item], names: &Names) -> Read<Vec<Light>> {
    all(items, |item| {
        let table = item.table()?;
        let name = table.get("name", |item| item.string().map(str::to_owned));
        let kind = kind(&table, names);
        Ok(Light { name: name?, kind: kind?, place: item.place() })
    })
}

/// The keys of the light's own type; they are the last to be read.
fn kind(table: &Table, names: &Names) -> Read<LightKind> {
    type Reader = fn(&Table, &Names) -> Read<LightKind>;
    let kinds: [(&str, Reader); 5] =
        [("point", point), ("spot", spot), ("directional", directional), ("sky", sky), ("environment", environment)];
    let read = table.require("type", |item| item.choice(&kinds, &[]))?;
    read(table, names)
}

fn point(table: &Table, names: &Names) -> Read<LightKind> {
    let position = table.require("position", Item::vector);
    let strength = strength(table);
    let radius = table.get_or("radius", 0.0, Item::length_or_zero);
    let profile = profile(table, names);
    let direction = table.get("direction", Item::direction);
    table.finish()?;
    let (profile, direction) = (profile?, direction?);
    if let Some(file) = profile {
        without(table, "radius", "the light of a `profile` comes from one point")?;
        let direction = direction.unwrap_or(-DVec3::Y);
        return Ok(LightKind::Profile { position: position?, direction, strength: of_profile(strength?), file });
    }
    if direction.is_some() {
        return Err(
            table.fail_at("direction", "has no meaning without `profile`: a point shines in all directions alike")
        );
    }
    Ok(LightKind::Point { position: position?, intensity: intensity(strength?, 4.0 * PI), radius: radius? })
}

/// The file of a lamp's profile.
fn profile(table: &Table, names: &Names) -> Read<Option<Located<PathBuf>>> {
    table.get("profile", |item| item.file(names.folder, &["ies", "ldt"]))
}

fn of_profile(strength: Either<Rgb, Rgb>) -> ProfileStrength {
    match strength {
        Either::First(intensity) => ProfileStrength::Intensity(intensity),
        Either::Second(power) => ProfileStrength::Power(power),
    }
}

/// Refuses a key beside `profile`.
fn without(table: &Table, key: &'static str, why: &str) -> Read<()> {
    match table.find(key) {
        None => Ok(()),
        Some(item) => Err(item.fail(format!("has no meaning beside `profile`: {why}"))),
    }
}

/// `intensity` or `power`; with a `temperature`, power has the colour of a black body.
fn strength(table: &Table) -> Read<Either<Rgb, Rgb>> {
    // Colder ones glow in infrared only; of hotter ones the colour changes no more.
    let temperature = table.get("temperature", |item| item.within(1000.0, 40_000.0));
    let strength = either(table, ("intensity", Item::colour), ("power", Item::colour))?;
    match (strength, temperature?) {
        (strength, None) => Ok(strength),
        (Either::Second(power), Some(kelvin)) => Ok(Either::Second(power * black_body::colour(kelvin))),
        (Either::First(_), Some(_)) => {
            Err(table.fail_at("temperature", "has no meaning beside `intensity`; expected it beside `power`"))
        }
    }
}

/// The intensity on the axis, from it or from the power: the intensity times `angle`.
fn intensity(strength: Either<Rgb, Rgb>, angle: f64) -> Rgb {
    match strength {
        Either::First(intensity) => intensity,
        Either::Second(power) => power / angle,
    }
}

fn spot(table: &Table, names: &Names) -> Read<LightKind> {
    // A cone as lamps have it, with an edge of a few degrees.
    const OUTER_ANGLE: f64 = 30.0;
    const EDGE: f64 = 5.0;
    // Smaller cones have no solid angle in f64.
    const SMALLEST: f64 = 1e-6;
    let position = table.require("position", Item::vector);
    let target = table.require("target", Item::vector);
    let strength = strength(table);
    let inner_angle = table.get("inner_angle", |item| item.within(0.0, 90.0));
    let outer_angle = table.get_or("outer_angle", OUTER_ANGLE, |item| item.within(SMALLEST, 90.0));
    let radius = table.get_or("radius", 0.0, Item::length_or_zero);
    let profile = profile(table, names);
    table.finish()?;

    let (position, inner_angle, outer_angle) = (position?, inner_angle?, outer_angle?);
    let Some(direction) = unit(target? - position) else {
        return Err(table
            .fail_at("target", "is where the light stands, or too far away; expected another point than `position`"));
    };
    if let Some(file) = profile? {
        without(table, "radius", "the light of a profile comes from one point")?;
        without(table, "inner_angle", "that says in which directions there is light")?;
        without(table, "outer_angle", "that says in which directions there is light")?;
        return Ok(LightKind::Profile { position, direction, strength: of_profile(strength?), file });
    }
    let inner_angle = inner_angle.unwrap_or((outer_angle - EDGE).max(0.0));
    if inner_angle > outer_angle {
        return Err(
            table.fail_at("inner_angle", format!("found {inner_angle}; expected at most `outer_angle`, {outer_angle}"))
        );
    }
    // Full inside the inner cone, half on average over cos θ in between: π(v_inner + v_outer) with v = 1 − cos θ.
    let v = |degrees: f64| 2.0 * (0.5 * degrees.to_radians()).sin().powi(2);
    let intensity = intensity(strength?, PI * (v(inner_angle) + v(outer_angle)));
    if !intensity.is_finite() {
        return Err(table.fail_at("power", "gives an intensity that exceeds the range of 64-bit numbers"));
    }
    Ok(LightKind::Spot { position, direction, intensity, inner_angle, outer_angle, radius: radius? })
}

fn directional(table: &Table, _: &Names) -> Read<LightKind> {
    let direction = table.require("direction", Item::direction);
    let irradiance = table.require("irradiance", Item::colour);
    let angle = table.get_or("angle", 0.0, |item| item.half_open(0.0, 180.0));
    let center = table.get("center", Item::vector);
    let radius = table.get("radius", Item::length);
    table.finish()?;
    let beam = match (center?, radius?) {
        (Some(center), Some(radius)) => Some(Beam { center, radius }),
        (None, None) => None,
        (Some(_), None) => return Err(table.fail_at("radius", "is missing beside `center`")),
        (None, Some(_)) => return Err(table.fail_at("center", "is missing beside `radius`")),
    };
    Ok(LightKind::Directional { direction: direction?, irradiance: irradiance?, angle: angle?, beam })
}

fn sky(table: &Table, _: &Names) -> Read<LightKind> {
    let sun = table.require("sun", |item| {
        let sun = item.direction()?;
        let expected = "expected the direction to it, with y of at least 0";
        let below = || item.fail(format!("the sun is below the horizon, where the model knows no sky; {expected}"));
        (sun.y >= 0.0).then_some(sun).ok_or_else(below)
    });
    let turbidity = table.get_or("turbidity", 3.0, |item| item.within(*Sky::TURBIDITY.start(), *Sky::TURBIDITY.end()));
    let ground = table.get_or("ground", Rgb::splat(0.2), Item::share);
    let scale = table.get_or("scale", Rgb::ONE, Item::colour);
    let sun_scale = table.get_or("sun_scale", Rgb::ONE, Item::colour);
    table.finish()?;
    Ok(LightKind::Sky { sun: sun?, turbidity: turbidity?, ground: ground?, scale: scale?, sun_scale: sun_scale? })
}

fn environment(table: &Table, names: &Names) -> Read<LightKind> {
    let source = either(table, ("radiance", Item::colour), ("file", |item| item.file(names.folder, &["exr", "hdr"])));
    let scale = table.get_or("scale", Rgb::ONE, Item::colour);
    let rotate = table.get_or("rotate", 0.0, Item::number);
    table.finish()?;
    let source = match source? {
        Either::First(radiance) => EnvironmentSource::Constant(radiance),
        Either::Second(file) => EnvironmentSource::Image(file),
    };
    Ok(LightKind::Environment { source, scale: scale?, rotate: rotate? })
}
