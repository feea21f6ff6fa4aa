//! Which passes and structures a render has.

use std::sync::Arc;

use super::Item;
use super::sample::{Expected, Samples};
use crate::gather::Reach;
use crate::geometry::Shape;
use crate::math::Rgb;
use crate::photon::{Ball, Radius};
use crate::render::adaptive::Sounding;
use crate::render::choice::Choice;
use crate::render::eternity;
use crate::render::eye::Component;
use crate::render::forced::Forced;
use crate::render::irradiance::most_records;
use crate::render::limits::Limits;
use crate::render::numbers::{
    why_no_caustic_photons, why_no_flux, why_no_global_photons, why_no_irradiance_cache, why_no_irradiances,
    why_no_photons, why_no_shadow_photons, why_no_volume_photons,
};
use crate::render::peaks;
use crate::render::plan::Plan;
use crate::scene::description::{Boundaries, Indirect, Method, SingleScattering};
use crate::scene::{Scene, Settings};
use crate::surface::{Bsdf, Dielectric, Material};

/// Why there is something, or why not.
type Why = std::result::Result<String, String>;

/// Items, as they are found.
struct Items(Vec<Item>);

impl Items {
    fn add(&mut self, name: &'static str, why: Why) -> &mut Item {
        let (needed, why) = match why {
            Ok(why) => (true, why),
            Err(why) => (false, why),
        };
        self.0.push(Item { name, needed, why, ..Item::default() });
        let last = self.0.len() - 1;
        &mut self.0[last]
    }

    /// Notes that an item is there all the same, with these numbers, if it is not needed.
    fn force(&mut self, name: &str, Item { count, emitted, events, bytes, .. }: Item) {
        if let Some(item) = self.0.iter_mut().find(|item| item.name == name && !item.needed) {
            (item.forced, item.count, item.emitted, item.events, item.bytes) = (true, count, emitted, events, bytes);
        }
    }

    /// Photons of a map: as many as were found to come, or as are wanted.
    fn photons(&mut self, name: &'static str, why: Why, wanted: u64, found: Option<&Expected>) {
        let why = match found.and_then(|found| found.why_none) {
            Some(why_none) => Err(why_none.to_string()),
            None => why,
        };
        let item = self.add(name, why);
        if item.needed {
            item.count = Some(found.map_or(wanted, |found| found.stored));
            item.emitted = found.map(|found| found.emitted);
            item.events = found.map(|found| found.events).filter(|events| *events > 0);
        }
    }
}

impl Item {
    /// Tells how many there are, if there are any.
    fn of(&mut self, count: impl TryInto<u64>) -> &mut Item {
        if self.needed {
            self.count = count.try_into().ok();
        }
        self
    }

    /// Tells what they take, if that is known.
    fn takes(&mut self, bytes: Option<u64>) {
        if self.needed {
            self.bytes = bytes;
        }
    }
}

/// There is something, for a reason, unless there is one why not.
fn unless(why_not: Option<&str>, why: impl Into<String>) -> Why {
    why_not.map_or_else(|| Ok(why.into()), |why_not| Err(why_not.to_string()))
}

/// There is something for a reason if that holds; else there is not, for another.
fn whether(holds: bool, why: impl Into<String>, why_not: impl Into<String>) -> Why {
    if holds { Ok(why.into()) } else { Err(why_not.into()) }
}

/// All items of a planned render. Without `samples` those are left out which only these tell.
pub(super) fn of(
    scene: &Scene,
    settings: &Settings,
    limits: &Limits,
    (plan, choice): (&Plan, Option<&Choice>),
    samples: Option<&Samples>,
) -> Vec<Item> {
    let mut items = Items(Vec::new());
    pilots(&mut items, plan, choice);
    photons(&mut items, (scene, settings), plan, samples);
    in_media(&mut items, (scene, settings), plan, samples);
    on_surfaces(&mut items, (scene, settings), plan, samples);
    rays(&mut items, (scene, settings), plan, samples);
    of_scene(&mut items, scene, plan);
    film(&mut items, settings, limits, plan);
    forced(&mut items, plan, samples.and_then(|samples| samples.unread.as_deref()));
    items.0
}

