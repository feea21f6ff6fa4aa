//! From the text of a scene file to its [`Description`].

mod lights;
mod materials;
mod media;
mod shapes;
mod textures;
mod transform;
mod warnings;

use std::path::Path;
use std::sync::Arc;

use super::description::{
    Boundaries, Camera, Description, Document, Estimate, Film, Filter, FovAxis, GatherDirections, Indirect, Kernel,
    March, Method, Peaks, PhotonEmission, Photons, Profile, Projection, Quality, Records, Render, SingleScattering,
    Step, Surface, SurfaceEstimate, SurfaceFilter, ToneMap, Unit, Volume, Window, World,
};
use super::table::{Item, Problems, Read, Table, unit};
use super::text::text_of;
use super::tree::Node;
use super::{overrides, study, tree};
use crate::math::DVec3;
use crate::{Error, Result};

/// The most pixels a film may have.
const MOST_PIXELS: u64 = 1 << 31;

/// Reads the scene file at `path` with `overrides` of the form `key=value` applied in order.
///
/// # Errors
///
/// [`Error::Asset`] if the file cannot be read or is no text; [`Error::Scene`] with one line for each
/// mistake in it: file, line, column, key, what was found and what was expected.
pub fn read(path: &Path, overrides: &[String]) -> Result<Description> {
    parse(&text_of(path)?, path, overrides)
}

/// Reads the text of a scene file; `path` is what errors call it and what file names are resolved against.
///
/// # Errors
///
/// [`Error::Scene`], as [`read()`].
pub fn parse(text: &str, path: &Path, overrides: &[String]) -> Result<Description> {
    let document = Document { name: path.display().to_string(), text: text.to_owned() };
    let mut root = tree::parse(&Arc::new(document))?;
    let problems = Problems::default();
    for text in overrides {
        overrides::apply(&mut root, text, &problems);
    }
    described(&root, &problems, path)
}

/// Reads the tree of a scene file; with the problems that there are already.
pub(super) fn described(root: &Node, problems: &Problems, path: &Path) -> Result<Description> {
    let description = Item::root(root, problems).table().and_then(|table| describe(&table, path));
    problems.check()?;
    // A value that could not be read has left a problem behind.
    description.map_err(|_| Error::Scene(format!("{}: cannot be read", path.display())))
}

/// What the names in one scene file refer to.
struct Names<'a> {
    /// The folder that file names are relative to.
    folder: &'a Path,
    media: Vec<&'a str>,
    materials: Vec<&'a str>,
}

