//! What photons are stored in for a pass.

use std::time::Instant;

use super::plan::{Plan, Points};
use super::progress::Progress;
use super::sparse::some_photons;
use super::stats::Stats;
use crate::Result;
use crate::gather::{Confines, GlobalMap, PointMaps, SurfaceMap, VisibilityMap, VolumeMaps};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::medium::phase::{Peak, Phase};
use crate::photon::{
    Kind, Landed, MapSettings, Photon, PhotonMap, PointMap, PointSettings, Radii, Radius, ShadowPass, ShadowPhoton,
    Shadows, SurfacePass, narrowing,
    small::SmallSolids,
    trace_shadows, trace_surfaces,
    walls::{self, Walls},
};
use crate::scene::Scene;
use crate::scene::description::{Boundaries, Indirect};

/// The maps of a pass: each is there if the scene needs it.
#[derive(Debug, Default)]
pub(super) struct Maps {
    /// Of photons in media.
    pub volume: Option<VolumeMap>,
    /// Of caustics on surfaces.
    pub caustic: Option<SurfaceMap>,
    /// Of all light on surfaces.
    pub global: Option<GlobalMap>,
    /// Of shadow photons.
    pub visibility: Option<VisibilityMap>,
    /// Whether gather rays find light of media, where there is no global map.
    pub from_media_only: bool,
}

/// Photons in media, one map for each region: as discs for rays, or as balls for points on them.
#[derive(Debug)]
pub(super) enum VolumeMap {
    Beams(VolumeMaps),
    Points(PointMaps),
}

/// What is reported of a map.
pub(super) struct Summary {
    pub photons: usize,
    pub rejected: usize,
    pub bytes: usize,
    pub radii: Radii,
    /// Whether photons keep directions,
    pub directions: bool,
    /// and a power for each channel.
    pub colours: bool,
    /// Whether some discs lie along walls.
    pub leans: bool,
    /// What walls near photons take of that, in bytes.
    pub walls: usize,
}

impl Maps {
    /// From the photons of all regions and the extinction around them, as narrow as after `before` other passes.
    pub(super) fn build(
        scene: &Scene,
        plan: &Plan,
        before: u32,
        extinctions: &[f64],
        regions: Vec<Vec<Photon>>,
    ) -> Maps {
        let volume = match &plan.points {
            None => {
                let scale = narrowing(before, PhotonMap::DIMENSION) as f32;
                let sparse = if plan.spreads { some_photons(&regions, plan.radius) } else { Vec::new() };
                let all = regions.into_iter().map(|photons| (plan.radius, photons)).collect();
                let maps = beam_maps(scene, plan, scale, extinctions, all);
                VolumeMap::Beams(match sparse.iter().any(|(_, photons)| !photons.is_empty()) {
                    true => maps.with_sparse(beam_maps(scene, plan, scale, extinctions, sparse)),
                    false => maps,
                })
            }
            Some(points) => {
                let scale = narrowing(before, PointMap::DIMENSION) as f32;
                VolumeMap::Points(point_maps(scene, (points, &plan.peaks), scale, regions))
            }
        };
        Maps { volume: Some(volume), ..Maps::default() }
    }

    /// Of each map that holds photons, with its region.
    pub(super) fn summaries(&self) -> Vec<(u32, Summary)> {
        let of_beams = |map: &PhotonMap| Summary {
            photons: map.len(),
            rejected: map.rejected(),
            bytes: map.bytes(),
            radii: map.radii(),
            directions: map.has_directions(),
            colours: !map.is_grey(),
            leans: map.leans(),
            walls: map.wall_bytes(),
        };
        let of_points = |map: &PointMap| Summary {
            photons: map.len(),
            rejected: map.rejected(),
            bytes: map.bytes(),
            radii: map.radii(),
            directions: true,
            colours: true,
            leans: false,
            walls: 0,
        };
        match &self.volume {
            None => Vec::new(),
            Some(VolumeMap::Beams(maps)) => {
                let of_region = |(region, map)| (region, of_beams(map));
                let mut summaries: Vec<_> = maps.by_region().map(of_region).collect();
                for (region, sparse) in maps.sparse().into_iter().flat_map(VolumeMaps::by_region) {
                    let all = summaries.iter_mut().find(|(of, _)| *of == region);
                    all.into_iter().for_each(|(_, all)| all.bytes += sparse.bytes());
                }
                summaries
            }
            Some(VolumeMap::Points(maps)) => maps.by_region().map(|(region, map)| (region, of_points(map))).collect(),
        }
    }
}