fn pilots(items: &mut Items, plan: &Plan, choice: Option<&Choice>) {
    let why_not = "the scene names a method, or says how photons are to be used";
    items.add("method_choice", whether(choice.is_some(), "the scene leaves the method to the plan", why_not));
    let why_not = eternity::why_no_pilot(plan.method, plan.max_events);
    items.add("eternity_pilot", unless(why_not, "some walks tell whether light comes to an end"));
    let why_not = (plan.importons.is_none() || plan.only_forces(Forced::Importons))
        .then(|| why_no_photons(plan.method).unwrap_or("photons.importance is false"));
    let item = items.add("importons", unless(why_not, "photons are kept by how much they count in the picture"));
    if let Some(importons) = &plan.importons {
        item.of(importons.count());
    }
}

fn photons(items: &mut Items, (scene, settings): (&Scene, &Settings), plan: &Plan, samples: Option<&Samples>) {
    let found = |of: fn(&Samples) -> &Option<Expected>| samples.and_then(|samples| of(samples).as_ref());
    let (volume, caustic) = (found(|samples| &samples.volume), found(|samples| &samples.caustic));
    let (global, shadow) = (found(|samples| &samples.global), found(|samples| &samples.shadow));
    let why = unless(why_no_volume_photons(scene, settings), "media scatter light");
    items.photons("volume_photons", why, plan.volume_photons, volume);
    let why = unless(why_no_caustic_photons(scene, settings), "light is mirrored or refracted onto surfaces");
    items.photons("caustic_photons", why, plan.caustic_photons, caustic);
    let why = unless(why_no_global_photons(scene, settings), "surfaces get light from one another");
    items.photons("global_photons", why, plan.global_photons, global);
    let why = unless(why_no_shadow_photons(scene, settings), "they tell where no shadow ray is needed");
    items.photons("shadow_photons", why, plan.shadow_photons, shadow);

    let any = [plan.volume_photons, plan.caustic_photons, plan.global_photons].iter().any(|photons| *photons > 0);
    let none = (!any).then(|| why_no_photons(plan.method).unwrap_or("no photons are traced"));
    if samples.is_some() {
        let aimed: Vec<&str> = [(volume, "volume"), (caustic, "caustic"), (global, "global")]
            .into_iter()
            .filter_map(|(found, name)| found?.aimed.then_some(name))
            .collect();
        let why_not = none.or(match () {
            () if !plan.emission.aims => Some("photons.projection is false"),
            () => aimed.is_empty().then_some("as many photons are of use that are not aimed"),
        });
        items.add("projection_maps", unless(why_not, format!("photons are aimed: {}", aimed.join(", "))));
        let none = (plan.volume_photons == 0).then_some("there are no volume photons");
        let forced = volume.is_some_and(|found| found.forced);
        let why_not = none.or((!forced).then_some("enough photons collide by chance"));
        items.add("forced_collisions", unless(why_not, "less than a hundredth of the photons would collide"));
    }
    let why_not = none.or((!plan.density_control).then_some("photons.density_control is false"));
    let on = if plan.controls_media { "" } else { " on surfaces; media scatter light by where it comes from" };
    items.add(
        "density_control",
        unless(why_not, format!("photons hand power to neighbours where they lie closest{on}")),
    );
}

/// How photons of a map are spread, in words.
fn spread(radius: Radius) -> String {
    match radius {
        Radius::Fixed(radius) => format!("of radius {radius:.3}"),
        Radius::Variable { neighbours, pilot, max_radius } => {
            format!("that hold {neighbours} photons, by the {pilot} nearest, of radius {max_radius:.3} at most")
        }
    }
}

/// How photons on surfaces are looked up, in words.
fn looked_up(reach: Reach) -> String {
    match reach {
        Reach::Ball { ball: Ball::Nearest { neighbours, max_radius }, .. } => {
            format!("{neighbours} nearest photons, within {max_radius:.3}")
        }
        Reach::Ball { ball: Ball::Fixed(radius), .. } => format!("photons within {radius:.3}"),
        Reach::Sheets { neighbours, max_radius } => {
            format!("sheets that hold {neighbours} photons, of radius {max_radius:.3} at most")
        }
    }
}