fn describe(root: &Table, path: &Path) -> Read<Description> {
    let title = root.get("title", |item| item.string().map(str::to_owned));
    let film = root.section("film").and_then(|table| film(&table));
    let camera = root.require("camera", |item| camera(&item.table()?));
    let world_table = root.section("world");
    let media_table = root.section("media");
    let materials_table = root.section("materials");
    let shape_items = root.get("shapes", |item| item.array("an array of tables, [[shapes]]"));
    let light_items = root.get("lights", |item| item.array("an array of tables, [[lights]]"));
    let tables = ["photons", "volume", "surface"].map(|name| root.section(name));
    // Who says how photons are to be used wants photons.
    let says = tables.iter().flatten().any(|table| !table.items().is_empty());
    let render = root.section("render").and_then(|table| render(&table, says));
    let [of_photons, of_volume, of_surface] = tables;
    let photons = of_photons.and_then(|table| photons(&table));
    let volume = of_volume.and_then(|table| volume(&table));
    let surface = of_surface.and_then(|table| surface(&table));
    let compare = root.get("compare", |item| {
        let table = item.table()?;
        match study::study(&table, path.parent().unwrap_or(Path::new("")))?.scene {
            None => Ok(()),
            Some(_) => Err(table.fail_at("scene", "this file is a study of another scene: give it to `volpm compare`")),
        }
    });
    let finished = root.finish();

    let (media_items, material_items) = (media_table?.items(), materials_table?.items());
    let names = Names {
        folder: path.parent().unwrap_or(Path::new("")),
        media: media_items.iter().map(|(name, _)| *name).collect(),
        materials: material_items.iter().map(|(name, _)| *name).collect(),
    };
    let world_table = world_table?;
    let world = world(&world_table, &names);
    let unit = world.as_ref().map_or(Unit::Metre, |world| world.unit);
    let media = all(&media_items, |(name, item)| media::medium(name, item, &names, unit));
    if let (Ok(World { medium: Some(medium), .. }), Ok(media)) = (&world, &media)
        && media[medium.value].density.fills_shapes()
    {
        return Err(world_table.fail_at(
            "medium",
            format!(
                "{:?} has a density of noise, which has no end; expected it as the `interior` of shapes",
                media[medium.value].name
            ),
        ));
    }
    let known = materials::Materials::new(&names, &material_items);
    let materials = all(&material_items, |(name, item)| materials::material(name, item, &known));
    let materials = materials.and_then(|materials| known.with_parts(materials));
    let shapes = shapes::shapes(&shape_items?.unwrap_or_default(), &names);
    let lights = lights::lights(&light_items?.unwrap_or_default(), &names);

    let surface = surface?;
    compare.map(|_: Option<()>| ()).and(finished)?;
    let (mut materials, media) = (materials?, media?);
    let shapes = shapes::finish(shapes?, &mut materials, &names)?;
    let mut description = Description {
        path: path.to_owned(),
        title: title?,
        film: film?,
        camera: camera?,
        world: world?,
        media,
        materials,
        shapes,
        lights: lights?,
        render: render?,
        photons: photons?,
        volume: volume?,
        surface,
        warnings: Vec::new(),
    };
    description.warnings = warnings::warnings(&description);
    Ok(description)
}

/// Reads every item, so that all problems are noted, before the first failure counts.
fn all<I, T>(items: &[I], read: impl FnMut(&I) -> Read<T>) -> Read<Vec<T>> {
    let results: Vec<Read<T>> = items.iter().map(read).collect();
    results.into_iter().collect()
}

/// The value of exactly one of two keys.
enum Either<A, B> {
    First(A),
    Second(B),
}

/// Reads `first` or `second` of `table`, of which there must be exactly one.
fn either<'a, A, B>(
    table: &Table<'a>,
    (first, read_first): (&'static str, impl FnOnce(&Item<'a>) -> Read<A>),
    (second, read_second): (&'static str, impl FnOnce(&Item<'a>) -> Read<B>),
) -> Read<Either<A, B>> {
    let (a, b) = (table.get(first, read_first), table.get(second, read_second));
    match (a?, b?) {
        (Some(a), None) => Ok(Either::First(a)),
        (None, Some(b)) => Ok(Either::Second(b)),
        (None, None) => Err(table.missing("", format!("needs `{first}` or `{second}`"))),
        (Some(_), Some(_)) => Err(table.fail_at(second, format!("`{first}` is given too; expected only one of them"))),
    }
}

/// `min` and `max`, which must be below on every axis.
fn corners(table: &Table) -> Read<(DVec3, DVec3)> {
    let (min, max) = (table.require("min", Item::vector), table.require("max", Item::vector));
    let (min, max) = (min?, max?);
    if min.cmplt(max).all() {
        Ok((min, max))
    } else {
        Err(table.fail_at("max", format!("found {max}; expected a point above `min`, {min}, on every axis")))
    }
}

