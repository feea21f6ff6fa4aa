//! `[media.*]`

use super::{Names, all, transform::transform};
use crate::math::{DAffine3, DVec3, Rgb};
use crate::medium::density::bricks::{Interpolation, NegativePolicy, Precision};
use crate::medium::density::{Exponential, Noise};
use crate::medium::phase::{HenyeyGreenstein, Isotropic, LARGEST_DIAMETER, Mixture, Phase, Rayleigh, Schlick, mie};
use crate::medium::presets::PRESETS;
use crate::scene::description::{Density, Medium, MediumEmission, MediumGrids, NamedGrid, Unit};
use crate::scene::table::{Item, Read, Table};
use crate::scene::tree::Value;

pub(super) fn medium(name: &str, item: &Item, names: &Names, scene_unit: Unit) -> Read<Medium> {
    let table = item.table()?;
    let phase = table.get_or("phase", (Isotropic.into(), None), phase_or_grid);
    let mean_cosine = match &phase {
        Ok((_, Some(_))) => None,
        Ok((phase, None)) => Some(phase.mean_cosine()),
        Err(_) => Some(0.0),
    };
    let coefficients = coefficients(&table, mean_cosine, scene_unit);
    let even = (Density::Constant { value: 1.0 }, Precision::Full);
    let density = table.get_or("density", even, |item| density(&item.table()?, names));
    let adds = table.get_or("add", false, Item::boolean);
    let emission = table.get("emission", |item| emission(&item.table()?));
    table.finish()?;
    let ((sigma_s, sigma_a, grids), (density, precision), emission) = (coefficients?, density?, emission?);
    let (name, (phase, mean_cosine), adds) = (name.to_owned(), phase?, adds?);
    let grids = MediumGrids { mean_cosine, ..grids };
    let medium =
        Medium { name, sigma_s, sigma_a, grids, phase, density, precision, emission, adds, place: item.place() };
    if let (Some(grid), None) = (medium.named_grids().next(), medium.density.grids()) {
        let message = "names a second grid of the density's file; expected a `density` of type \"vdb\"";
        return Err(item.fail_about(&grid.place, message));
    }
    Ok(medium)
}

/// What a number says, or a grid of the density's file.
#[derive(Clone, PartialEq)]
enum Said<T> {
    Number(T),
    Grid(NamedGrid),
}

/// Reads a number, or `{ grid = "NAME", scale = 1 }`.
fn or_grid<'a, T>(item: &Item<'a>, number: impl FnOnce(&Item<'a>) -> Read<T>) -> Read<Said<T>> {
    if !item.is_table() {
        return Ok(Said::Number(number(item)?));
    }
    let table = item.table()?;
    let name = table.require("grid", Item::located_string);
    let scale = table.get_or("scale", 1.0, Item::non_negative);
    table.finish()?;
    Ok(Said::Grid(NamedGrid { name: name?, scale: scale? }))
}

/// A phase function, or a grid of Henyey and Greenstein's g.
fn phase_or_grid(item: &Item) -> Read<(Phase, Option<NamedGrid>)> {
    let table = item.table()?;
    let is_hg = matches!(item.peek("type"), Some(Value::String(kind)) if kind == "hg");
    if !is_hg || !matches!(item.peek("g"), Some(Value::Table(_))) {
        return Ok((phase(&table, false)?, None));
    }
    table.require("type", Item::string)?;
    let g = table.require("g", |item| or_grid(item, |item| item.between(-1.0, 1.0)));
    table.finish()?;
    match g? {
        Said::Number(g) => Ok((HenyeyGreenstein { g }.into(), None)),
        Said::Grid(grid) => Ok((Isotropic.into(), Some(grid))),
    }
}