fn in_media(items: &mut Items, (scene, settings): (&Scene, &Settings), plan: &Plan, samples: Option<&Samples>) {
    let found = samples.and_then(|samples| samples.volume.as_ref());
    let why_none = found.and_then(|found| found.why_none).or_else(|| why_no_volume_photons(scene, settings));
    let mut kind = match &plan.points {
        None => format!("discs {}", spread(plan.radius)),
        Some(_) => format!("balls {}, for points of marched rays", spread(plan.radius)),
    };
    if let Some(Expected { radius, .. }) = found
        && plan.points.is_none()
    {
        kind += &format!("; {radius:.3} on average");
    }
    items.add("volume_map", unless(why_none, kind)).takes(found.map(|found| found.bytes));
    if let Some(found) = found {
        let even = (!found.directions).then_some("all media scatter light alike in all directions");
        items.add("photon_directions", unless(why_none.or(even), "light is scattered by where it comes from"));
        let grey = (!found.colours).then_some("the power of each photon is the same in all channels");
        items.add("photon_colours", unless(why_none.or(grey), "photons have a power for each channel"));
        let why_not = why_none.or(match () {
            () if plan.points.is_some() => Some("points of marched rays look up all photons"),
            () if !plan.spreads || plan.only_forces(Forced::SparseVolumeMap) => Some("surfaces spread no rays"),
            () => (found.sparse == 0).then_some("all photons are few"),
        });
        let item =
            items.add("sparse_volume_map", unless(why_not, "fewer photons are enough for rays that surfaces spread"));
        item.of(found.sparse_photons).takes(Some(found.sparse));
        let boundaries = (plan.boundaries == Boundaries::None).then_some("volume.boundaries is \"none\"");
        let points = plan.points.is_some().then_some("balls know how far the nearest surface is, and no more");
        let why_not = why_none.or(boundaries).or(points);
        let no_walls = (found.walls == 0).then_some("no disc is cut by planes near it");
        let item = items.add("walls", unless(why_not.or(no_walls), "discs near surfaces are cut"));
        item.takes(Some(found.walls));
        let no_leaning = (!found.leans).then_some("no discs are wide against mean free paths of a bounded medium");
        items.add("leaning_discs", unless(why_not.or(no_leaning), "discs lie along the boundary of dense media"));
    }
    let single = match plan.single_scattering {
        SingleScattering::Photons => Err("photons bring it (volume.single_scattering)".to_string()),
        SingleScattering::Traced => Ok("shadow rays ask lights for it".to_string()),
        SingleScattering::Approximate => Ok("shadow rays ask lights for it, straight through boundaries".to_string()),
    };
    let scatters = scene.media.iter().any(|medium| medium.scatters());
    let none = why_no_photons(plan.method).or((!scatters).then_some("no medium scatters"));
    items.add("traced_single_scattering", none.map_or(single, |why| Err(why.to_string())));
    let peaks = plan.peaks.iter().flatten().count() as u64;
    let none = why_no_volume_photons(scene, settings);
    let why_not = none.or_else(|| (peaks == 0).then(|| peaks::why_none(&settings.volume)));
    items.add("peak_paths", unless(why_not, "paths go on within the peaks of phase functions")).of(peaks);
}

fn on_surfaces(items: &mut Items, (scene, settings): (&Scene, &Settings), plan: &Plan, samples: Option<&Samples>) {
    let found = |of: fn(&Samples) -> &Option<Expected>| samples.and_then(|samples| of(samples).as_ref());
    let (caustic, global) = (found(|samples| &samples.caustic), found(|samples| &samples.global));
    let why_none = |found: Option<&Expected>| found.and_then(|found| found.why_none);
    let why_not = why_none(caustic).or_else(|| why_no_caustic_photons(scene, settings));
    let item = items.add("caustic_map", unless(why_not, looked_up(plan.caustics.0)));
    item.takes(caustic.map(|found| found.bytes));
    let why_not = why_none(global).or_else(|| why_no_global_photons(scene, settings));
    let item = items.add("global_map", unless(why_not, looked_up(plan.global.reach)));
    item.takes(global.map(|found| found.bytes));
    let why_not = why_none(global).or_else(|| why_no_irradiances(scene, settings));
    let each = format!("known beforehand at one of {} global photons", plan.global.precomputed);
    items.add("irradiances", unless(why_not, each)).takes(global.map(|found| found.irradiances));

    // What keeps light that is gathered.
    let why_not = why_no_irradiance_cache(scene, settings);
    let no_flux = why_none(global).or_else(|| why_no_flux(scene, settings));
    items.add("flux_map", unless(no_flux, "photons tell where gather rays go")).takes(global.map(|found| found.flux));
    let (why, most) = match &plan.cache {
        Some(cache) => {
            let why = format!("as many records as it takes, this many at most, of {} gather rays each", cache.rays());
            (why, most_records((settings.film.width, settings.film.height), plan.samples, cache))
        }
        None => (String::new(), 0),
    };
    items.add("irradiance_cache", unless(why_none(global).or(why_not), why)).of(most);
    let shadow = found(|samples| &samples.shadow);
    let item = items.add("visibility_map", unless(why_no_shadow_photons(scene, settings), "cells of shadow photons"));
    item.takes(shadow.map(|found| found.bytes));
}

