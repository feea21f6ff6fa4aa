//! Numbers of photons and neighbours, where the scene file leaves them open.

use crate::photon::{Kind, served_lights, why_none_land};
use crate::scene::description::{Film, GatherDirections, Indirect, Method};
use crate::scene::{Scene, Settings};
use crate::transport::Events;

/// Photons in the volume map for each pixel of the film: to trace and order these takes about as long as sixteen camera samples.
const A_PIXEL: u64 = 32;
/// But no fewer than this, so that discs are narrow,
const FEWEST: u64 = 300_000;
/// and no more than this, beyond which more camera samples win more.
const MOST: u64 = 1_000_000;
/// As [`MOST`] where a density varies in voxels, the detail of which asks for narrow discs.
const MOST_UNEVEN: u64 = 2_000_000;

/// n of adaptive radii among [`FEWEST`] photons and more, where media scatter alike in all directions; so many times 1 − |g| for a mean cosine g, for discs blur
/// directions, too. As many on each disc: those of larger pictures are narrower. In a room of isotropic fog of 96 × 96 pixels relative squared errors are 0.0022 with 60,
/// 0.0010 with 200 and 0.0006 with 600; on a stage of narrow spots in fog of g = 0.75, 0.0063 with 60, 0.0088 with 200 and 0.018 with 600. Among fewer
/// photons n ∝ N^½, so that noise and blur grow alike: with radii r ∝ (n/N)^⅓ variance grows with 1/(N r²), squared blur with r⁴.
const NEIGHBOURS: f64 = 200.0;
/// But as many as that.
const FEWEST_NEIGHBOURS: f64 = 60.0;
/// One of so many photons where a density varies in voxels: the plume of `scenes/smoke.toml` is 0.2 % too bright with one of 10 000, 0.6 % with two and
/// 1.6 % with six.
const ONE_NEIGHBOUR_IN: u64 = 10_000;
/// But as few and as many as that.
const UNEVEN_NEIGHBOURS: [u64; 2] = [60, 200];
/// One of so many photons where all media that scatter are solids of more than [`THICK`] mean free paths. Only photons within a few mean free paths of the
/// surface count there, and only those are kept: discs are small even so, but few of them meet a ray. More neighbours make up for that: light that has
/// scattered often hardly changes within their discs.
const ONE_DENSE_NEIGHBOUR_IN: u64 = 300;
/// But as few and as many as that.
const DENSE_NEIGHBOURS: [u64; 2] = [300, 1000];
/// Solids of more mean free paths than this pass hardly any light straight.
const THICK: f64 = 100.0;

/// Photons in the caustic map, and in the global one, and shadow photons, for each pixel of the film, unless the scene file says otherwise;
const ON_SURFACES_A_PIXEL: u64 = 16;
/// but as few and as many as that. With 100 000 of each instead of 200 000 squared errors of small pictures of `scenes/jensen/box.toml` and
/// `scenes/glass-ball.toml` grow by 4 and by 0 %.
const ON_SURFACES: [u64; 2] = [100_000, 200_000];

/// Who finds light without photons, by a method that has none.
pub(super) fn why_no_photons(method: Method) -> Option<&'static str> {
    match method {
        Method::Photon => None,
        Method::Path => Some("paths find all light"),
        Method::Light => Some("light paths bring all light"),
        Method::Whitted => Some("Whitted's rays follow light straight from lights alone"),
    }
}

/// Volume photons wanted in each pass: none where nothing scatters, or nothing shines.
pub fn volume_photons(scene: &Scene, settings: &Settings) -> u64 {
    match why_no_volume_photons(scene, settings) {
        None => settings.photons.volume.unwrap_or_else(|| chosen(scene, settings)),
        Some(_) => 0,
    }
}