/// σ_s and σ_a per scene unit, scaled: given as such, a missing one being 0, or as extinction and albedo, or by
/// the name of a measured medium, whose scattering depends on the phase function's mean cosine, if that is known. Those that are
/// grids are 0 and told beside them.
fn coefficients(table: &Table, mean_cosine: Option<f64>, scene_unit: Unit) -> Read<(Rgb, Rgb, MediumGrids)> {
    let sigma_s = table.get("sigma_s", |item| or_grid(item, Item::colour));
    let sigma_a = table.get("sigma_a", |item| or_grid(item, Item::colour));
    let sigma_t = table.get("sigma_t", Item::colour);
    let albedo = table.get("albedo", |item| or_grid(item, Item::share));
    let preset = table.get("preset", |item| {
        let options = PRESETS.each_ref().map(|preset| (preset.name, preset));
        item.choice(&options, &[])
    });
    let unit = table.get("unit", |item| {
        let options =
            [("scene", None), ("mm", Some(Unit::Millimetre)), ("cm", Some(Unit::Centimetre)), ("m", Some(Unit::Metre))];
        item.choice(&options, &[])
    });
    let scale = table.get_or("scale", 1.0, Item::non_negative);

    let (sigma_s, sigma_a, preset) = (sigma_s?, sigma_a?, preset?);
    let given = (sigma_s, sigma_a, sigma_t?, albedo?);
    if preset.is_some() && given != (None, None, None, None) {
        let message = "is given beside coefficients; expected only one of them (`scale` thins a preset or thickens it)";
        return Err(table.fail_at("preset", message));
    }
    // Coefficients are per unit; a scene unit holds so many of these.
    let unit = unit?.unwrap_or(preset.map(|_| Unit::Millimetre));
    let factor = scale? * unit.map_or(1.0, |unit| scene_unit.metres() / unit.metres());
    let mut grids = MediumGrids::default();
    let (sigma_s, sigma_a) = match given {
        (None, None, None, None) => match (preset, mean_cosine) {
            (Some(preset), Some(mean_cosine)) => preset.coefficients(mean_cosine),
            (Some(_), None) => {
                let message = "is given beside a grid of `g`, of which its scattering depends; expected a number";
                return Err(table.fail_at("preset", message));
            }
            (None, _) => {
                let expected = "`sigma_s` and `sigma_a`, or `sigma_t` and `albedo`, or a `preset`";
                return Err(table.missing("", format!("has no coefficients; expected {expected}")));
            }
        },
        (None, None, Some(sigma_t), Some(Said::Number(albedo))) => (sigma_t * albedo, sigma_t * (Rgb::ONE - albedo)),
        (None, None, Some(sigma_t), Some(Said::Grid(albedo))) => {
            grids.albedo = Some((sigma_t * factor, albedo));
            (Rgb::ZERO, Rgb::ZERO)
        }
        (None, None, Some(_), None) => return Err(table.missing("albedo", "is missing beside `sigma_t`")),
        (None, None, None, Some(_)) => return Err(table.missing("sigma_t", "is missing beside `albedo`")),
        (sigma_s, sigma_a, None, None) => {
            let number = |said: Option<Said<Rgb>>, grid: &mut Option<NamedGrid>| match said {
                None => Rgb::ZERO,
                Some(Said::Number(sigma)) => sigma,
                Some(Said::Grid(named)) => {
                    *grid = Some(NamedGrid { scale: named.scale * factor, ..named });
                    Rgb::ZERO
                }
            };
            (number(sigma_s, &mut grids.sigma_s), number(sigma_a, &mut grids.sigma_a))
        }
        (sigma_s, _, sigma_t, _) => {
            let here = if sigma_t.is_some() { "sigma_t" } else { "albedo" };
            let other = if sigma_s.is_some() { "sigma_s" } else { "sigma_a" };
            let message =
                format!("`{other}` is given too; expected either `sigma_s` and `sigma_a`, or `sigma_t` and `albedo`");
            return Err(table.fail_at(here, message));
        }
    };
    let (sigma_s, sigma_a) = (sigma_s * factor, sigma_a * factor);
    if !(sigma_s + sigma_a).is_finite() || grids.albedo.as_ref().is_some_and(|(sigma_t, _)| !sigma_t.is_finite()) {
        return Err(table.fail("has coefficients that exceed the range of 64-bit numbers"));
    }
    Ok((sigma_s, sigma_a, grids))
}

/// A phase function; a lobe of a mixture is none itself and has a weight beside its own keys.
fn phase(table: &Table, lobe: bool) -> Read<Phase> {
    type Reader = fn(&Table) -> Read<Phase>;
    let kinds: &[(&str, Reader)] = &[
        ("isotropic", |_| Ok(Isotropic.into())),
        ("hg", |table| Ok(HenyeyGreenstein { g: table.require("g", |item| item.between(-1.0, 1.0))? }.into())),
        ("schlick", |table| Ok(Schlick { k: table.require("k", |item| item.between(-1.0, 1.0))? }.into())),
        ("rayleigh", |_| Ok(Rayleigh.into())),
        ("mie", |table| Ok(mie(table.require("diameter", |item| item.above_up_to(0.0, LARGEST_DIAMETER))?).into())),
        ("mixture", |table| table.require("lobes", mixture)),
    ];
    let kinds = if lobe { &kinds[..kinds.len() - 1] } else { kinds };
    let read = table.require("type", |item| item.choice(kinds, &[]))?;
    let phase = read(table);
    table.finish()?;
    phase
}

fn mixture(item: &Item) -> Read<Phase> {
    // How far the weights' sum may be off, for weights such as 0.333333.
    const TOLERANCE: f64 = 1e-6;
    let lobes = item.array("a list of phase functions, each with a `weight`")?;
    let lobes = all(&lobes, |item| {
        let table = item.table()?;
        let weight = table.require("weight", |item| item.within(0.0, 1.0));
        let phase = phase(&table, true);
        Ok((weight?, phase?))
    })?;
    let sum: f64 = lobes.iter().map(|(weight, _)| weight).sum();
    if (sum - 1.0).abs() > TOLERANCE {
        return Err(item.fail(format!("the weights sum to {sum}; expected 1")));
    }
    Ok(Mixture::new(lobes.into_iter().map(|(weight, phase)| (weight / sum, phase)).collect()).into())
}

/// More octaves would be finer than any grid of voxels that fits into memory.
const MOST_OCTAVES: i128 = 12;