fn film(table: &Table) -> Read<Film> {
    let width = table.get_or("width", 640, |item| item.u32(1));
    let height = table.get_or("height", 480, |item| item.u32(1));
    let crop = table.get("crop", |item| Ok((item.clone(), window(item)?)));
    let filter = table.get_or("filter", Filter::Box, |item| {
        item.choice(&[("box", Filter::Box), ("tent", Filter::Tent), ("gaussian", Filter::Gaussian)], &[])
    });
    let exposure = table.get("exposure", Item::number);
    let tone_map = table.get_or("tone_map", ToneMap::Filmic, |item| {
        item.choice(&[("linear", ToneMap::Linear), ("filmic", ToneMap::Filmic)], &[])
    });
    let layers = table.get_or("layers", true, Item::boolean);
    let standard_error = table.get_or("standard_error", false, Item::boolean);
    table.finish()?;
    let (width, height) = (width?, height?);
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MOST_PIXELS {
        // Three channels of 32 bits.
        let gib = |pixels: u64| pixels as f64 * 12.0 / (1u64 << 30) as f64;
        return Err(table.fail_at(
            "width",
            format!(
                "{width} × {height} pixels take {:.0} GiB for their colours alone; expected at most {MOST_PIXELS} pixels ({:.0} GiB)",
                gib(pixels),
                gib(MOST_PIXELS),
            ),
        ));
    }
    let crop = match crop? {
        Some((item, Window { x, y, width: w, height: h }))
            if u64::from(x) + u64::from(w) > width.into() || u64::from(y) + u64::from(h) > height.into() =>
        {
            return Err(
                item.expected(format!("a part of the film of {width} × {height} pixels, [x, y, width, height]"))
            );
        }
        crop => crop.map(|(_, window)| window),
    };
    Ok(Film {
        width,
        height,
        crop,
        filter: filter?,
        exposure: exposure?,
        tone_map: tone_map?,
        layers: layers?,
        standard_error: standard_error?,
    })
}

/// `[x, y, width, height]`
fn window(item: &Item) -> Read<Window> {
    let expected = "four integers, [x, y, width, height]";
    let items = item.array(expected)?;
    let [x, y, width, height] = items.as_slice() else { return Err(item.expected(expected)) };
    let (x, y, width, height) = (x.u32(0), y.u32(0), width.u32(1), height.u32(1));
    Ok(Window { x: x?, y: y?, width: width?, height: height? })
}

fn camera(table: &Table) -> Read<Camera> {
    let position = table.require("position", Item::vector);
    let target = table.require("target", Item::vector);
    let up = table.get_or("up", DVec3::Y, Item::vector);
    let projections = [("perspective", Projection::Perspective), ("orthographic", Projection::Orthographic)];
    let projection = table.get_or("projection", Projection::Perspective, |item| item.choice(&projections, &[]));
    let fov = table.get_or("fov", 40.0, |item| item.between(0.0, 180.0));
    let axes = [("y", FovAxis::Y), ("x", FovAxis::X), ("smaller", FovAxis::Smaller)];
    let fov_axis = table.get_or("fov_axis", FovAxis::Y, |item| item.choice(&axes, &[]));
    let aperture = table.get_or("aperture", 0.0, Item::length_or_zero);
    let focus_distance = table.get("focus_distance", Item::length);
    table.finish()?;

    let (position, target, up) = (position?, target?, up?);
    let view = target - position;
    let Some(forward) = unit(view) else {
        return Err(table
            .fail_at("target", "is where the camera stands, or too far away; expected another point than `position`"));
    };
    // Below this angle the rows of the image would be directed by rounding.
    const PARALLEL: f64 = 1e-9;
    if unit(up).is_none_or(|up| up.cross(forward).length() < PARALLEL) {
        return Err(table.fail_at("up", format!("{up} is parallel to the view, or 0; expected another direction")));
    }
    let distance = forward.dot(view);
    Ok(Camera {
        position,
        target,
        up,
        projection: projection?,
        fov: fov?,
        fov_axis: fov_axis?,
        aperture: aperture?,
        focus_distance: focus_distance?.unwrap_or(distance),
        place: table.place(),
    })
}

fn world(table: &Table, names: &Names) -> Read<World> {
    let medium = table.get("medium", |item| Ok(item.at(item.reference("medium", &names.media)?)));
    let unit = table.get_or("unit", Unit::Metre, |item| {
        item.choice(&[("mm", Unit::Millimetre), ("cm", Unit::Centimetre), ("m", Unit::Metre)], &[])
    });
    table.finish()?;
    Ok(World { medium: medium?, unit: unit? })
}

/// Shadow rays beyond this are a mistake rather than a wish.
const MOST_LIGHT_SAMPLES: i128 = 4096;