/// Why no volume photons are wanted; `None` where some are.
pub(super) fn why_no_volume_photons(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let Settings { render, volume, .. } = settings;
    let shines = !scene.lights.is_empty() || scene.media.iter().any(|medium| medium.glows());
    let scatters = scene.media.iter().any(|medium| medium.scatters());
    // Light that shadow rays find needs no photons, if it is all there may be.
    let once = Events::of_max_depth(render.max_depth) == Events::at_most(1);
    let asks_for_all = once && volume.single_scattering.asks_lights() && scene.glows.is_empty();
    why_no_photons(render.method).or(match () {
        () if !scatters => Some("no medium scatters"),
        () if !shines => Some("nothing shines"),
        () => asks_for_all.then_some("shadow rays find all light, as render.max_depth is 1"),
    })
}

/// Photons that suit a film and what is to be seen.
pub(super) fn chosen(scene: &Scene, settings: &Settings) -> u64 {
    let Settings { film, render, .. } = settings;
    let most = if !is_dense(scene) && is_uneven(scene) { MOST_UNEVEN } else { MOST };
    render.quality.photons(A_PIXEL.saturating_mul(pixels(film)).clamp(FEWEST, most))
}

fn pixels(film: &Film) -> u64 {
    u64::from(film.width) * u64::from(film.height)
}

/// n of adaptive radii among so many photons, unless the scene file says otherwise.
pub fn neighbours(scene: &Scene, photons: u64) -> u32 {
    let (one_in, [fewest, most]) = if is_dense(scene) {
        (ONE_DENSE_NEIGHBOUR_IN, DENSE_NEIGHBOURS)
    } else if is_uneven(scene) {
        (ONE_NEIGHBOUR_IN, UNEVEN_NEIGHBOURS)
    } else {
        let cosines =
            scene.media.iter().filter(|medium| medium.scatters()).map(|medium| medium.phase.greatest_cosine());
        let broad = 1.0 - cosines.fold(0.0, f64::max);
        let growth = (photons as f64 / FEWEST as f64).sqrt().min(1.0);
        return (NEIGHBOURS * broad * growth).max(FEWEST_NEIGHBOURS).ceil() as u32;
    };
    (photons / one_in).clamp(fewest, most) as u32
}

/// Whether a density varies in voxels where photons tell the light that passes.
fn is_uneven(scene: &Scene) -> bool {
    (0..).zip(&scene.media).any(|(index, medium)| medium.scatters() && scene.uneven(index).is_some())
}

/// Photons wanted in each pass's caustic map: none where there can be no caustics.
pub fn caustic_photons(scene: &Scene, settings: &Settings) -> u64 {
    match why_no_caustic_photons(scene, settings) {
        None => settings.photons.caustic.unwrap_or(on_surfaces(settings)),
        Some(_) => 0,
    }
}

/// Why no caustic photons are wanted; `None` where some are.
pub(super) fn why_no_caustic_photons(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let Settings { render, photons, surface, .. } = settings;
    why_no_photons(render.method).or_else(|| why_none_land(scene, Kind::Caustic)).or(match () {
        () if !Events::of_max_depth(render.max_depth).allows(1) => Some("render.max_depth is 1"),
        () if surface.indirect == Indirect::Map => Some("the global map shows them, too"),
        () => (photons.caustic == Some(0)).then_some("photons.caustic is 0"),
    })
}

/// Photons wanted in each pass's global map: none where no one looks it up.
pub fn global_photons(scene: &Scene, settings: &Settings) -> u64 {
    match why_no_global_photons(scene, settings) {
        None => settings.photons.global.unwrap_or(on_surfaces(settings)),
        Some(_) => 0,
    }
}

/// Why no global photons are wanted; `None` where some are.
pub(super) fn why_no_global_photons(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let Settings { render, photons, surface, .. } = settings;
    // Events at surfaces on the eye's side.
    let read_after = match surface.indirect {
        Indirect::Map => Ok(0),
        Indirect::FinalGather => Ok(1),
        Indirect::Path => Err("surface.indirect leaves that light to paths"),
        Indirect::None => Err("surface.indirect leaves that light out"),
    };
    let is_read = |events| Events::of_max_depth(render.max_depth).allows(events);
    why_no_photons(render.method).or_else(|| why_none_land(scene, Kind::Global)).or(match read_after {
        Err(why) => Some(why),
        Ok(events) if !is_read(events) => Some("render.max_depth is 1"),
        Ok(_) => (photons.global == Some(0)).then_some("photons.global is 0"),
    })
}

