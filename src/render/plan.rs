//! What a scene needs, decided once, before anything is traced.

use std::sync::Arc;

use crate::Result;
use crate::gather::march::{Marcher, Stepping};
use crate::gather::{GlobalSettings, Reach, Spacing};
use crate::math::{Bounds, Cells};
use crate::medium::Medium;
use crate::medium::phase::{Peak, Phase};
use crate::photon::kernel::Profile;
use crate::photon::{Ball, Emission, Importons, InMedium, Kind, PointSettings, Radius, Tagged, may_land};
use crate::scene::description::{
    self, Boundaries, Estimate, GatherDirections, Indirect, Kernel, March, Method, Records, SingleScattering, Step,
    SurfaceEstimate, SurfaceFilter, Volume,
};
use crate::scene::{Inside, Scene, Settings};
use crate::transport::Events;

use super::camera::Camera;
use super::eternity;
use super::forced::Forced;
use super::importons;
use super::limits::Limits;
use super::numbers::{
    caustic_photons, global_photons, neighbours, shadow_photons, volume_photons, why_no_flux, why_no_irradiance_cache,
    why_no_irradiances,
};
use super::peaks;
use super::pilot::Pilot;

/// The decisions.
#[derive(Clone, Debug)]
pub struct Plan {
    /// How the image is computed.
    pub method: Method,
    /// What all random numbers derive from.
    pub seed: u64,
    /// How many events a path may have between light and eye.
    pub max_events: Events,
    /// Who finds light that a medium scatters straight from a light: a matter of photon mapping.
    pub single_scattering: SingleScattering,
    /// Volume photons wanted in each pass's map; 0 if the scene has no medium that scatters.
    pub volume_photons: u64,
    /// By medium, the peak of its phase function, where photons leave that to paths.
    pub peaks: Vec<Option<Peak>>,
    /// Photons wanted in each pass's caustic map; 0 if there is none.
    pub caustic_photons: u64,
    /// How the caustic map is looked up.
    pub caustics: (Reach, SurfaceFilter),
    /// Who tells what diffuse surfaces get that comes neither straight from a light nor as a caustic.
    pub indirect: Indirect,
    /// Photons wanted in each pass's global map; 0 if there is none.
    pub global_photons: u64,
    /// How the global map is looked up.
    pub global: GlobalSettings,
    /// Shadow photons wanted in each pass; 0 if there are none.
    pub shadow_photons: u64,
    /// A box around most of what they are wanted for.
    pub seen: Option<Bounds>,
    /// How many gather rays go on from a surface.
    pub gather_rays: u32,
    /// How far such rays must come for the global map to tell what is there; `None`: as far as it blurs light.
    pub accurate_distance: Option<f64>,
    /// What is kept of what they find, if it is.
    pub cache: Option<CacheSettings>,
    /// The most photons that are emitted in a pass.
    pub max_emitted: u64,
    /// How they are emitted.
    pub emission: Emission,
    /// Where they count in the picture, if they are drawn and kept by that.
    pub importons: Option<Arc<Importons>>,
    /// Whether more are traced, and hand their power to neighbours where they lie closest.
    pub density_control: bool,
    /// Whether those in media do: a neighbour's light comes from elsewhere, which matters where it is scattered by that.
    pub controls_media: bool,
    /// How wide they are spread.
    pub radius: Radius,
    /// Whether some of them are enough for many rays: those that surfaces spread.
    pub spreads: bool,
    /// What is done about walls near photons.
    pub boundaries: Boundaries,
    /// The kernel of discs.
    pub profile: Profile,
    /// How rays are marched, if points are looked up and not beams.
    pub points: Option<Points>,
    /// How rays are marched through each medium where light scattered once is traced, if the scene says how.
    pub traced: Option<Vec<Marcher>>,
    /// Whether photons must remember their events: for layers, or a limit of them.
    pub tagged: bool,
    /// Whether eye paths split in media: collisions are rare.
    pub split: bool,
    /// Parts that each pass is split into: independent, with their share of photons and samples, and all of one
    /// width.
    pub parts: u32,
    /// Camera samples per pixel and part; of [`Method::Light`] as many light paths, too.
    pub samples: u32,
    /// Whether pixels take more of them where there is noise.
    pub adaptive: bool,
    /// Shadow rays for each question for light at the first event, if that is at a surface.
    pub light_samples: u32,
    /// The solids around the camera, where they are the same for all of its lens.
    pub inside: Option<Inside>,
    /// What is there for no reason but that it is forced.
    pub forced: Vec<Forced>,
    /// Photons that are forced, by a plan of their own: their maps are built and kept, and nothing reads them.
    pub unread: Option<Box<Plan>>,
}