fn density(table: &Table, names: &Names) -> Read<(Density, Precision)> {
    type Reader = fn(&Table, &Names) -> Read<(Density, Precision)>;
    let kinds: [(&str, Reader); 5] =
        [("constant", constant), ("vdb", vdb), ("array", array), ("exponential", exponential), ("noise", noise)];
    let read = table.require("type", |item| item.choice(&kinds, &[]))?;
    read(table, names)
}

/// How exactly voxels are kept.
fn precision(table: &Table) -> Read<Precision> {
    let choices = [("full", Precision::Full), ("half", Precision::Half)];
    table.get_or("precision", Precision::Full, |item| item.choice(&choices, &[]))
}

fn constant(table: &Table, _: &Names) -> Read<(Density, Precision)> {
    let value = table.get_or("value", 1.0, Item::non_negative);
    table.finish()?;
    Ok((Density::Constant { value: value? }, Precision::Full))
}

fn vdb(table: &Table, names: &Names) -> Read<(Density, Precision)> {
    let file = table.require("file", |item| item.file(names.folder, &["vdb"]));
    let grid = table.get("grid", Item::located_string);
    let transform = table.get_or("transform", DAffine3::IDENTITY, transform);
    let interpolation = table.get_or("interpolation", Interpolation::Trilinear, |item| {
        let options = [("trilinear", Interpolation::Trilinear), ("nearest", Interpolation::Nearest)];
        item.choice(&options, &[])
    });
    let negative = table.get_or("negative", NegativePolicy::Error, |item| {
        item.choice(&[("error", NegativePolicy::Error), ("zero", NegativePolicy::Zero)], &[])
    });
    let precision = precision(table);
    table.finish()?;
    let density = Density::Vdb {
        file: file?,
        grid: grid?,
        transform: transform?,
        interpolation: interpolation?,
        negative: negative?,
    };
    Ok((density, precision?))
}

fn array(table: &Table, names: &Names) -> Read<(Density, Precision)> {
    let file = table.require("file", |item| item.file(names.folder, &["npy"]));
    let corners = super::corners(table);
    let precision = precision(table);
    table.finish()?;
    let (min, max) = corners?;
    Ok((Density::Array { file: file?, min, max }, precision?))
}

fn exponential(table: &Table, _: &Names) -> Read<(Density, Precision)> {
    let origin = table.get_or("origin", DVec3::ZERO, Item::vector);
    let up = table.get_or("up", DVec3::Y, Item::nonzero_vector);
    let scale_height = table.require("scale_height", Item::length);
    let value = table.get_or("value", 1.0, Item::non_negative);
    table.finish()?;
    let air = Exponential { origin: origin?, up: up?, scale_height: scale_height?, value: value? };
    Ok((Density::Exponential(air), Precision::Full))
}

fn noise(table: &Table, _: &Names) -> Read<(Density, Precision)> {
    let noise = noise_of(table, 0.5);
    let precision = precision(table);
    table.finish()?;
    Ok((Density::Noise(noise?), precision?))
}

/// The keys of noise.
pub(super) fn noise_of(table: &Table, threshold: f64) -> Read<Noise> {
    let scale = table.get_or("scale", 1.0, Item::length);
    let octaves = table.get_or("octaves", 4, |item| item.integer(1, MOST_OCTAVES));
    let threshold = table.get_or("threshold", threshold, |item| item.half_open(0.0, 1.0));
    let seed = table.get_or("seed", 0, |item| item.u32(0));
    Ok(Noise { scale: scale?, octaves: octaves?, threshold: threshold?, seed: seed? })
}

fn emission(table: &Table) -> Read<MediumEmission> {
    let radiance = table.get("radiance", Item::colour);
    let temperature = table.get("temperature", Item::located_string);
    let grid = table.get("grid", Item::located_string);
    let scale = table.get_or("scale", 1.0, Item::non_negative);
    let kelvin_scale = table.get("kelvin_scale", Item::positive);
    table.finish()?;
    let (scale, kelvin_scale) = (scale?, kelvin_scale?);
    let emission = match (radiance?, temperature?, grid?) {
        (Some(radiance), None, None) => MediumEmission::Constant { radiance: radiance * scale },
        (None, Some(temperature), None) => {
            let kelvin_scale = kelvin_scale.unwrap_or(1.0);
            return Ok(MediumEmission::BlackBody { temperature, kelvin_scale, scale });
        }
        (None, None, Some(name)) => MediumEmission::Grid { radiance: NamedGrid { name, scale } },
        (None, None, None) => return Err(table.missing("", "needs `radiance`, `temperature` or `grid`")),
        (Some(_), ..) => {
            return Err(table.fail_at("radiance", "is given beside another source; expected only one of them"));
        }
        (None, ..) => return Err(table.fail_at("grid", "`temperature` is given too; expected only one of them")),
    };
    match kelvin_scale {
        None => Ok(emission),
        Some(_) => Err(table.fail_at("kelvin_scale", "has no meaning here; expected it beside `temperature` only")),
    }
}