/// Why light that is gathered on surfaces is not kept and interpolated; `None` where it is.
pub(super) fn why_no_irradiance_cache(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let Settings { render, surface, .. } = settings;
    why_no_global_photons(scene, settings).or(match () {
        () if surface.indirect != Indirect::FinalGather => Some("nothing is gathered: the global map is shown"),
        // Of light with few events, what differs from place to place is how many the eye's side had.
        () if Events::of_max_depth(render.max_depth).is_limited() => Some("render.max_depth limits events"),
        () => (!surface.irradiance_cache).then_some("surface.irradiance_cache is false"),
    })
}

/// Why photons do not tell where gather rays go; `None` where they do.
pub(super) fn why_no_flux(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let surface = &settings.surface;
    why_no_global_photons(scene, settings).or(match () {
        () if surface.indirect != Indirect::FinalGather => Some("nothing is gathered: the global map is shown"),
        () => (surface.gather_directions == GatherDirections::Bsdf).then_some("surface.gather_directions is \"bsdf\""),
    })
}

/// Why the irradiance is not computed beforehand at photons of the global map; `None` where it is.
pub(super) fn why_no_irradiances(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let Settings { render, surface, .. } = settings;
    why_no_global_photons(scene, settings).or(match () {
        () if surface.indirect != Indirect::FinalGather => Some("nothing is gathered: the global map is shown"),
        // Of light with few events alone, photons have to be counted.
        () if Events::of_max_depth(render.max_depth).is_limited() => Some("render.max_depth limits events"),
        () => (surface.precomputed_irradiance == 0).then_some("surface.precomputed_irradiance is 0"),
    })
}

/// Shadow photons wanted in each pass: none where surfaces ask no light that they can serve.
pub fn shadow_photons(scene: &Scene, settings: &Settings) -> u64 {
    if why_no_shadow_photons(scene, settings).is_none() { on_surfaces(settings) } else { 0 }
}

/// Why no shadow photons are wanted; `None` where some are.
pub(super) fn why_no_shadow_photons(scene: &Scene, settings: &Settings) -> Option<&'static str> {
    let Settings { render, surface, .. } = settings;
    why_no_photons(render.method).or(match () {
        () if !surface.shadow_photons => Some("surface.shadow_photons is false"),
        () if !Events::of_max_depth(render.max_depth).allows(1) => Some("render.max_depth is 1"),
        () if surface.indirect == Indirect::Map && global_photons(scene, settings) > 0 => {
            Some("the global map shows direct light, too")
        }
        () => served_lights(scene).is_empty().then_some("no light has a shadow to be found"),
    })
}

/// Photons in a map on surfaces, unless the scene file says otherwise: who asks for few in media wants a quick picture.
pub(super) fn on_surfaces(settings: &Settings) -> u64 {
    let Settings { film, render, .. } = settings;
    let [fewest, most] = ON_SURFACES;
    let default = render.quality.photons(ON_SURFACES_A_PIXEL.saturating_mul(pixels(film)).clamp(fewest, most));
    settings.photons.volume.map_or(default, |volume| volume.min(default))
}

/// Whether all media that scatter are in solids that hardly any light passes straight.
fn is_dense(scene: &Scene) -> bool {
    let scatters = |medium: Option<u32>| medium.filter(|&index| scene.media[index as usize].scatters());
    let thickness = |medium: u32, shape: u32| {
        let medium = &scene.media[medium as usize];
        let extent = scene.geometry.bounds(shape).intersection(medium.density.support()).diagonal();
        medium.max_extinction() * extent
    };
    let mut solids = scene.solids.iter().filter_map(|solid| Some((scatters(solid.medium)?, solid.shape))).peekable();
    scatters(scene.world).is_none() && solids.peek().is_some() && solids.all(|(m, shape)| thickness(m, shape) > THICK)
}