fn rays(items: &mut Items, (scene, settings): (&Scene, &Settings), plan: &Plan, samples: Option<&Samples>) {
    let paths = |(width, height): (u32, u32)| u64::from(width) * u64::from(height) * u64::from(plan.samples);
    items.add("camera_paths", Ok(format!("{} a pixel", plan.samples))).of(paths(settings.film.size()));
    let why_not = (plan.method == Method::Light).then_some("light paths are as many for all pixels");
    let why_not = why_not.or((!settings.render.adaptive).then_some("render.adaptive is false"));
    let why_not = why_not.or(Sounding::new(plan.samples).is_none().then_some("a pixel has too few samples"));
    items.add("adaptive_sampling", unless(why_not, "more of them where there is noise"));
    // A window gets its light from paths all over the film.
    let all = paths((settings.film.width, settings.film.height));
    let why_not = (plan.method != Method::Light).then_some("the method is another");
    items.add("light_paths", unless(why_not, format!("{} for each pixel of the film", plan.samples))).of(all);
    // Where there is no global map, paths go on, unless media send light to surfaces.
    let gathers = plan.indirect == Indirect::FinalGather;
    let global = samples.and_then(|samples| samples.global.as_ref());
    let no_map = global.filter(|found| !found.from_media_only).and_then(|found| found.why_none);
    let why_not = why_no_photons(plan.method)
        .or((!gathers).then_some("surface.indirect is another"))
        .or_else(|| why_no_global_photons(scene, settings))
        .or(no_map);
    let why =
        format!("{} from the first surface of a path that spreads light, where no record tells", plan.gather_rays);
    items.add("gather_rays", unless(why_not, why));
    let why_not = match plan.method {
        Method::Path => (!plan.split || plan.only_forces(Forced::PathSplitting))
            .then_some("collisions are not rare, or there are none"),
        _ => Some("the method is another"),
    };
    items.add("path_splitting", unless(why_not, "collisions are rare: paths go on past and from each"));
    let emitters = scene.emitters.in_tree();
    let why_not = emitters.is_none().then_some("lights are few, and are weighed one by one");
    items.add("light_tree", unless(why_not, "lights are many")).of(emitters.unwrap_or(0) as u64);
}