/// `says`: whether the scene says how photons are to be used.
fn render(table: &Table, says: bool) -> Read<Render> {
    let methods: Vec<_> =
        Method::ALL.iter().map(|method| (method.name(), Some(*method))).chain([("auto", None)]).collect();
    let method = table.get_or("method", None, |item| item.choice(&methods, &[]));
    let qualities = [("draft", Quality::Draft), ("normal", Quality::Normal), ("high", Quality::High)];
    let quality = table.get_or("quality", Quality::Normal, |item| item.choice(&qualities, &[]));
    let chosen = *quality.as_ref().unwrap_or(&Quality::Normal);
    let samples = table.get_or("samples", chosen.samples(), |item| item.u32(1));
    let adaptive = table.get_or("adaptive", true, Item::boolean);
    let light_samples = table.get_or("light_samples", 1, |item| item.integer(1, MOST_LIGHT_SAMPLES));
    let passes = table.get_or("passes", chosen.passes(), |item| item.u32(1));
    let seed = table.get_or("seed", 1, |item| item.u64(0));
    let max_depth = table.get_or("max_depth", 0, |item| item.u32(0));
    table.finish()?;
    let method = method?;
    Ok(Render {
        method: method.unwrap_or(Method::Photon),
        automatic: method.is_none() && !says,
        quality: quality?,
        samples: samples?,
        adaptive: adaptive?,
        light_samples: light_samples?,
        passes: passes?,
        seed: seed?,
        max_depth: max_depth?,
    })
}

fn photons(table: &Table) -> Read<Photons> {
    let volume = table.get("volume", |item| item.u64(1));
    let global = table.get("global", |item| item.u64(0));
    let caustic = table.get("caustic", |item| item.u64(0));
    let max_emitted = table.get_or("max_emitted", 50_000_000, |item| item.u64(1));
    let projection = table.get_or("projection", true, Item::boolean);
    let ways = [("qmc", PhotonEmission::Qmc), ("random", PhotonEmission::Random)];
    let emission = table.get_or("emission", PhotonEmission::Qmc, |item| item.choice(&ways, &[]));
    let importance = table.get_or("importance", false, Item::boolean);
    let density_control = table.get_or("density_control", false, Item::boolean);
    table.finish()?;
    Ok(Photons {
        volume: volume?,
        global: global?,
        caustic: caustic?,
        max_emitted: max_emitted?,
        projection: projection?,
        emission: emission?,
        importance: importance?,
        density_control: density_control?,
    })
}

fn volume(table: &Table) -> Read<Volume> {
    let estimates = [("beam", Estimate::Beam), ("point", Estimate::Point)];
    let estimate = table.get_or("estimate", Estimate::Beam, |item| item.choice(&estimates, &[]));
    let kernel = table.get_or("kernel", Kernel::Variable, |item| {
        item.choice(&[("fixed", Kernel::Fixed), ("variable", Kernel::Variable), ("knn", Kernel::Variable)], &[])
    });
    let profiles =
        [("biweight", Profile::Biweight), ("epanechnikov", Profile::Epanechnikov), ("constant", Profile::Constant)];
    let profile = table.get("profile", |item| item.choice(&profiles, &[]));
    let radius = table.get("radius", Item::length);
    let neighbours = table.get("neighbours", |item| item.u32(1));
    let pilot = table.get("pilot", |item| item.u32(5));
    let max_radius = table.get("max_radius", Item::length);
    let ways = [
        ("photons", SingleScattering::Photons),
        ("traced", SingleScattering::Traced),
        ("approximate", SingleScattering::Approximate),
    ];
    let single_scattering =
        table.get_or("single_scattering", SingleScattering::Photons, |item| item.choice(&ways, &[]));
    let ways = [("auto", Peaks::Auto), ("paths", Peaks::Paths), ("photons", Peaks::Photons)];
    let peaks = table.get_or("peaks", Peaks::Auto, |item| item.choice(&ways, &[]));
    let march = table.get("march", |item| march(&item.table()?));
    let kinds = [("none", Boundaries::None), ("share", Boundaries::Share), ("lean", Boundaries::Lean)];
    let boundaries = table.get_or("boundaries", Boundaries::Lean, |item| item.choice(&kinds, &[]));
    table.finish()?;
    Ok(Volume {
        estimate: estimate?,
        kernel: kernel?,
        profile: profile?,
        radius: radius?,
        neighbours: neighbours?,
        pilot: pilot?,
        max_radius: max_radius?,
        boundaries: boundaries?,
        march: march?,
        single_scattering: single_scattering?,
        peaks: peaks?,
    })
}