impl Maps {
    /// Adds the maps of photons on surfaces that a pass needs, as narrow as after the passes before it; what that cost is added to
    /// `stats`. There is none where hardly any photon would land, or `stop` ended it.
    ///
    /// # Errors
    /// As [`trace_surfaces`].
    pub(super) fn add_surfaces(
        &mut self,
        (scene, plan, pass): (&Scene, &Plan, u32),
        (stats, progress): (&mut Stats, &impl Progress),
        stop: &(impl Fn() -> bool + Sync),
    ) -> Result<()> {
        let scale = narrowing(pass / plan.parts, SurfaceMap::DIMENSION) as f32;
        let Landed { photons: caustics, .. } = landed(scene, plan, (Kind::Caustic, pass), (stats, progress), stop)?;
        let global = landed(scene, plan, (Kind::Global, pass), (stats, progress), stop)?;
        self.from_media_only = global.from_media_only;
        let shadows = shadows(scene, plan, pass, (stats, progress), stop);
        let start = Instant::now();
        if !caustics.is_empty() {
            stats.caustic += caustics.len() as u64;
            let map = SurfaceMap::build(scene, (Kind::Caustic, caustics), plan.caustics.0, plan.caustics.1, scale);
            stats.tally.broken += map.rejected() as u64;
            self.caustic = Some(map);
        }
        if !global.photons.is_empty() {
            stats.global += global.photons.len() as u64;
            let map = GlobalMap::build(scene, (global.photons, global.scattered), &plan.global, scale);
            stats.tally.broken += map.rejected() as u64;
            self.global = Some(map);
        }
        if !shadows.is_empty() {
            stats.shadow += shadows.len() as u64;
            self.visibility = Some(VisibilityMap::build(&shadows, scene.lights.len()));
        }
        stats.surface_bytes = stats.surface_bytes.max(self.surface_bytes() as u64);
        stats.build_seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Bytes of the maps of photons on surfaces.
    pub(super) fn surface_bytes(&self) -> usize {
        self.caustic.as_ref().map_or(0, SurfaceMap::bytes)
            + self.global.as_ref().map_or(0, GlobalMap::bytes)
            + self.visibility.as_ref().map_or(0, VisibilityMap::bytes)
    }
}

/// Photons wanted in a pass's map on surfaces.
pub(super) fn wanted(plan: &Plan, kind: Kind) -> u64 {
    match kind {
        Kind::Caustic => plan.caustic_photons,
        Kind::Global => plan.global_photons,
    }
}

/// What a pass asks for a map on surfaces.
pub(super) fn surface_order(plan: &Plan, kind: Kind, pass: u32) -> SurfacePass<'_> {
    SurfacePass {
        kind,
        seed: plan.seed,
        index: u64::from(pass),
        target: wanted(plan, kind),
        max_emitted: plan.max_emitted,
        emission: plan.emission,
        max_events: plan.max_events,
        // Where surfaces send nothing to one another, there is nothing to gather.
        needs_exchange: kind == Kind::Global && plan.indirect == Indirect::FinalGather,
        tells_scattered: kind == Kind::Global && plan.global.flux,
        importons: plan.importons.as_ref().map(|importons| match kind {
            Kind::Caustic => importons.caustic.as_slice(),
            Kind::Global => importons.global.as_slice(),
        }),
        control: plan.control(),
    }
}