fn of_scene(items: &mut Items, scene: &Scene, plan: &Plan) {
    let media = &scene.media;
    let voxels = media.iter().filter(|medium| medium.density.has_voxels()).count();
    let no_media = media.is_empty().then_some("there is no medium");
    let closed = (voxels == 0).then_some("densities have closed forms");
    let item = items.add("voxels", unless(no_media.or(closed), "densities are kept in bricks"));
    item.of(voxels as u64).takes(Some(crate::medium::bytes(media)));
    let why = "local ones, by brick: free flights through voxels";
    items.add("majorants", unless(no_media.or(closed), why));
    let uneven = media.iter().any(|medium| medium.scatters() && !medium.density.is_even());
    let why_not = no_media.or(match () {
        () if plan.volume_photons == 0 => Some("there is no volume map"),
        () if plan.points.is_some() => Some("rays are marched"),
        () => (!uneven).then_some("depths along rays have a closed form"),
    });
    items.add("depth_tables", unless(why_not, "optical depths along rays that gather, tabulated and interpolated"));
    let chromatic = media.iter().any(|medium| medium.extinction != Rgb::splat(medium.extinction.x));
    let why_not = no_media.or((!chromatic).then_some("media fade all channels alike"));
    items
        .add("spectral_weights", unless(why_not, "media fade channels differently: flights are drawn for all of them"));
    let distances = scene.distances.iter().flatten().count();
    let why_not = no_media.or((distances == 0).then_some("light does not wander in a dense medium of one density"));
    items
        .add("distance_fields", unless(why_not, "flights in dense media ask whether a surface is near"))
        .of(distances as u64);
    let solids = scene.solids.len();
    let why_not = (solids == 0).then_some("no solid fills space: one medium, or none, is everywhere");
    let item = items.add("medium_ids", unless(why_not, "solids decide what is where"));
    item.of(scene.regions);
    let overlaps = scene.overlaps.len();
    let why_not = (overlaps == 0).then_some("no media add up where solids overlap");
    items.add("overlaps", unless(why_not, "media add up")).of(overlaps as u64);

    // What surfaces are made of.
    let any = |holds: &dyn Fn(&Material) -> bool| scene.any_material(&|material: &Material| holds(material));
    let refracts = |material: &Material| match material {
        Material::Dielectric(_) => true,
        Material::Opaque(bsdf) => matches!(bsdf, Bsdf::Coated(_) | Bsdf::Thin(_)),
        Material::None | Material::Mixture(_) => false,
    };
    let why_not = (!any(&refracts)).then_some("nothing refracts, and nothing has a coat");
    items.add("fresnel", unless(why_not, "boundaries reflect a part and refract the rest"));
    let disperses = |material: &Material| material.index().is_some_and(|index| Dielectric::disperses(Rgb::ONE, index));
    let why_not = (!any(&disperses)).then_some("no index of refraction differs between channels");
    items.add("dispersion", unless(why_not, "channels go apart where they are refracted"));
    let why_not = scene.paints.is_empty().then_some("materials are the same all over");
    items.add("textures", unless(why_not, "materials change over surfaces")).of(scene.paints.len() as u64);
    let why_not = scene.finishes.is_empty().then_some("no material is a mixture");
    items
        .add("mixtures", unless(why_not, "one of two materials wherever light meets them"))
        .of(scene.finishes.len() as u64);
    let shared = instances(scene);
    let why_not = (shared == 0).then_some("no mesh or lathe stands in several places");
    items.add("instances", unless(why_not, "meshes and lathes are kept once for all places they stand in")).of(shared);
}

/// Placed shapes that share a mesh or a lathe with one before them.
fn instances(scene: &Scene) -> u64 {
    let mut seen: Vec<*const ()> = Vec::new();
    let all = scene.geometry.placed().iter().filter_map(|placed| match placed.shape() {
        Shape::Mesh(mesh) => Some(Arc::as_ptr(mesh).cast()),
        Shape::Lathe(lathe) => Some(Arc::as_ptr(lathe).cast()),
        _ => None,
    });
    seen.extend(all);
    let count = seen.len();
    seen.sort_unstable();
    seen.dedup();
    (count - seen.len()) as u64
}

fn film(items: &mut Items, settings: &Settings, limits: &Limits, plan: &Plan) {
    let item = items.add("film", Ok("sums of each pixel, and what the picture is made of".to_string()));
    item.takes(Some(limits.film_bytes(settings, plan.parts)));
    let why =
        whether(settings.film.layers, "one for each kind of light, and what is seen first", "film.layers is false");
    items.add("film_layers", why).of(Component::ALL.len() as u64);
    let why = "passes are summed exactly, with their squares for the standard error";
    let sums = limits.sums_passes(settings, plan.parts) && !plan.only_forces(Forced::PassSums);
    items.add("pass_sums", whether(sums, why, "there is a single pass"));
}

/// What is there though it is not needed.
fn forced(items: &mut Items, plan: &Plan, unread: Option<&Samples>) {
    for forced in &plan.forced {
        let count = match forced {
            Forced::Importons => plan.importons.as_ref().map(|importons| importons.count() as u64),
            Forced::FilmLayers => Some(Component::ALL.len() as u64),
            _ => None,
        };
        items.force(forced.name(), Item { count, ..Item::default() });
    }
    // Photons with what is made of them.
    let Some(unread) = unread else { return };
    for (photons, map, found) in [
        ("volume_photons", "volume_map", &unread.volume),
        ("caustic_photons", "caustic_map", &unread.caustic),
        ("global_photons", "global_map", &unread.global),
        ("shadow_photons", "visibility_map", &unread.shadow),
    ] {
        let Some(Expected { stored, emitted, events, bytes, irradiances, flux, .. }) = *found else { continue };
        let events = (events > 0).then_some(events);
        items.force(photons, Item { count: Some(stored), emitted: Some(emitted), events, ..Item::default() });
        for (of, bytes) in [(map, bytes), ("irradiances", irradiances), ("flux_map", flux)] {
            if bytes > 0 {
                items.force(of, Item { bytes: Some(bytes), ..Item::default() });
            }
        }
    }
}