/// How the irradiance cache is filled.
#[derive(Clone, Copy, Debug)]
pub struct CacheSettings {
    /// The cells that gather rays of a record go through.
    pub cells: Cells,
    /// How many more go where photons say that light comes from.
    pub by_flux: u32,
    /// How far records count.
    pub spacing: Spacing,
    /// Neighbours may be apart by this share.
    pub error: f64,
    /// No record counts farther than this,
    pub max_radius: f64,
    /// nor less far than so many pixels' widths.
    pub min_pixels: f64,
}

impl CacheSettings {
    /// Gather rays of a record.
    pub fn rays(&self) -> usize {
        self.cells.count() + self.by_flux as usize
    }
}

/// How points on rays are looked up.
#[derive(Clone, Debug)]
pub struct Points {
    /// What a look-up does.
    pub settings: PointSettings,
    /// How rays are marched through each medium.
    pub marchers: Vec<Marcher>,
}

/// The share of the largest extent of the photons that adaptive radii may reach at most.
const MAX_RADIUS_SHARE: f64 = 0.1;
/// The share of the scene's extent that radii of caustics may reach at most.
const CAUSTIC_RADIUS_SHARE: f64 = 0.03;
/// Gather rays of a record of the irradiance cache, unless the scene file says otherwise: one for so many camera samples,
const SAMPLES_TO_A_RAY: u64 = 10_000;
/// from this many to this many. In `scenes/jensen/box.toml` at 960 × 720 some 3000 records send 3 % of all rays if each sends 200, and their noise, which
/// is blotches, is most of the error.
const CACHE_RAYS: [u64; 2] = [200, 2000];
/// The share of these that go where photons say that light comes from.
const BY_FLUX: f64 = 0.4;
/// The share of the scene's extent as far as which records count at most.
const CACHE_RADIUS_SHARE: f64 = 0.1;
/// By what share neighbouring records may be apart beyond their noise.
const CACHE_APART: f64 = 0.05;
/// Records count as far as so many pixels' widths at least.
const CACHE_PIXELS: f64 = 1.5;
/// The share of the scene's extent that fixed radii on surfaces have, unless the scene file says otherwise.
const FIXED_RADIUS_SHARE: f64 = 0.02;
/// Steps across the extent of the photons, unless the scene file says otherwise.
const STEPS: f64 = 64.0;
/// Steps are not shorter than this share of that, however dense a medium is.
const SHORTEST_STEP: f64 = 1.0 / 16.0;