/// What a pass asks for shadow photons, if it wants any.
pub(super) fn shadow_order(plan: &Plan, pass: u32) -> Option<ShadowPass> {
    let (seed, index, target, emission) = (plan.seed, u64::from(pass), plan.shadow_photons, plan.emission);
    Some(ShadowPass { seed, index, target, emission, seen: plan.seen? })
}

/// The photons of a map on surfaces: none if `stop` ended it.
fn landed(
    scene: &Scene,
    plan: &Plan,
    (kind, pass): (Kind, u32),
    (stats, progress): (&mut Stats, &impl Progress),
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Landed> {
    let phase = match kind {
        Kind::Caustic => "caustics",
        Kind::Global => "surfaces",
    };
    if wanted(plan, kind) == 0 {
        return Ok(Landed::default());
    }
    let start = Instant::now();
    progress.phase(phase, 0);
    let landed = trace_surfaces(scene, &surface_order(plan, kind, pass), &|done, _| progress.advance(done), stop)?;
    if stop() {
        return Ok(Landed::default());
    }
    stats.emitted += landed.emitted;
    stats.tally = stats.tally.merge(landed.tally);
    stats.photons_seconds += start.elapsed().as_secs_f64();
    Ok(landed)
}

/// Shadow photons: none if `stop` ended them.
fn shadows(
    scene: &Scene,
    plan: &Plan,
    pass: u32,
    (stats, progress): (&mut Stats, &impl Progress),
    stop: &(impl Fn() -> bool + Sync),
) -> Vec<ShadowPhoton> {
    let Some(order) = shadow_order(plan, pass) else { return Vec::new() };
    let start = Instant::now();
    progress.phase("shadows", 0);
    let Shadows { photons, emitted } = trace_shadows(scene, &order, stop);
    if stop() {
        return Vec::new();
    }
    stats.emitted += emitted;
    stats.photons_seconds += start.elapsed().as_secs_f64();
    photons
}

fn beam_maps(
    scene: &Scene,
    plan: &Plan,
    scale: f32,
    extinctions: &[f64],
    regions: Vec<(Radius, Vec<Photon>)>,
) -> VolumeMaps {
    let corrects = plan.boundaries != Boundaries::None;
    let small = SmallSolids::of(scene);
    let walls_of = |region: u32, mean: f32| {
        let walls = Walls::of_discs(plan.boundaries, extinctions[region as usize], f64::from(mean / scale));
        if walls.lean() && small.all_of(region, mean) { walls.without_leaning() } else { walls }
    };
    let confines = Confines::possible(scene);
    let is_confined = |region: u32, mean: f32| {
        let leans = walls_of(region, mean).lean().then_some(extinctions[region as usize]);
        corrects && confines.confine(region, mean.into(), leans)
    };
    let build = |(region, (radius, photons)): (u32, (Radius, Vec<Photon>))| {
        let fluence = tells_fluence(scene, region);
        let settings = MapSettings {
            tagged: plan.tagged,
            directions: asks_directions(scene, region),
            scale,
            profile: plan.profile,
            boundaries: corrects,
            fluence,
            ..MapSettings::new(radius)
        };
        let near = |position, radius, mean, planes: &mut _| {
            if !is_confined(region, mean) {
                walls_of(region, mean).near(scene, &small, (position, radius), planes);
            }
        };
        (!photons.is_empty()).then(|| {
            let mut map = PhotonMap::build(photons, &settings, &near);
            let mean = map.radii().mean;
            if corrects && !is_confined(region, mean) && !walls_of(region, mean).lean() {
                map.keep_light(&small, region);
            }
            map
        })
    };
    let mut maps: Vec<Option<PhotonMap>> = (0..).zip(regions).map(build).collect();
    for (region, map) in (0..).zip(&mut maps) {
        // Maps without leaning discs are for bundles, which spread collisions evenly.
        if let Some(map) = map.as_mut().filter(|map| map.leans())
            && !tells_fluence(scene, region)
            && let Some(density) = uneven_density(scene, region)
        {
            map.follow_density(&|p| density.at(p));
        }
    }
    let confined: Vec<bool> = (0..)
        .zip(&maps)
        .map(|(region, map)| map.as_ref().is_some_and(|map| is_confined(region, map.radii().mean)))
        .collect();
    let confines = confines.of_regions(scene, |region| confined[region as usize]);
    VolumeMaps::new(maps, &scene.media, &plan.peaks, confines)
}

/// The density of a region that is filled with one medium, if it is made of voxels.
fn uneven_density(scene: &Scene, region: u32) -> Option<&Density> {
    let mut media = scene.solids.iter().filter(|solid| solid.region == region).map(|solid| solid.medium);
    let first = media.next().filter(|_| region != scene.world_region)??;
    let density = &scene.media[first as usize].density;
    (density.has_voxels() && media.all(|medium| medium == Some(first))).then_some(density)
}

/// Whether photons of a region tell the fluence, and not where they collide.
pub(super) fn tells_fluence(scene: &Scene, region: u32) -> bool {
    scene.region_media[region as usize].is_some_and(|medium| scene.uneven(medium).is_some())
}

/// Whether light in a region is scattered by where it comes from.
fn asks_directions(scene: &Scene, region: u32) -> bool {
    !medium_of(scene, region).and_then(|medium| medium.phase.even()).is_some_and(Phase::is_even)
}

fn point_maps(
    scene: &Scene,
    (points, peaks): (&Points, &[Option<Peak>]),
    scale: f32,
    regions: Vec<Vec<Photon>>,
) -> PointMaps {
    let clearance = |position, limit| walls::clearance(scene, position, limit);
    let build = |(region, photons): (u32, Vec<Photon>)| {
        let settings = PointSettings { scale, fluence: tells_fluence(scene, region), ..points.settings };
        (!photons.is_empty()).then(|| PointMap::build(photons, &settings, &clearance))
    };
    let maps: Vec<Option<PointMap>> = (0..).zip(regions).map(build).collect();
    let confines = Confines::possible(scene);
    let confined: Vec<bool> = (0..)
        .zip(&maps)
        .map(|(region, map)| {
            let radius = map.as_ref().filter(|_| points.settings.boundaries).map(|map| map.radii().mean);
            radius.is_some_and(|radius| confines.confine(region, radius.into(), None))
        })
        .collect();
    let confines = confines.of_regions(scene, |region| confined[region as usize]);
    PointMaps::new(maps, &scene.media, peaks, points.marchers.clone(), confines)
}

/// The medium of a region.
pub(super) fn medium_of(scene: &Scene, region: u32) -> Option<&Medium> {
    scene.region_media[region as usize].map(|medium| &scene.media[medium as usize])
}

/// Of each region, by [`mean_extinction`].
pub(super) fn mean_extinctions(scene: &Scene, regions: &[Vec<Photon>]) -> Vec<f64> {
    (0..).zip(regions).map(|(region, photons)| mean_extinction(scene, region, photons)).collect()
}

/// The largest channel's extinction where a region's photons are, on average.
fn mean_extinction(scene: &Scene, region: u32, photons: &[Photon]) -> f64 {
    let Some(medium) = medium_of(scene, region).filter(|_| !photons.is_empty()) else { return 0.0 };
    let density: f64 = if medium.density.is_even() {
        1.0
    } else {
        // A few thousand tell enough.
        let step = photons.len().div_ceil(4096);
        let some = photons.iter().step_by(step).map(|photon| medium.density.at(photon.position.as_dvec3()));
        if tells_fluence(scene, region) {
            // Where photons count.
            let [sum, squares] =
                some.fold([0.0; 2], |[sum, squares], density| [sum + density, squares + density * density]);
            if sum > 0.0 { squares / sum } else { 0.0 }
        } else {
            let count = photons.len().div_ceil(step);
            some.sum::<f64>() / count as f64
        }
    };
    medium.extinction.max_element() * density
}