fn march(table: &Table) -> Read<March> {
    let kinds = [
        ("uniform", Step::Uniform),
        ("adaptive", Step::Adaptive),
        ("exponential", Step::Exponential),
        ("random", Step::Random),
    ];
    let step = table.get_or("step", March::DEFAULT.step, |item| item.choice(&kinds, &[]));
    let size = table.get("size", Item::length);
    let contrast = table.get_or("contrast", March::DEFAULT.contrast, Item::positive);
    table.finish()?;
    Ok(March { step: step?, size: size?, contrast: contrast? })
}

fn surface(table: &Table) -> Read<Surface> {
    let neighbours = table.get_or("neighbours", 80, |item| item.u32(2));
    let filters = [("none", SurfaceFilter::None), ("cone", SurfaceFilter::Cone), ("gaussian", SurfaceFilter::Gaussian)];
    let filter = table.get_or("filter", SurfaceFilter::Cone, |item| item.choice(&filters, &[]));
    let caustic_radius = table.get("caustic_radius", Item::length);
    let max_radius = table.get("max_radius", Item::length);
    let ways = [
        ("final_gather", Indirect::FinalGather),
        ("map", Indirect::Map),
        ("path", Indirect::Path),
        ("none", Indirect::None),
    ];
    let indirect = table.get_or("indirect", Indirect::FinalGather, |item| item.choice(&ways, &[]));
    let estimates =
        [("knn", SurfaceEstimate::Knn), ("fixed", SurfaceEstimate::Fixed), ("sheets", SurfaceEstimate::Sheets)];
    let estimate = table.get_or("estimate", SurfaceEstimate::Knn, |item| item.choice(&estimates, &[]));
    let radius = table.get("radius", Item::length);
    let accurate_distance = table.get("accurate_distance", Item::length_or_zero);
    let gather_rays = table.get("gather_rays", |item| item.u32(1));
    let directions = [("flux", GatherDirections::Flux), ("bsdf", GatherDirections::Bsdf)];
    let gather_directions =
        table.get_or("gather_directions", GatherDirections::Flux, |item| item.choice(&directions, &[]));
    let precomputed = table.get_or("precomputed_irradiance", 4, |item| item.u32(0));
    let cache = table.get_or("irradiance_cache", true, Item::boolean);
    let spacings = [("hessian", Records::Hessian), ("split_sphere", Records::SplitSphere)];
    let records = table.get_or("records", Records::Hessian, |item| item.choice(&spacings, &[]));
    let cache_error = table.get("cache_error", Item::positive);
    let shadow_photons = table.get_or("shadow_photons", false, Item::boolean);
    let checks = |item: &Item| match item.boolean()? {
        true if matches!(estimate, Ok(SurfaceEstimate::Sheets)) => {
            Err(item.fail("sheets have radii of their own; it needs an estimate by \"knn\" or \"fixed\""))
        }
        checks => Ok(checks),
    };
    let differential_checking = table.get_or("differential_checking", false, checks);
    table.finish()?;
    let records = records?;
    Ok(Surface {
        indirect: indirect?,
        estimate: estimate?,
        radius: radius?,
        neighbours: neighbours?,
        filter: filter?,
        max_radius: max_radius?,
        caustic_radius: caustic_radius?,
        accurate_distance: accurate_distance?,
        gather_rays: gather_rays?,
        gather_directions: gather_directions?,
        precomputed_irradiance: precomputed?,
        irradiance_cache: cache?,
        shadow_photons: shadow_photons?,
        differential_checking: differential_checking?,
        records,
        cache_error: cache_error?.unwrap_or(match records {
            Records::Hessian => 0.01,
            Records::SplitSphere => 0.3,
        }),
    })
}