impl Plan {
    /// Decides what is computed for a scene, from its settings and what limits the render.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) for a scene in which no walk can end; [`Error::Limit`](crate::Error::Limit) where memory is too short.
    pub fn new(scene: &Scene, settings: &Settings, camera: &Camera, limits: &Limits) -> Result<Plan> {
        let Settings { film, render, volume, surface, .. } = settings;

        // How long walks are, and whether they end.
        let max_events = Events::of_max_depth(render.max_depth);
        let pilot = Pilot { scene, camera, seed: render.seed };
        if eternity::why_no_pilot(render.method, max_events).is_none() {
            pilot.refuse_eternity()?;
        }

        // How many photons, in how many parts.
        let scatters = scene.media.iter().any(|medium| medium.scatters());
        let photons = volume_photons(scene, settings);
        let parts = limits.parts(scene, settings, photons)?;

        // How wide they are spread, by the extent that they can fill: of media with an end, else of the scene.
        let extent = extent_of_media(scene);
        let radius = match volume.kernel {
            Kernel::Fixed => {
                // As wide as would hold n photons if they filled the extent evenly.
                let share = f64::from(neighbours(scene, photons)) / photons.max(1) as f64;
                let chosen = 0.5 * extent * InMedium::growth(share);
                Radius::Fixed(volume.radius.unwrap_or(chosen) as f32)
            }
            Kernel::Variable => {
                let neighbours = volume.neighbours.unwrap_or_else(|| neighbours(scene, photons));
                // Sub-maps hold fewer photons; the same radius holds fewer neighbours.
                let neighbours = if parts > 1 { (neighbours / parts).max(5) } else { neighbours };
                let pilot = volume.pilot.unwrap_or_else(|| ((neighbours as f64).sqrt().ceil() as u32).max(5));
                Radius::Variable {
                    neighbours,
                    pilot: pilot.min(neighbours).max(1),
                    max_radius: volume.max_radius.unwrap_or(MAX_RADIUS_SHARE * extent) as f32,
                }
            }
        };

        // How photons on surfaces are looked up.
        let diagonal = scene.near_bounds().diagonal();
        let reach = |max_radius: f64| {
            let (neighbours, max_radius) = (surface.neighbours, max_radius as f32);
            let checks = surface.differential_checking;
            let fixed = || surface.radius.unwrap_or(FIXED_RADIUS_SHARE * diagonal) as f32;
            match surface.estimate {
                SurfaceEstimate::Knn => Reach::Ball { ball: Ball::Nearest { neighbours, max_radius }, checks },
                SurfaceEstimate::Fixed => Reach::Ball { ball: Ball::Fixed(fixed()), checks },
                SurfaceEstimate::Sheets => Reach::Sheets { neighbours, max_radius },
            }
        };
        let caustic_radius = surface.caustic_radius.unwrap_or(CAUSTIC_RADIUS_SHARE * diagonal);
        let max_radius = surface.max_radius.unwrap_or(MAX_RADIUS_SHARE * diagonal);
        let global_photons = global_photons(scene, settings);

        // How light is gathered that is kept.
        let caches = why_no_irradiance_cache(scene, settings).is_none();
        let camera_samples = u64::from(film.width) * u64::from(film.height) * u64::from(render.samples);
        let [fewest, most] = CACHE_RAYS;
        let cache_rays =
            surface.gather_rays.unwrap_or_else(|| (camera_samples / SAMPLES_TO_A_RAY).clamp(fewest, most) as u32);
        let by_flux = match surface.gather_directions {
            GatherDirections::Flux => (BY_FLUX * f64::from(cache_rays)) as u32,
            GatherDirections::Bsdf => 0,
        };

        // All together.
        let inside = (camera.is_pinhole() || scene.solids.is_empty()).then(|| scene.inside(camera.position));
        let shadow_photons = shadow_photons(scene, settings).div_ceil(u64::from(parts));
        let mut plan = Plan {
            method: render.method,
            seed: render.seed,
            max_events,
            single_scattering: match render.method {
                Method::Photon => volume.single_scattering,
                Method::Path | Method::Light | Method::Whitted => SingleScattering::Photons,
            },
            volume_photons: if photons > 0 { (photons / parts as u64).max(1) } else { 0 },
            peaks: if photons > 0 { peaks::of_media(scene, volume) } else { Vec::new() },
            caustic_photons: caustic_photons(scene, settings).div_ceil(u64::from(parts)),
            caustics: (reach(caustic_radius), surface.filter),
            indirect: match render.method {
                Method::Photon => surface.indirect,
                Method::Whitted => Indirect::None,
                Method::Path | Method::Light => Indirect::Path,
            },
            global_photons: global_photons.div_ceil(u64::from(parts)),
            global: GlobalSettings {
                reach: reach(max_radius),
                filter: surface.filter,
                precomputed: match why_no_irradiances(scene, settings) {
                    None => surface.precomputed_irradiance,
                    Some(_) => 0,
                },
                max_radius: max_radius as f32,
                flux: why_no_flux(scene, settings).is_none(),
            },
            shadow_photons,
            seen: if shadow_photons > 0 { pilot.seen() } else { None },
            gather_rays: surface.gather_rays.unwrap_or(1),
            accurate_distance: surface.accurate_distance,
            cache: caches.then(|| CacheSettings {
                cells: Cells::about(cache_rays - by_flux),
                by_flux,
                spacing: match surface.records {
                    Records::Hessian => Spacing::Hessian(surface.cache_error),
                    Records::SplitSphere => Spacing::SplitSphere(surface.cache_error),
                },
                error: CACHE_APART,
                max_radius: CACHE_RADIUS_SHARE * diagonal,
                min_pixels: CACHE_PIXELS,
            }),
            max_emitted: settings.photons.max_emitted,
            emission: Emission { aims: settings.photons.projection, by: settings.photons.emission },
            importons: (render.method == Method::Photon && settings.photons.importance)
                .then(|| Arc::new(importons::trace(&pilot, surface.indirect))),
            density_control: settings.photons.density_control,
            controls_media: settings.photons.density_control
                && scene
                    .media
                    .iter()
                    .filter(|medium| medium.scatters())
                    .all(|medium| medium.phase.even().is_some_and(Phase::is_even)),
            radius,
            spreads: matches!(surface.indirect, Indirect::FinalGather | Indirect::Path)
                && max_events.allows(1)
                && may_land(scene, Kind::Global),
            points: None,
            traced: (volume.single_scattering.asks_lights() && volume.march.is_some())
                .then(|| marchers(scene, volume, extent)),
            tagged: film.layers || max_events.is_limited(),
            split: false,
            parts,
            boundaries: volume.boundaries,
            profile: profile(volume.profile, Profile::Biweight),
            samples: render.samples.div_ceil(parts),
            adaptive: render.adaptive && render.method != Method::Light,
            light_samples: render.light_samples,
            inside,
            forced: Vec::new(),
            unread: None,
        };
        if volume.estimate == Estimate::Point {
            plan.points = Some(points(scene, volume, &plan, extent));
        }
        if render.method == Method::Path && scatters {
            plan.split = pilot.collisions_are_rare(parts);
        }
        plan.force(&pilot, settings, limits);
        Ok(plan)
    }

    /// Whether photons' density is controlled, and whether they are told apart by their events then.
    pub(super) fn control(&self) -> Option<Tagged> {
        self.density_control.then_some(Tagged(self.tagged))
    }
}

fn profile(chosen: Option<description::Profile>, default: Profile) -> Profile {
    match chosen {
        None => default,
        Some(description::Profile::Constant) => Profile::Constant,
        Some(description::Profile::Epanechnikov) => Profile::Epanechnikov,
        Some(description::Profile::Biweight) => Profile::Biweight,
    }
}

/// How points are looked up: in balls as wide as the discs of beams would be.
fn points(scene: &Scene, volume: &Volume, plan: &Plan, extent: f64) -> Points {
    let ball = match plan.radius {
        Radius::Fixed(radius) => Ball::Fixed(radius),
        Radius::Variable { neighbours, max_radius, .. } => Ball::Nearest { neighbours: neighbours.max(2), max_radius },
    };
    Points {
        settings: PointSettings {
            profile: profile(volume.profile, Profile::Constant),
            tagged: plan.tagged,
            boundaries: volume.boundaries != Boundaries::None,
            ..PointSettings::new(ball)
        },
        marchers: marchers(scene, volume, extent),
    }
}

/// How rays are marched through each medium.
fn marchers(scene: &Scene, volume: &Volume, extent: f64) -> Vec<Marcher> {
    let march = volume.march.as_ref().unwrap_or(&March::DEFAULT);
    let stepping = match march.step {
        Step::Uniform => Stepping::Uniform,
        Step::Adaptive => Stepping::Adaptive { contrast: march.contrast },
        Step::Exponential => Stepping::Exponential,
        Step::Random => Stepping::Random,
    };
    // Short against the scene, and in dense media against half a mean free path.
    let longest = extent / STEPS;
    let size = |medium: &Medium| {
        let path = 0.5 / medium.max_extinction();
        march.size.unwrap_or(path.clamp(SHORTEST_STEP * longest, longest))
    };
    scene.media.iter().map(|medium| Marcher { stepping, size: size(medium) }).collect()
}

/// The diagonal of the box around all media that scatter, as far as they end; else of the scene: without what lies far beyond the rest.
fn extent_of_media(scene: &Scene) -> f64 {
    let all = (0..).zip(&scene.media).filter(|(_, medium)| medium.scatters());
    let bounds = all.fold(Bounds::EMPTY, |all, (index, _)| all.union(bounds_of_medium(scene, index)));
    if !bounds.size().is_finite() || bounds.is_empty() {
        // Walls around a fog limit it; without walls its mean free path does.
        return scene.near_bounds().diagonal().max(f64::MIN_POSITIVE);
    }
    bounds.diagonal()
}

/// The box around a medium, as far as it is near, if it is anywhere; infinite if that fills the world and has no end.
pub(super) fn bounds_of_medium(scene: &Scene, medium: u32) -> Bounds {
    let support = scene.media[medium as usize].density.support();
    let holds = |near: bool| {
        let all = scene.solids.iter().filter(move |solid| solid.medium == Some(medium));
        all.filter(move |solid| !near || scene.is_near(solid.shape))
    };
    let solids = holds(holds(true).next().is_some());
    let world = (scene.world == Some(medium)).then_some(support);
    let boxes = solids.map(|solid| scene.geometry.bounds(solid.shape).intersection(support)).chain(world);
    boxes.fold(Bounds::EMPTY, |all, next| all.union(next))
}
